//! Carries out [`plan::poisson`](crate::plan::poisson).

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, pixels};
use super::picture::GpuPicture;
use super::shader::{Defocus, Shader, shader, shared};
use crate::error::Result;
use crate::optics::{Measure, Optics};
use crate::plan::poisson::{Plan, Settings};

pub const POISSON: Shader =
    shader!("poisson", ["mirror", "picture", "depth", "defocus"], [Params, Tap, Defocus]);

shared! {
    struct Params {
        size: [u32; 2],
        count: u32,
        leak_test: u32,
        centre: f32,
        max_radius_px: f32,
        rounding: f32,
        top: u32,
        shift: Defocus,
    }
}

shared! {
    struct Tap {
        place: [f32; 2],
        weight: f32,
        _end: u32,
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
    let tap = |tap: &crate::plan::poisson::Tap| Tap { place: [tap.x, tap.y], weight: tap.weight, _end: 0 };
    let taps: Vec<Tap> = plan.taps.iter().map(tap).collect();
    let params = Params {
        size: pixels(size),
        count: taps.len() as u32,
        leak_test: plan.leak_test as u32,
        centre: plan.centre,
        max_radius_px: plan.max_radius_px as f32,
        rounding: plan.rounding,
        top: 0,
        shift: optics.defocus(Measure::Shift, 1.0).into(),
    };
    let taps = commands.gpu.upload("the table of taps", &taps)?;
    let picture = commands.output(size)?;
    let disparity = scene.disparity()?;
    let buffers = [Read(&scene.color), Read(&disparity), Read(&taps), Write(&picture)];
    let params = |top| Params { top, ..params };
    let work = (size.width, size.height, 1 + plan.taps.len());
    commands.rows(&POISSON, size.channels, params, &buffers, work)?;
    Ok(picture)
}
