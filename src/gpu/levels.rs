//! Carries out [`plan::levels`](crate::plan::levels).

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::picture::GpuPicture;
use super::shader::{Defocus, Shader, shader, shared};
use crate::error::Result;
use crate::optics::Optics;
use crate::plan::levels::{KEPT, Plan, STEPS, Settings};

pub const REDUCE: Shader = shader!("levels/reduce", ["mirror", "picture"], [ReduceParams]);
pub const FILTER: Shader = shader!("levels/filter", ["mirror"], [FilterParams]);
pub const INTERPOLATE: Shader =
    shader!("levels/interpolate", ["mirror", "picture", "depth", "defocus"], [InterpolateParams, Defocus]);

shared! {
    /// Parameters of the reduction.
    struct ReduceParams {
        size: [u32; 2],
        small: [u32; 2],
        block: u32,
    }
}

shared! {
    /// Parameters of a filter step.
    struct FilterParams {
        size: [u32; 2],
        middle: f32,
        beside: f32,
        beyond: f32,
    }
}

shared! {
    /// Parameters of the interpolation.
    struct InterpolateParams {
        size: [u32; 2],
        small: [u32; 2],
        block: u32,
        _gap: [u32; 3],
        beginning: Defocus,
    }
}

/// What the method requires of a device: filter steps read two pixels of their target, and the interpolation one.
pub fn requirements(settings: &Settings, largest_px: f64) -> Requirements {
    let scale = Plan::new(settings, largest_px).scale;
    let bytes_per_px = size_of::<[f32; 4]>().div_ceil(scale * scale);
    let reaching = Requirements::reaching((2 * STEPS + 2) * scale);
    Requirements { bytes_per_px, all_bytes_per_px: 3 * bytes_per_px, block_px: scale, ..reaching }
}

/// Renders the picture.
pub fn render(
    commands: &mut Commands,
    scene: &GpuPicture,
    optics: &Optics,
    settings: &Settings,
) -> Result<wgpu::Buffer> {
    let plan = Plan::new(settings, optics.largest_radius_px(scene.disparity_range));
    let (size, c, block) = (scene.size, scene.size.channels, plan.scale as u32);
    let (width, height) = (size.width.div_ceil(plan.scale), size.height.div_ceil(plan.scale));
    let (full, small) = (pixels(size), [width as u32, height as u32]);
    let mut target = || commands.scratch::<[f32; 4]>("a target of the chain", width * height);
    // Two targets that are used alternately, and the one that is kept.
    let (mut before, mut after, half_way) = (target()?, target()?, target()?);
    let picture = commands.output(size)?;

    let disparity = scene.disparity()?;
    let input = [Read(&scene.color), Read(&disparity)];
    let reduce = ReduceParams { size: full, small, block };
    let on_small = groups(width, height);
    commands.pass(&REDUCE, c, &reduce, &[input[0], input[1], Write(&before)], on_small)?;
    let [middle, beside, beyond] = plan.weights;
    let filter = FilterParams { size: small, middle, beside, beyond };
    for step in 1..=STEPS {
        let into = if step == KEPT { &half_way } else { &after };
        let from = if step == KEPT + 1 { &half_way } else { &before };
        commands.pass(&FILTER, c, &filter, &[Read(from), Write(into)], on_small)?;
        std::mem::swap(&mut before, &mut after);
    }
    let interpolate = InterpolateParams {
        size: full,
        small,
        block,
        _gap: [0; 3],
        beginning: plan.beginning(optics).into(),
    };
    let buffers = [input[0], input[1], Read(&half_way), Read(&before), Write(&picture)];
    commands.pass(&INTERPOLATE, c, &interpolate, &buffers, groups(size.width, size.height))?;
    Ok(picture)
}
