//! Carries out [`plan::taps`](crate::plan::taps).

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, pixels};
use super::picture::GpuPicture;
use super::shader::{Defocus, Shader, shader, shared};
use crate::error::Result;
use crate::optics::Optics;
use crate::plan::taps::{MAX_BLUR, Plan, Settings};

pub const TAPS: Shader = shader!("taps", ["mirror", "picture", "depth", "defocus"], [Params, Tap, Defocus]);

shared! {
    struct Params {
        size: [u32; 2],
        count: u32,
        mix: u32,
        share: f32,
        max_blur: f32,
        top: u32,
        _gap: u32,
        defocus: Defocus,
    }
}

shared! {
    struct Tap {
        dx: [i32; 4],
        dy: [i32; 4],
        weight: [f32; 4],
    }
}

impl From<&crate::plan::taps::Tap> for Tap {
    fn from(tap: &crate::plan::taps::Tap) -> Tap {
        let pixel = |i: usize| tap.pixels.get(i).copied().unwrap_or_default();
        let at: [usize; 4] = std::array::from_fn(|i| i);
        Tap { dx: at.map(|i| pixel(i).0), dy: at.map(|i| pixel(i).1), weight: at.map(|i| pixel(i).2) }
    }
}

/// What the method requires of a device.
pub fn requirements(settings: &Settings, optics: &Optics) -> Requirements {
    Requirements::reaching(Plan::new(settings, optics).margin)
}

/// Renders the picture.
pub fn render(
    commands: &mut Commands,
    scene: &GpuPicture,
    optics: &Optics,
    settings: &Settings,
) -> Result<wgpu::Buffer> {
    let plan = Plan::new(settings, optics);
    let size = scene.size;
    let taps: Vec<Tap> = plan.taps.iter().map(Tap::from).collect();
    let params = Params {
        size: pixels(size),
        count: taps.len() as u32,
        mix: plan.mix as u32,
        share: plan.share,
        max_blur: MAX_BLUR as f32,
        top: 0,
        _gap: 0,
        defocus: plan.defocus().into(),
    };
    let taps = commands.gpu.upload("the table of look-ups", &taps)?;
    let picture = commands.output(size)?;
    let disparity = scene.disparity()?;
    let buffers = [Read(&scene.color), Read(&disparity), Read(&taps), Write(&picture)];
    let params = |top| Params { top, ..params };
    let work = (size.width, size.height, 1 + plan.taps.len());
    commands.rows(&TAPS, size.channels, params, &buffers, work)?;
    Ok(picture)
}
