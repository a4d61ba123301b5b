//! Carries out [`cpu::lens::plan`](crate::cpu::lens::plan).
//!
//! The sheets stay on the device; a focus costs what the plan takes. [`colors`] makes the cells' colours ready for it,
//! then each tile is a [`copy`](self), an exact [`disc`] or a [`sweep`], and [`highlights`] are laid over them.

mod cells;
pub(super) mod colors;
pub(super) mod disc;
pub(super) mod highlights;
mod kernels;
pub(super) mod sweep;

pub use cells::Cells;

use super::commands::Bound::{Read, Write};
use super::commands::{Commands, Pending};
use super::device::Gpu;
use super::resident::Resident;
use super::shader::{Shader, shader, shared};
use crate::cancel::Cancel;
use crate::cpu::lens::highlights::{Highlights, extract};
use crate::cpu::lens::pack::TILE;
use crate::cpu::lens::plan::Plan;
use crate::cpu::lens::tiles::Work;
use crate::cpu::lens::{Settings, Sheets};
use crate::cpu::simd::Simd;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::Size;
use kernels::Kernels;
use std::sync::Arc;

pub const COPY: Shader = shader!("lens/copy", ["border", "picture"], [CopyParams]);

shared! {
    /// Of tiles that are copied.
    struct CopyParams {
        size: [u32; 2],
        layers: u32,
        tile_rows: u32,
    }
}

/// The size of a frame as shaders have it.
fn pixels(size: Size) -> [u32; 2] {
    [size.width as u32, size.height as u32]
}

/// What is rendered.
pub struct Input<'a> {
    pub picture: &'a Resident,
    pub sheets: &'a Sheets,
    pub cells: &'a Cells,
    /// As [`cpu::lens::render`](crate::cpu::lens::render) takes it.
    pub supersample: usize,
}

/// Begins to compute the picture.
pub fn start(
    gpu: &Arc<Gpu>,
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Pending> {
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
    let kernels = Kernels::new(sheets, &plan, &highlights, &settings.aperture);
    cancel.check()?;

    let out = gpu.output(size)?;
    let mut commands = Commands::new(gpu);
    let dim = colors::dim(gpu, &mut commands, cells, &dimmed)?;
    copy(gpu, &mut commands, input.picture, &plan, &out)?;
    disc::pass(gpu, &mut commands, cells, &plan, &kernels, dim.buffer(cells), &out)?;
    if highlights_are_out {
        let drawn = colors::drawn(gpu, &mut commands, cells, &plan, dim.buffer(cells))?;
        sweep::pass(gpu, &mut commands, cells, &sheets.codes, &plan, &drawn, &out)?;
    }
    highlights::pass(gpu, &mut commands, cells, &sheets.codes, &plan, &kernels, &highlights, &out)?;
    commands.submit(&out, size.pixels() * size.channels)
}

/// Tiles in focus.
fn copy(
    gpu: &Arc<Gpu>,
    commands: &mut Commands,
    picture: &Resident,
    plan: &Plan,
    out: &wgpu::Buffer,
) -> Result<()> {
    let copied = plan.tiles.iter().filter(|tile| tile.work == Work::Copy);
    let origins: Vec<[u32; 2]> = copied.map(|tile| origin(tile.origin)).collect();
    if origins.is_empty() {
        return Ok(());
    }
    let params =
        CopyParams { size: pixels(picture.size), layers: picture.layers as u32, tile_rows: TILE.1 as u32 };
    let tiles = gpu.upload("the tiles in focus", &origins)?;
    let buffers = [Read(&picture.color), Read(&picture.disparity), Read(&tiles), Write(out)];
    commands.pass(&COPY, picture.size.channels, &params, &buffers, [origins.len() as u32, 1, 1])
}

/// The first pixel of a tile as shaders have it.
fn origin((x, y): (usize, usize)) -> [u32; 2] {
    [x as u32, y as u32]
}
