//! Tiles where visibility matters.

use super::{Frame, MAX_LOOPS, origin, pixels};
use crate::cpu::lens::blocks::{BLOCK, DepthBits};
use crate::cpu::lens::cells::Codes;
use crate::cpu::lens::line::Line;
use crate::cpu::lens::pack::TILE;
use crate::cpu::lens::plan::Plan;
use crate::cpu::lens::tiles::Work;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::Commands;
use crate::gpu::shader::{Shader, shader, shared};
use crate::views;
use rayon::prelude::*;
use std::collections::BTreeMap;

pub const SWEEP: Shader = shader!("lens/sweep", ["border", "lens/cells"], [SweepParams, Tile, View, Stretch]);

/// Rows of a tile that one workgroup sweeps.
const ROWS: usize = 16;
/// Views whose stretches a workgroup looks at together.
const BATCH: usize = 64;
/// Stretches of a view that hold cells near a tile, more or less.
const FOLLOWED: usize = 20;

shared! {
    struct SweepParams {
        size: [u32; 2],
        pad: u32,
        blocks_across: u32,
        block: u32,
        sheets: u32,
        missed: u32,
        first_view: u32,
        end_view: u32,
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
fn depth_words(bits: &DepthBits) -> [u32; 8] {
    std::array::from_fn(|i| (bits[i / 2] >> (32 * (i % 2))) as u32)
}

/// The stretches of a ray through all depths, near to far: while its shift stays within one pixel, it meets cells at one
/// and the same offset from the pixel that it starts from.
fn trace(codes: &Codes, s_focus: f64, view: &views::View) -> ([f32; 2], Vec<Stretch>) {
    let line = Line::new(codes, s_focus, view.in_front, view.start);
    let mut stretches = Vec::new();
    line.follow(usize::from(u16::MAX), 1, |cell, from, to| {
        let offset = cell.map(|v| (v as i16).cast_unsigned());
        stretches.push(Stretch {
            cell: u32::from(offset[0]) | u32::from(offset[1]) << 16,
            codes: from as u32 | (to as u32) << 16,
            base: line.base_from(cell),
        });
    });
    (line.slope.map(|v| v as f32), stretches)
}

/// The ways of all views.
struct Paths {
    /// Views, then stretches.
    words: Vec<[u32; 4]>,
    /// For each number of views the first one.
    first_views: BTreeMap<usize, u32>,
    /// The most stretches that any view has.
    longest: usize,
}

impl Paths {
    fn new(codes: &Codes, plan: &Plan) -> Paths {
        let total = plan.view_sets.values().map(Vec::len).sum::<usize>();
        let (mut views, mut stretches) = (Vec::with_capacity(total), Vec::new());
        let (mut first_views, mut longest) = (BTreeMap::new(), 0);
        for (&count, set) in &plan.view_sets {
            first_views.insert(count, views.len() as u32);
            let traced: Vec<_> = set.par_iter().map(|view| trace(codes, plan.s_focus, view)).collect();
            for (slope, way) in traced {
                longest = longest.max(way.len());
                let first = (total + stretches.len()) as u32;
                let end = first + way.len() as u32;
                stretches.extend(way);
                views.push(View { slope, first, end });
            }
        }
        let views = bytemuck::cast_slice::<View, [u32; 4]>(&views);
        let stretches = bytemuck::cast_slice::<Stretch, [u32; 4]>(&stretches);
        Paths { words: [views, stretches].concat(), first_views, longest }
    }
}

/// Sweeps the tiles over the `drawn` colours.
pub fn pass(commands: &mut Commands, frame: &Frame, drawn: &wgpu::Buffer) -> Result<()> {
    let Frame { cells, codes, plan, picture } = *frame;
    let gpu = commands.gpu;
    let Paths { words: paths, first_views, longest } = Paths::new(codes, plan);
    let tile = |tile: &crate::cpu::lens::tiles::Tile| match &tile.work {
        Work::Sweep { views, occupied } => Some(Tile {
            origin: origin(tile.origin),
            first_view: first_views[views],
            views: *views as u32,
            occupied: depth_words(occupied),
        }),
        Work::Copy | Work::Disc => None,
    };
    let tiles: Vec<Tile> = plan.tiles.iter().filter_map(tile).collect();
    let windows: Vec<[u32; 8]> = plan.blocks.windows().par_iter().map(depth_words).collect();
    let params = SweepParams {
        size: pixels(cells.size),
        pad: plan.padding.pad as u32,
        blocks_across: plan.blocks.across as u32,
        block: BLOCK as u32,
        sheets: cells.sheets as u32,
        missed: plan.missed as u32,
        first_view: 0,
        end_view: 0,
        _end: 0,
    };
    let groups = [tiles.len() as u32, TILE.1.div_ceil(ROWS) as u32, 1];
    let paths = gpu.upload("the ways of the views", &paths)?;
    let tiles = gpu.upload("the tiles that are swept", &tiles)?;
    let windows = gpu.upload("the depths around tiles", &windows)?;
    let missed = commands.scratch::<f32>("the views that met nothing", cells.size.pixels())?;
    let buffers = [
        Read(&cells.codes),
        Read(drawn),
        Read(&cells.half_planes),
        Read(&paths),
        Read(&tiles),
        Read(&windows),
        Write(&missed),
        Write(picture),
    ];
    // An invocation looks at all stretches of one view of each batch, and follows all its views.
    let loops_a_batch = longest * (2 + 2 * cells.sheets) + BATCH * FOLLOWED * (1 + cells.sheets);
    let at_once = (MAX_LOOPS / loops_a_batch).max(1) * BATCH;
    let most = plan.view_sets.keys().copied().max().unwrap_or(0);
    for first_view in (0..most).step_by(at_once) {
        let params =
            SweepParams { first_view: first_view as u32, end_view: (first_view + at_once) as u32, ..params };
        commands.pass(&SWEEP, cells.size.channels, &params, &buffers, groups)?;
    }
    Ok(())
}
