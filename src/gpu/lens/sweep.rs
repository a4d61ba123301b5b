//! Tiles where visibility matters.

use super::cells::Cells;
use super::{origin, pixels};
use crate::cpu::lens::blocks::{BLOCK, DepthBits};
use crate::cpu::lens::cells::Codes;
use crate::cpu::lens::pack::TILE;
use crate::cpu::lens::plan::Plan;
use crate::cpu::lens::tiles::Work;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::Commands;
use crate::gpu::device::Gpu;
use crate::gpu::shader::{Shader, shader, shared};
use crate::views;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

pub const SWEEP: Shader = shader!("lens/sweep", ["border", "lens/cells"], [SweepParams, Tile, View, Stretch]);

/// Rows of a tile that one workgroup sweeps.
const ROWS: usize = 16;

shared! {
    struct SweepParams {
        size: [u32; 2],
        pad: u32,
        blocks_across: u32,
        block: u32,
        sheets: u32,
        missed: u32,
        _end: u32,
    }
}

shared! {
    struct Tile {
        origin: [u32; 2],
        first_view: u32,
        views: u32,
        occupied: [u32; 8],
    }
}

shared! {
    struct View {
        slope: [f32; 2],
        first: u32,
        end: u32,
    }
}

shared! {
    struct Stretch {
        cell: u32,
        codes: u32,
        base: [f32; 2],
    }
}

/// Depths as words of 32 bits.
fn words(bits: &DepthBits) -> [u32; 8] {
    std::array::from_fn(|i| (bits[i / 2] >> (32 * (i % 2))) as u32)
}

/// The stretches of a ray through all depths, near to far: while its shift stays within one pixel, it meets cells at one
/// and the same offset from the pixel that it starts from.
fn trace(codes: &Codes, s_focus: f64, view: &views::View) -> ([f32; 2], Vec<Stretch>) {
    // The ray's place as a function of the code: start + lens t, with t linear in the code.
    let t_at_0 = codes.decode(0.0) - s_focus;
    let slope = view.lens.map(|l| l * codes.step());
    let base = [0, 1].map(|i| view.start[i] + view.lens[i] * t_at_0);
    let (near, far) = (usize::from(u16::MAX), 1);
    let mut cell = [0, 1].map(|i| (base[i] + slope[i] * near as f64).round());
    let mut stretches = Vec::new();
    let mut to = near;
    while to > far {
        // The code at which the ray, going farther, leaves this column or row of cells.
        let leave = |i: usize| {
            if slope[i] == 0.0 {
                f64::NEG_INFINITY
            } else {
                (cell[i] - 0.5 * slope[i].signum() - base[i]) / slope[i]
            }
        };
        let (leave_x, leave_y) = (leave(0), leave(1));
        let leaves = leave_x.max(leave_y);
        let from = if leaves <= far as f64 { far } else { (leaves.round() as usize).clamp(far, to) };
        if from < to {
            let offset = cell.map(|v| (v as i16).cast_unsigned());
            stretches.push(Stretch {
                cell: u32::from(offset[0]) | u32::from(offset[1]) << 16,
                codes: from as u32 | (to as u32) << 16,
                base: [0, 1].map(|i| (base[i] - cell[i]) as f32),
            });
            to = from;
        }
        let step = if leave_x >= leave_y { 0 } else { 1 };
        cell[step] -= slope[step].signum();
    }
    (slope.map(|v| v as f32), stretches)
}

/// The ways of all views, and for each number of views the first one.
fn paths(codes: &Codes, plan: &Plan) -> (Vec<View>, Vec<Stretch>, BTreeMap<usize, u32>) {
    let (mut views, mut stretches, mut first_views) = (Vec::new(), Vec::new(), BTreeMap::new());
    for (&count, set) in &plan.view_sets {
        first_views.insert(count, views.len() as u32);
        let traced: Vec<_> = set.par_iter().map(|view| trace(codes, plan.s_focus, view)).collect();
        for (slope, way) in traced {
            let first = stretches.len() as u32;
            stretches.extend(way);
            views.push(View { slope, first, end: stretches.len() as u32 });
        }
    }
    (views, stretches, first_views)
}

/// Sweeps the tiles over the `drawn` colours.
pub fn pass(
    gpu: &Arc<Gpu>,
    commands: &mut Commands,
    cells: &Cells,
    codes: &Codes,
    plan: &Plan,
    drawn: &wgpu::Buffer,
    out: &wgpu::Buffer,
) -> Result<()> {
    let (views, stretches, first_views) = paths(codes, plan);
    let tile = |tile: &crate::cpu::lens::tiles::Tile| match &tile.work {
        Work::Sweep { views, occupied } => Some(Tile {
            origin: origin(tile.origin),
            first_view: first_views[views],
            views: *views as u32,
            occupied: words(occupied),
        }),
        Work::Copy | Work::Disc => None,
    };
    let tiles: Vec<Tile> = plan.tiles.iter().filter_map(tile).collect();
    let windows: Vec<[u32; 8]> = plan.blocks.windows().par_iter().map(words).collect();
    let params = SweepParams {
        size: pixels(cells.size),
        pad: plan.padding.pad as u32,
        blocks_across: plan.blocks.across as u32,
        block: BLOCK as u32,
        sheets: cells.sheets as u32,
        missed: plan.missed as u32,
        _end: 0,
    };
    let groups = [tiles.len() as u32, TILE.1.div_ceil(ROWS) as u32, 1];
    let views = gpu.upload("the views", &views)?;
    let stretches = gpu.upload("the ways of the views", &stretches)?;
    let tiles = gpu.upload("the tiles that are swept", &tiles)?;
    let windows = gpu.upload("the depths around tiles", &windows)?;
    let buffers = [
        Read(&cells.codes),
        Read(drawn),
        Read(&cells.half_planes),
        Read(&views),
        Read(&stretches),
        Read(&tiles),
        Read(&windows),
        Write(out),
    ];
    commands.pass(&SWEEP, cells.size.channels, &params, &buffers, groups)
}
