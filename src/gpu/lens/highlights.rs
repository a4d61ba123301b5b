//! Bright points.

use super::cells::Cells;
use super::kernels::Kernels;
use super::{origin, pixels};
use crate::cpu::lens::blocks::BLOCK;
use crate::cpu::lens::cells::Codes;
use crate::cpu::lens::highlights::Highlights;
use crate::cpu::lens::pack::TILE;
use crate::cpu::lens::plan::Plan;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::Commands;
use crate::gpu::device::Gpu;
use crate::gpu::shader::{Shader, shader, shared};
use std::sync::Arc;

pub const HIGHLIGHTS: Shader =
    shader!("lens/highlights", ["border", "lens/cells", "lens/kernels"], [HighlightsParams, Highlight, Tile]);

shared! {
    struct HighlightsParams {
        size: [u32; 2],
        padded: [u32; 2],
        pad: i32,
        block: i32,
        sheets: u32,
        tile_rows: u32,
        s_focus: f32,
        reach_px: f32,
        s_min: f32,
        step: f32,
    }
}

shared! {
    struct Highlight {
        light: [f32; 4],
        place: [i32; 2],
        t: f32,
        code: u32,
        kernel: u32,
        _end: [u32; 3],
    }
}

shared! {
    struct Tile {
        origin: [u32; 2],
        first: u32,
        count: u32,
    }
}

/// Adds all highlights to the picture.
#[expect(clippy::too_many_arguments, reason = "the scene, its plan, and what was made of both")]
pub fn pass(
    gpu: &Arc<Gpu>,
    commands: &mut Commands,
    cells: &Cells,
    codes: &Codes,
    plan: &Plan,
    kernels: &Kernels,
    highlights: &Highlights,
    out: &wgpu::Buffer,
) -> Result<()> {
    if highlights.all.is_empty() {
        return Ok(());
    }
    let pad = plan.padding.pad as i32;
    let mut lists: Vec<u32> = Vec::new();
    let mut tiles: Vec<Tile> = Vec::new();
    for (tile, list) in plan.tiles.iter().zip(&highlights.by_tile).filter(|(_, list)| !list.is_empty()) {
        let (first, count) = (lists.len() as u32, list.len() as u32);
        tiles.push(Tile { origin: origin(tile.origin), first, count });
        lists.extend(list);
    }
    let all: Vec<Highlight> = highlights
        .all
        .iter()
        .zip(&kernels.of_highlights)
        .map(|(highlight, &kernel)| Highlight {
            light: highlight.excess,
            place: [highlight.x - pad, highlight.y - pad],
            t: highlight.t as f32,
            code: codes.encode((highlight.t + plan.s_focus) as f32).into(),
            kernel: kernel as u32,
            _end: [0; 3],
        })
        .collect();
    let nearest: Vec<u32> = plan.blocks.range.iter().map(|(_, nearest)| u32::from(*nearest)).collect();
    let params = HighlightsParams {
        size: pixels(cells.size),
        padded: [plan.padding.stride as u32, plan.padding.rows as u32],
        pad,
        block: BLOCK as i32,
        sheets: cells.sheets as u32,
        tile_rows: TILE.1 as u32,
        s_focus: plan.s_focus as f32,
        reach_px: plan.reach_px as f32,
        s_min: codes.s_min as f32,
        step: codes.step() as f32,
    };
    let groups = [tiles.len() as u32, 1, 1];
    let words = gpu.upload("the discs", &kernels.words)?;
    let all = gpu.upload("the highlights", &all)?;
    let tiles = gpu.upload("the tiles with highlights", &tiles)?;
    let lists = gpu.upload("the highlights of tiles", &lists)?;
    let nearest = gpu.upload("the depths of blocks", &nearest)?;
    let buffers = [
        Read(&cells.codes),
        Read(&cells.half_planes),
        Read(&words),
        Read(&all),
        Read(&tiles),
        Read(&lists),
        Read(&nearest),
        Write(out),
    ];
    commands.pass(&HIGHLIGHTS, cells.size.channels, &params, &buffers, groups)
}
