//! Carries out [`plan::gaussian`](crate::plan::gaussian).

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::picture::GpuPicture;
use super::shader::{Defocus, Shader, shader, shared};
use crate::error::Result;
use crate::optics::Optics;
use crate::plan::gaussian::{Plan, REACH, Settings};

pub const HALVE: Shader =
    shader!("gaussian/halve", ["mirror", "picture", "depth", "defocus"], [FrameParams, Defocus]);
pub const BLUR_X: Shader = shader!("gaussian/blur_x", ["mirror"], [AcrossParams, Tap]);
pub const BLUR_Y: Shader = shader!("gaussian/blur_y", ["mirror"], [DownParams]);
pub const COMPOSITE: Shader =
    shader!("gaussian/composite", ["mirror", "picture", "depth", "defocus"], [FrameParams, Defocus]);

shared! {
    /// Parameters of the passes that read the picture.
    struct FrameParams {
        size: [u32; 2],
        half: [u32; 2],
        defocus: Defocus,
    }
}

shared! {
    /// Parameters of the blur along x.
    struct AcrossParams {
        half: [u32; 2],
        count: u32,
        centre_threshold: f32,
    }
}

shared! {
    /// Parameters of the blur along y.
    struct DownParams {
        half: [u32; 2],
        reach: u32,
    }
}

shared! {
    struct Tap {
        whole: i32,
        fraction: f32,
        threshold: f32,
    }
}

/// What the method requires of a device: interpolation and halving read one texel farther than the blur.
pub fn requirements() -> Requirements {
    // Two colours and two weights for every fourth pixel.
    let all_bytes_per_px = (2 * size_of::<[f32; 4]>() + 2 * size_of::<f32>()).div_ceil(4);
    Requirements { all_bytes_per_px, block_px: 2, ..Requirements::reaching(2 * (REACH + 3)) }
}

/// Renders the picture.
pub fn render(
    commands: &mut Commands,
    scene: &GpuPicture,
    optics: &Optics,
    settings: &Settings,
) -> Result<wgpu::Buffer> {
    let gpu = commands.gpu;
    let plan = Plan::new(settings, optics);
    let (size, c) = (scene.size, scene.size.channels);
    let half = (size.width.div_ceil(2), size.height.div_ceil(2));
    let half_size = [half.0 as u32, half.1 as u32];
    let frame = FrameParams { size: pixels(size), half: half_size, defocus: plan.defocus().into() };
    let tap = |tap: &crate::plan::gaussian::Tap| Tap {
        whole: tap.whole as i32,
        fraction: tap.fraction,
        threshold: tap.threshold,
    };
    let taps = gpu.upload("the table of taps", &plan.taps.each_ref().map(tap))?;
    let weights = gpu.upload("the table of weights", &plan.weights)?;
    // The blur along y writes into the buffer of the half-size copy, which is no longer needed.
    let texels = half.0 * half.1;
    let color = commands.scratch::<[f32; 4]>("a half-size copy", texels)?;
    let blurriness = commands.scratch::<f32>("its blurriness", texels)?;
    let sum_color = commands.scratch::<[f32; 4]>("the half-size copy blurred along x", texels)?;
    let sum_weight = commands.scratch::<f32>("its weights", texels)?;
    let picture = commands.output(size)?;

    let (on_half, on_full) = (groups(half.0, half.1), groups(size.width, size.height));
    let disparity = scene.disparity()?;
    let input = [Read(&scene.color), Read(&disparity)];
    let [own, depth] = input;
    commands.pass(&HALVE, c, &frame, &[own, depth, Write(&color), Write(&blurriness)], on_half)?;
    let across = AcrossParams {
        half: half_size,
        count: plan.taps.len() as u32,
        centre_threshold: plan.centre_threshold,
    };
    let sums = [Write(&sum_color), Write(&sum_weight)];
    commands.pass(
        &BLUR_X,
        c,
        &across,
        &[Read(&color), Read(&blurriness), Read(&taps), sums[0], sums[1]],
        on_half,
    )?;
    let down = DownParams { half: half_size, reach: REACH as u32 };
    commands.pass(
        &BLUR_Y,
        c,
        &down,
        &[Read(&sum_color), Read(&sum_weight), Read(&weights), Write(&color)],
        on_half,
    )?;
    commands.pass(&COMPOSITE, c, &frame, &[own, depth, Read(&color), Write(&picture)], on_full)?;
    Ok(picture)
}
