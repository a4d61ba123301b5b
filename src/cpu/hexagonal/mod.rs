//! Carries out [`plan::hexagonal`](crate::plan::hexagonal), tile by tile.

mod field;
mod lanes;
mod reach;
mod sums;

use super::tiles::{self, Tile};
use crate::cancel::Cancel;
use crate::cpu::job::Job;
use crate::error::Result;
use crate::picture::{Layer, Size};
use crate::plan::hexagonal::{Line, Plan, Settings, Target};
use crate::rows::{interleave, with_channels};
use field::{Field, Source};
use lanes::{LANES, Lane, lane};
use rayon::prelude::*;
use reach::{BLOCK, BlockTaps, Reach};
use std::ops::Range;
use sums::{Layers, NearSum, PixelCoc, RestSum};

/// Renders the picture, interleaved, into `out`.
pub fn render(job: &Job, settings: &Settings, out: &mut [f32]) -> Result<()> {
    let Job { front: layer, size, optics, simd, cancel } = *job;
    let reach_px = optics.largest_radius_px(layer.disparity_range()).min(settings.max_coc_px) as f32;
    let frame = Source { layer, size, optics, max_coc_px: settings.max_coc_px, tile: tile_size(reach_px) };
    let plan = Plan::new(settings, f64::from(reach_px));
    tiles::split(out, size, frame.tile).par_iter_mut().try_for_each_init(
        || Field::new(&plan, &frame),
        |field, tile| {
            cancel.check()?;
            field.read(simd, &frame, tile.origin);
            with_channels!(size.channels, C => {
                if field.reach.is_none() {
                    copy_tile::<C>(layer, size, tile);
                } else {
                    simd.run(#[inline(always)] || shade_tile::<C>(&plan, field, tile, cancel))?;
                }
            });
            Ok(())
        },
    )
}

/// Tile size. A larger blur reads more around a tile, so larger tiles then waste less.
fn tile_size(reach_px: f32) -> (usize, usize) {
    let side = (4.0 * reach_px) as usize;
    (side.clamp(256, 512), side.clamp(64, 256))
}

/// One of the two passes, with its lines in the order of the targets.
struct Pass<'a> {
    number: usize,
    lines: Vec<&'a Line>,
}

impl<'a> Pass<'a> {
    fn new(plan: &'a Plan, number: usize, of: impl Fn(&Target) -> &Vec<Line>) -> Pass<'a> {
        Pass { number, lines: plan.targets.iter().flat_map(of).collect() }
    }

    /// The taps along each line that the pixels of a block read.
    fn taps(&self, reach: &Reach, block: usize) -> Vec<BlockTaps<'a>> {
        let lines = self.lines.iter().enumerate();
        lines.map(|(i, line)| reach.taps(self.number, i, line, block)).collect()
    }
}

/// Fills the targets of the first pass, for the lanes starting at `at`.
#[inline(always)]
fn gather<const C: usize>(plan: &Plan, field: &mut Field, taps: &[BlockTaps], at: usize) {
    let pixel = PixelCoc::new(lane(&field.values, field.coc + at));
    let (mut near, mut rest) = (NearSum::<C>::NONE, RestSum::<C>::NONE);
    let mut taps = taps.iter();
    for (i, target) in plan.targets.iter().enumerate() {
        for taps in taps.by_ref().take(target.gathered.len()) {
            near.add(field, field.picture.near, taps.near, at);
            rest.add(field, field.picture.rest, taps, at, &pixel);
        }
        let planes = field.targets[i];
        near.store(&mut field.values, field.area, planes.near, at);
        rest.store(&mut field.values, field.area, planes.rest, at);
    }
}

/// Blurs and adds the targets, and composites the light in front over the rest.
#[inline(always)]
fn shade<const C: usize>(plan: &Plan, field: &Field, taps: &[BlockTaps], at: usize) -> [Lane; C] {
    let pixel = PixelCoc::new(lane(&field.values, field.coc + at));
    let (mut near, mut rest) = (NearSum::<C>::NONE, RestSum::<C>::NONE);
    let mut taps = taps.iter();
    for (target, planes) in plan.targets.iter().zip(&field.targets) {
        for taps in taps.by_ref().take(target.spread.len()) {
            near.add(field, planes.near, taps.near, at);
            rest.add(field, planes.rest, taps, at, &pixel);
        }
    }
    let mut out = [[0.0; LANES]; C];
    for c in 0..C {
        let sharp = lane(&field.values, field.picture.rest.color + c * field.area + at);
        for i in 0..LANES {
            let layers = Layers {
                near: near.color[c][i] * plan.scale,
                coverage: near.coverage[i] * plan.scale,
                rest: rest.color[c][i] * plan.scale,
                seen: rest.seen[i] * plan.scale,
                sharp: sharp[i],
            };
            out[c][i] = layers.over(pixel.coc[i]);
        }
    }
    out
}

/// Copies a tile that is in focus.
fn copy_tile<const C: usize>(layer: &Layer, size: Size, tile: &mut Tile) {
    for (y, row) in tile.rows.iter_mut().enumerate() {
        let from = (tile.origin.1 + y) * size.width + tile.origin.0;
        let planes: [&[f32]; C] = std::array::from_fn(|c| &layer.color[c * size.pixels() + from..]);
        interleave(planes, row);
    }
}

/// Runs both passes over one tile.
#[inline(always)]
fn shade_tile<const C: usize>(
    plan: &Plan,
    field: &mut Field,
    tile: &mut Tile,
    cancel: &Cancel,
) -> Result<()> {
    let (columns, rows) = (tile.rows[0].len() / C, tile.rows.len());
    let (before, second, stride) = (field.before, field.second, field.stride);
    // The tile is processed in strips as wide as the lanes, whose surroundings stay in the first-level cache.
    let gathered = Pass::new(plan, 0, |target| &target.gathered);
    let left = second.left.next_multiple_of(LANES);
    for x in (before.0 - left..before.0 + columns + second.right).step_by(LANES) {
        cancel.check()?;
        for block in blocks(before.1 - second.above..before.1 + rows + second.below) {
            let taps = gathered.taps(&field.reach, field.reach.block(x, block.start));
            for y in block {
                gather::<C>(plan, field, &taps, y * stride + x);
            }
        }
    }
    let spread = Pass::new(plan, 1, |target| &target.spread);
    for x in (0..columns).step_by(LANES) {
        cancel.check()?;
        for block in blocks(before.1..before.1 + rows) {
            let taps = spread.taps(&field.reach, field.reach.block(before.0 + x, block.start));
            for y in block {
                let colors = shade::<C>(plan, field, &taps, y * stride + before.0 + x);
                let out = &mut tile.rows[y - before.1][x * C..columns.min(x + LANES) * C];
                interleave(colors.each_ref(), out);
            }
        }
    }
    Ok(())
}

/// Splits rows at the boundaries of blocks.
fn blocks(rows: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let first = rows.start / BLOCK.1..rows.end.div_ceil(BLOCK.1);
    first.map(move |b| (b * BLOCK.1).max(rows.start)..((b + 1) * BLOCK.1).min(rows.end))
}
