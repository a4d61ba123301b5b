//! Carries out [`plan::lens`](crate::plan::lens).
//!
//! The layered scene stays on the device; another focus only uploads its plan. [`colors`] prepares the cells' colours
//! for the focus. Then each tile is in focus, an exact [`disc`], a [`sweep`] or in part both, and [`highlights`] are added to them.

pub(super) mod colors;
pub(super) mod disc;
pub(super) mod edges;
pub(super) mod frame;
pub(super) mod highlights;
mod kernels;
pub(super) mod layered;
mod listed;
pub(super) mod optical_vignetting;
pub(super) mod sweep;
#[cfg(test)]
mod tests;

pub use layered::Cells;

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, pixels};
use super::picture::GpuPicture;
use super::shader::{Shader, shader, shared};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::plan::lens::footprint::REACHES;
use crate::plan::lens::highlights::Highlights;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::padding::Margin;
use crate::plan::lens::tiles::{self, Work};
use crate::plan::lens::{Plan, Settings, check_full_resolution, reach_px};
use crate::scene::grid::{BLOCK, TILE};
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use frame::{GROUPS, LensFrame, origin, units};
use kernels::Kernels;

pub const IN_FOCUS: Shader =
    shader!("lens/in_focus", ["mirror", "picture", "lens/depth_spans"], [InFocusParams]);

shared! {
    /// Parameters for tiles in focus.
    struct InFocusParams {
        size: [u32; 2],
        layers: u32,
        cell_layers: u32,
        loss_per_px2: [f32; 2],
        s_focus: f32,
        first_tile: u32,
    }
}

/// The input of a render.
pub struct Input<'a> {
    pub picture: &'a GpuPicture,
    pub scene: &'a LayeredScene,
    pub cells: &'a Cells,
    /// See `cpu::lens::Input`.
    pub supersample: usize,
}

/// What the method requires of a device. Rays reach as far as the largest circle of confusion around the tiles. Cells
/// are widened by the sum of all [`REACHES`], and highlights are found by the blocks around them.
pub fn requirements(scene: &LayeredScene, optics: &Optics) -> Requirements {
    let s_focus = optics.k * optics.d_focus;
    let reach_px = reach_px(scene, s_focus);
    let beyond = REACHES.iter().sum::<usize>() + 4 * BLOCK;
    let bytes_per_px = size_of::<[f32; 4]>() * scene.layers.len();
    // The colours without highlights for discs and for the sweep, and twice as they are drawn; those of one colour; and
    // sums along rows.
    let all_bytes_per_px = (2 + 2 + 1) * bytes_per_px + size_of::<[f32; 4]>() + size_of::<f32>();
    let kept_bytes_per_px = bytes_per_px + layered::OTHER_BYTES_PER_CELL * scene.layers.len();
    Requirements {
        bytes_per_px,
        all_bytes_per_px,
        kept_bytes_per_px,
        block_px: TILE.1,
        ..Requirements::reaching(reach_px.ceil() as usize + beyond)
    }
}

/// Renders the picture.
pub fn render(
    commands: &mut Commands,
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
) -> Result<wgpu::Buffer> {
    let Input { scene, cells, .. } = *input;
    let size = scene.size;
    check_full_resolution(reach_px(scene, optics.k * optics.d_focus))?;
    let tiles = (Margin::Period, tiles::origins(size.width, size.height));
    let plan = Plan::new(scene, optics, settings, input.supersample, tiles, simd);
    cancel.check()?;
    let highlights = Highlights::new(scene, &plan, simd);
    let kernels = Kernels::new(scene, &plan, &highlights, &settings.aperture, cancel)?;

    let clip = settings.second_stop.map(|second_stop| PupilClip::new(second_stop, &settings.aperture));
    let picture = commands.output(size)?;
    let dim = colors::dim(commands, cells, &highlights.dimmed)?;
    let frame = LensFrame { cells, codes: &scene.codes, plan: &plan, clip: clip.as_ref(), picture: &picture };
    in_focus(commands, input.picture, &frame)?;
    if !plan.sample_sets.is_empty() {
        let swept = highlights.swept.as_ref().map(|swept| colors::dim(commands, cells, swept)).transpose()?;
        let drawn = colors::drawn(commands, cells, &plan, swept.as_ref().unwrap_or(&dim).buffer(cells))?;
        sweep::pass(commands, &frame, &drawn)?;
    }
    disc::pass(commands, &frame, &kernels, dim.buffer(cells))?;
    highlights::pass(commands, &frame, kernels, &highlights, &settings.aperture)?;
    Ok(picture)
}

/// Renders the tiles that are in focus.
fn in_focus(commands: &mut Commands, picture: &GpuPicture, frame: &LensFrame) -> Result<()> {
    let LensFrame { cells, plan, .. } = *frame;
    let tiles = plan.tiles.iter().filter(|tile| tile.work == Work::InFocus);
    let origins: Vec<[u32; 2]> = tiles.map(|tile| origin(tile.origin)).collect();
    if origins.is_empty() {
        return Ok(());
    }
    let (color, layers) = match &cells.held {
        Some(held) => (held, 1),
        None => (&picture.color, picture.layers),
    };
    let params = InFocusParams {
        size: pixels(picture.size),
        layers: layers as u32,
        cell_layers: cells.layers as u32,
        loss_per_px2: plan.in_focus.loss_per_px2,
        s_focus: plan.s_focus as f32,
        first_tile: 0,
    };
    let work = vec![units(1); origins.len()];
    let tiles = commands.gpu.upload("the tiles in focus", &origins)?;
    let buffers = [Read(color), Read(&tiles), Read(&cells.shifts), Write(frame.picture)];
    let params = |first_tile| InFocusParams { first_tile, ..params };
    commands.tiles(&IN_FOCUS, picture.size.channels, params, &buffers, (&work, GROUPS))
}
