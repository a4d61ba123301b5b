//! Tiles where visibility matters.

use super::{Frame, MAX_LOOPS, origin, pixels};
use crate::cpu::lens::Clip;
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
use crate::picture::Size;
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
        in_front: [f32; 2],
        behind: [f32; 2],
        first: u32,
        focus: u32,
        end: u32,
        columns: u32,
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
struct Way {
    /// Cells that the ray passes a unit of depth, in front of the focus and behind it.
    slopes: [[f32; 2]; 2],
    /// The stretches in front, then those behind.
    stretches: Vec<Stretch>,
    /// How many of them are in front.
    in_front: usize,
}

impl Way {
    fn new(codes: &Codes, s_focus: f64, view: &views::View) -> Way {
        let lines = [view.in_front, view.behind].map(|lens| Line::new(codes, s_focus, lens, view.start));
        let mut stretches = Vec::new();
        let mut follow = |line: &Line, near: usize, far: usize| {
            line.follow(near, far, |cell, from, to| {
                let offset = cell.map(|v| (v as i16).cast_unsigned());
                stretches.push(Stretch {
                    cell: u32::from(offset[0]) | u32::from(offset[1]) << 16,
                    codes: from as u32 | (to as u32) << 16,
                    base: line.base_from(cell),
                });
            });
            stretches.len()
        };
        let (nearest, farthest) = (usize::from(u16::MAX), 1);
        // At the focus all rays are where they start, so that one may go on as another.
        let one_ray = view.in_front == view.behind;
        let focus = if one_ray { farthest as f64 } else { codes.place(s_focus).round() };
        let focus = focus.clamp(farthest as f64, nearest as f64) as usize;
        let in_front = follow(&lines[0], nearest, focus);
        follow(&lines[1], focus, farthest);
        Way { slopes: lines.map(|line| line.slope.map(|v| v as f32)), stretches, in_front }
    }
}

/// The columns of each row of a frame that see a view: the first in the low half, and the one after the last. Rows are
/// filled up to whole words of four.
fn columns(clip: &Clip, view: &views::View, size: Size) -> Vec<u32> {
    let of_row = |y: usize| {
        let inside = |v: f64| v.clamp(0.0, size.width as f64) as u32;
        clip.columns(view.pupil, y).map_or(0, |[first, end]| inside(first) | inside(end) << 16)
    };
    (0..size.height.next_multiple_of(4)).map(of_row).collect()
}

/// The ways of all views.
struct Paths {
    /// Views, then stretches, then the columns that see each view.
    words: Vec<[u32; 4]>,
    /// For each number of views the first one.
    first_views: BTreeMap<usize, u32>,
    /// The most stretches that any view has.
    longest: usize,
}

impl Paths {
    fn new(codes: &Codes, plan: &Plan, clip: Option<&Clip>, size: Size) -> Paths {
        const OF_VIEW: usize = size_of::<View>() / size_of::<[u32; 4]>();
        let total = OF_VIEW * plan.view_sets.values().map(Vec::len).sum::<usize>();
        let (mut views, mut stretches) = (Vec::new(), Vec::new());
        let (mut first_views, mut longest) = (BTreeMap::new(), 0);
        for (&count, set) in &plan.view_sets {
            first_views.insert(count, views.len() as u32);
            let ways: Vec<_> = set.par_iter().map(|view| Way::new(codes, plan.s_focus, view)).collect();
            for Way { slopes: [in_front, behind], stretches: way, in_front: nearer } in ways {
                longest = longest.max(way.len());
                let first = (total + stretches.len()) as u32;
                let (focus, end) = (first + nearer as u32, first + way.len() as u32);
                stretches.extend(way);
                views.push(View { in_front, behind, first, focus, end, columns: 0 });
            }
        }
        let seen: Vec<Vec<u32>> = clip.map_or(Vec::new(), |clip| {
            let all: Vec<_> = plan.view_sets.values().flatten().collect();
            all.into_par_iter().map(|view| columns(clip, view, size)).collect()
        });
        let first_columns = total + stretches.len();
        for (i, (view, columns)) in views.iter_mut().zip(&seen).enumerate() {
            view.columns = (first_columns + i * columns.len() / 4) as u32;
        }
        let views = bytemuck::cast_slice::<View, [u32; 4]>(&views);
        let stretches = bytemuck::cast_slice::<Stretch, [u32; 4]>(&stretches);
        let seen = seen.concat();
        let seen = bytemuck::cast_slice::<u32, [u32; 4]>(&seen);
        Paths { words: [views, stretches, seen].concat(), first_views, longest }
    }
}

/// Sweeps the tiles over the `drawn` colours.
pub fn pass(commands: &mut Commands, frame: &Frame, drawn: &wgpu::Buffer) -> Result<()> {
    let Frame { cells, codes, plan, clip, picture } = *frame;
    let gpu = commands.gpu;
    let Paths { words: paths, first_views, longest } = Paths::new(codes, plan, clip, cells.size);
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
    let left_out = commands.scratch::<f32>("the views that do not count", cells.size.pixels())?;
    let buffers = [
        Read(&cells.codes),
        Read(drawn),
        Read(&cells.half_planes),
        Read(&paths),
        Read(&tiles),
        Read(&windows),
        Write(&left_out),
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
