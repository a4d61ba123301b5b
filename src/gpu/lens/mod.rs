//! Carries out [`cpu::lens::plan`](crate::cpu::lens::plan).
//!
//! The sheets stay on the device; a focus costs what the plan takes. [`colors`] makes the cells' colours ready for it,
//! then each tile is a [`copy`](self), an exact [`disc`] or a [`sweep`], and [`highlights`] are laid over them.

pub(super) mod cells;
pub(super) mod clip;
pub(super) mod colors;
pub(super) mod disc;
pub(super) mod highlights;
mod kernels;
pub(super) mod sweep;

pub use cells::Cells;

use super::bands::Need;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, pixels};
use super::resident::Resident;
use super::shader::{Shader, shader, shared};
use crate::cancel::Cancel;
use crate::cpu::lens::blocks::BLOCK;
use crate::cpu::lens::cells::Codes;
use crate::cpu::lens::footprint::REACHES;
use crate::cpu::lens::highlights::{Highlights, extract};
use crate::cpu::lens::pack::TILE;
use crate::cpu::lens::plan::Plan;
use crate::cpu::lens::tiles::Work;
use crate::cpu::lens::{Clip, Settings, Sheets};
use crate::cpu::simd::Simd;
use crate::error::Result;
use crate::optics::Optics;
use kernels::Kernels;

pub const COPY: Shader = shader!("lens/copy", ["border", "picture"], [CopyParams]);

shared! {
    /// Of tiles that are copied.
    struct CopyParams {
        size: [u32; 2],
        layers: u32,
        _end: u32,
    }
}

/// How often an invocation may go through its loops in one pass; what needs more is shared among passes. No pass then
/// takes so long that a driver ends it, and llvmpipe, which silently leaves all loops after 65535 turns, never does.
const MAX_LOOPS: usize = 40_000;
/// Rows of a tile that one workgroup has, a pixel for each invocation.
const GROUP_ROWS: usize = 4;

/// Workgroups that cover some tiles.
fn per_pixel(tiles: usize) -> [u32; 3] {
    [tiles as u32, TILE.1.div_ceil(GROUP_ROWS) as u32, 1]
}

/// What is rendered.
pub struct Input<'a> {
    pub picture: &'a Resident,
    pub sheets: &'a Sheets,
    pub cells: &'a Cells,
    /// As [`cpu::lens::render`](crate::cpu::lens::render) takes it.
    pub supersample: usize,
}

/// What it needs of a device: rays go as far as the largest circle of confusion, from tiles that begin with them; cells
/// are widened by what all [`REACHES`] are together, and highlights told by the blocks around them.
pub fn need(sheets: &Sheets, optics: &Optics) -> Need {
    let s_focus = optics.k * optics.d_focus;
    let reach_px = (sheets.shifts.0 - s_focus).abs().max((sheets.shifts.1 - s_focus).abs());
    let beyond = REACHES.iter().sum::<usize>() + 4 * BLOCK;
    let bytes_per_px = size_of::<[f32; 4]>() * sheets.sheets.len();
    Need { bytes_per_px, block_px: TILE.1, ..Need::reaching(reach_px.ceil() as usize + beyond) }
}

/// The picture.
pub fn render(
    commands: &mut Commands,
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
) -> Result<wgpu::Buffer> {
    let Input { sheets, cells, .. } = *input;
    let size = sheets.size;
    let plan = Plan::new(sheets, optics, settings, input.supersample);
    cancel.check()?;
    let highlights_are_out = !plan.view_sets.is_empty();
    let (highlights, dimmed) = if highlights_are_out {
        extract(sheets, &plan.padding, plan.s_focus, simd)
    } else {
        (Vec::new(), Vec::new())
    };
    let highlights = Highlights::new(highlights, &plan.padding, &plan.tiles);
    let kernels = Kernels::new(sheets, &plan, &highlights, &settings.aperture, cancel)?;

    let clip = settings.barrel.map(|barrel| Clip::new(barrel, &settings.aperture));
    let picture = commands.output(size)?;
    let dim = colors::dim(commands, cells, &dimmed)?;
    copy(commands, input.picture, &plan, &picture)?;
    let frame = Frame { cells, codes: &sheets.codes, plan: &plan, clip: clip.as_ref(), picture: &picture };
    disc::pass(commands, &frame, &kernels, dim.buffer(cells))?;
    if highlights_are_out {
        let drawn = colors::drawn(commands, cells, &plan, dim.buffer(cells))?;
        sweep::pass(commands, &frame, &drawn)?;
    }
    highlights::pass(commands, &frame, kernels, &highlights, &settings.aperture)?;
    Ok(picture)
}

/// What the passes over tiles have in common.
pub(super) struct Frame<'a> {
    cells: &'a Cells,
    codes: &'a Codes,
    plan: &'a Plan,
    /// What the barrel hides, if anything.
    clip: Option<&'a Clip>,
    picture: &'a wgpu::Buffer,
}

/// Tiles in focus.
fn copy(commands: &mut Commands, picture: &Resident, plan: &Plan, out: &wgpu::Buffer) -> Result<()> {
    let copied = plan.tiles.iter().filter(|tile| tile.work == Work::Copy);
    let origins: Vec<[u32; 2]> = copied.map(|tile| origin(tile.origin)).collect();
    if origins.is_empty() {
        return Ok(());
    }
    let params = CopyParams { size: pixels(picture.size), layers: picture.layers as u32, _end: 0 };
    let tiles = commands.gpu.upload("the tiles in focus", &origins)?;
    let buffers = [Read(&picture.color), Read(&picture.disparity), Read(&tiles), Write(out)];
    commands.pass(&COPY, picture.size.channels, &params, &buffers, per_pixel(origins.len()))
}

/// The first pixel of a tile as shaders have it.
fn origin((x, y): (usize, usize)) -> [u32; 2] {
    [x as u32, y as u32]
}
