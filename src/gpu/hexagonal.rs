//! Carries out [`plan::hexagonal`](crate::plan::hexagonal).

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, pixels};
use super::picture::GpuPicture;
use super::shader::{Defocus, Shader, shader, shared};
use crate::error::Result;
use crate::optics::{Measure, Optics};
use crate::plan::hexagonal::{self as plan, Plan, Settings};

pub const GATHER: Shader = shader!(
    "hexagonal/gather",
    ["mirror", "picture", "depth", "defocus", "hexagonal/lines"],
    [Params, Tap, Texel, Defocus]
);
pub const SHADE: Shader = shader!(
    "hexagonal/shade",
    ["mirror", "picture", "depth", "defocus", "hexagonal/lines"],
    [Params, Tap, Texel, Defocus]
);

/// The largest number of lines of a pass.
const MAX_LINES: usize = 4;
/// The largest number of targets.
const MAX_TARGETS: usize = 2;

shared! {
    struct Params {
        size: [u32; 2],
        frame: [u32; 2],
        origin: [u32; 2],
        count: u32,
        scale: f32,
        lines: [[u32; 4]; MAX_LINES],
        max_coc_px: f32,
        top: u32,
        _gap: [u32; 2],
        shift: Defocus,
    }
}

shared! {
    struct Tap {
        dx: i32,
        dy: i32,
        share: f32,
        from_px: f32,
        step_px: f32,
    }
}

impl From<&plan::Tap> for Tap {
    fn from(tap: &plan::Tap) -> Tap {
        Tap { dx: tap.dx, dy: tap.dy, share: tap.share, from_px: tap.from_px, step_px: tap.step_px }
    }
}

shared! {
    struct Texel {
        near: [f32; 4],
        rest: [f32; 4],
        parts: [f32; 4],
    }
}

/// The lines of one pass in one buffer.
struct Lines {
    taps: Vec<Tap>,
    lines: [[u32; 4]; MAX_LINES],
    count: usize,
}

impl Lines {
    fn new(plan: &Plan, of: impl Fn(&plan::Target) -> &Vec<plan::Line>) -> Lines {
        let mut all = Lines { taps: Vec::new(), lines: [[0; 4]; MAX_LINES], count: 0 };
        for (i, target) in plan.targets.iter().enumerate() {
            for line in of(target) {
                let first = all.taps.len();
                all.taps.extend(line.taps.iter().map(Tap::from));
                all.lines[all.count] = [first as u32, all.taps.len() as u32, i as u32, 0];
                all.count += 1;
            }
        }
        all
    }
}

/// What the method requires of a device.
pub fn requirements(settings: &Settings, largest_px: f64) -> Requirements {
    let (second, both) = Plan::new(settings, largest_px.min(settings.max_coc_px)).margins();
    let around_px = second.left.max(second.right).max(second.above).max(second.below);
    let bytes_per_px = size_of::<Texel>();
    let reaching = Requirements::reaching(both.above.max(both.below));
    Requirements { bytes_per_px, all_bytes_per_px: MAX_TARGETS * bytes_per_px, around_px, ..reaching }
}

/// Renders the picture.
pub fn render(
    commands: &mut Commands,
    scene: &GpuPicture,
    optics: &Optics,
    settings: &Settings,
) -> Result<wgpu::Buffer> {
    let gpu = commands.gpu;
    let size = scene.size;
    let reach_px = optics.largest_radius_px(scene.disparity_range).min(settings.max_coc_px);
    let plan = Plan::new(settings, reach_px);
    let (margin, _) = plan.margins();
    let (width, height) =
        (margin.left + size.width + margin.right, margin.above + size.height + margin.below);
    let params = |lines: &Lines, top| Params {
        size: pixels(size),
        frame: [width as u32, height as u32],
        origin: [margin.left as u32, margin.above as u32],
        count: lines.count as u32,
        scale: plan.scale,
        lines: lines.lines,
        max_coc_px: settings.max_coc_px as f32,
        top,
        _gap: [0; 2],
        shift: optics.defocus(Measure::Shift, 1.0).into(),
    };
    let (gathered, spread) = (Lines::new(&plan, |t| &t.gathered), Lines::new(&plan, |t| &t.spread));
    // If there is no second target, its buffers are bound but never read.
    let mut targets = Vec::new();
    for target in 0..MAX_TARGETS {
        let len = if target < plan.targets.len() { width * height } else { 1 };
        targets.push(commands.scratch::<Texel>("a target of lines", len)?);
    }
    let picture = commands.output(size)?;
    let disparity = scene.disparity()?;
    let input = [Read(&scene.color), Read(&disparity)];

    let taps = gpu.upload("the lines of the first pass", &gathered.taps)?;
    let buffers: Vec<_> = input.into_iter().chain([Read(&taps)]).chain(targets.iter().map(Write)).collect();
    let work = (width, height, 1 + gathered.taps.len());
    commands.rows(&GATHER, size.channels, |top| params(&gathered, top), &buffers, work)?;
    let taps = gpu.upload("the lines of the second pass", &spread.taps)?;
    let targets = [Read(&taps)].into_iter().chain(targets.iter().map(Read)).chain([Write(&picture)]);
    let buffers: Vec<_> = input.into_iter().chain(targets).collect();
    let work = (size.width, size.height, 1 + spread.taps.len());
    commands.rows(&SHADE, size.channels, |top| params(&spread, top), &buffers, work)?;
    Ok(picture)
}
