//! Carries out [`plan::hexagonal`](crate::plan::hexagonal), tile by tile.

use super::border::mirrored;
use super::rows::with_channels;
use super::simd::{Simd, multiversion};
use super::tiles::{self, Tile};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::hexagonal::{Margin, Plan, Settings, Tap};
use rayon::prelude::*;

/// Pixels worked on at once.
const LANES: usize = 8;
/// Columns worked down at once.
const STRIP: usize = 64;
/// Columns and rows over which it is asked once how far light comes.
const BLOCK: (usize, usize) = (64, 8);

type Lane = [f32; LANES];

/// The picture, interleaved.
pub fn render(
    layer: &Layer,
    size: Size,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Vec<f32>> {
    let coc =
        |d: f32| (-optics.shift_px(f64::from(d))).clamp(-settings.max_coc_px, settings.max_coc_px) as f32;
    let reach_px = layer.disparity.par_iter().map(|&d| coc(d).abs()).reduce(|| 0.0, f32::max);
    let plan = Plan::new(settings, f64::from(reach_px));
    let frame = Frame { layer, size, coc, tile: tile_size(reach_px) };
    let mut out = vec![0.0f32; size.pixels() * size.channels];
    tiles::split(&mut out, size, frame.tile).par_iter_mut().try_for_each_init(
        || Field::new(&plan, &frame),
        |field, tile| {
            cancel.check()?;
            field.read(&frame, tile.origin);
            with_channels!(size.channels, C => {
                if field.reach.is_none() {
                    copy_tile::<C>(layer, size, tile);
                } else {
                    shade_tile::<C>(simd.narrow(), &plan, field, tile);
                }
            });
            Ok(())
        },
    )?;
    Ok(out)
}

/// Larger blurs read more around a tile, so that larger tiles waste less.
fn tile_size(reach_px: f32) -> (usize, usize) {
    let side = (4.0 * reach_px) as usize;
    (side.clamp(256, 512), side.clamp(64, 256))
}

/// What is read from.
struct Frame<'a, F> {
    layer: &'a Layer,
    size: Size,
    /// Signed radius of the circle of confusion at a disparity.
    coc: F,
    /// Columns and rows of a tile.
    tile: (usize, usize),
}

/// The planes of light in front of the focus: its colour times coverage, and its circles of confusion.
#[derive(Debug, Clone, Copy)]
struct Near {
    /// The first colour plane.
    color: usize,
    coverage: usize,
    radius: usize,
    /// One over the radius; 0 where there is no such light.
    inverse: usize,
}

/// The planes of what is not in front: its colour times the part of it that is seen, and that part.
#[derive(Debug, Clone, Copy)]
struct Rest {
    /// The first colour plane.
    color: usize,
    seen: usize,
}

/// The picture, or a target of the first pass.
#[derive(Debug, Clone, Copy)]
struct Planes {
    near: Near,
    rest: Rest,
}

/// A tile and its surroundings: the picture and the targets of the first pass, in planes of one layout.
struct Field {
    /// Columns left of the tile and rows above it.
    before: (usize, usize),
    /// Pixels around the tile that the second pass reads.
    second: Margin,
    stride: usize,
    /// Values of a plane.
    area: usize,
    /// The planes, as indices of their first values.
    picture: Planes,
    targets: Vec<Planes>,
    /// Signed circles of confusion of the picture, and one over their sizes.
    coc: usize,
    inverse: usize,
    values: Vec<f32>,
    reach: Reach,
}

impl Field {
    fn new<F>(plan: &Plan, frame: &Frame<F>) -> Field {
        let (second, both) = plan.margins();
        // Lanes start at multiples of their number, and overhang.
        let before = (both.left.next_multiple_of(LANES) + LANES, both.above);
        let stride = (before.0 + frame.tile.0 + both.right + LANES).next_multiple_of(LANES);
        let area = stride * (before.1 + frame.tile.1 + both.below);
        let channels = frame.size.channels;
        let mut used = 0;
        let mut take = |planes: usize| {
            used += planes;
            (used - planes) * area
        };
        let mut planes = || Planes {
            near: Near { color: take(channels), coverage: take(1), radius: take(1), inverse: take(1) },
            rest: Rest { color: take(channels), seen: take(1) },
        };
        let picture = planes();
        let targets = plan.targets.iter().map(|_| planes()).collect();
        let (coc, inverse) = (take(1), take(1));
        Field {
            before,
            second,
            stride,
            area,
            picture,
            targets,
            coc,
            inverse,
            values: vec![0.0; take(0)],
            reach: Reach::default(),
        }
    }

    /// Index in every plane of the pixel at `(x, y)` from the tile's origin.
    fn index(&self, x: isize, y: isize) -> usize {
        self.before.0.wrapping_add_signed(x) + self.before.1.wrapping_add_signed(y) * self.stride
    }

    /// Reads a tile and its surroundings; beyond the border lies the picture's mirror image.
    fn read<F: Fn(f32) -> f32>(&mut self, frame: &Frame<F>, origin: (usize, usize)) {
        let (size, area) = (frame.size, self.area);
        let beyond = |i: usize, start: usize, before: usize, n: usize| {
            mirrored((start + i) as i64 - before as i64, n).0
        };
        let columns: Vec<usize> =
            (0..self.stride).map(|i| beyond(i, origin.0, self.before.0, size.width)).collect();
        let Planes { near, rest } = self.picture;
        for (row, to) in (0..area).step_by(self.stride).enumerate() {
            let from = beyond(row, origin.1, self.before.1, size.height) * size.width;
            let disparity = &frame.layer.disparity[from..][..size.width];
            let coc: Vec<f32> = columns.iter().map(|&x| (frame.coc)(disparity[x])).collect();
            let values = &mut self.values;
            let mut fill = |plane: usize, value: &dyn Fn(usize) -> f32| {
                let row = &mut values[plane + to..][..coc.len()];
                row.iter_mut().enumerate().for_each(|(i, out)| *out = value(i));
            };
            let in_front = |i: usize| if coc[i] < 0.0 { 1.0 } else { 0.0 };
            let inverse = |i: usize| if coc[i] == 0.0 { 0.0 } else { 1.0 / coc[i].abs() };
            fill(self.coc, &|i| coc[i]);
            fill(self.inverse, &inverse);
            fill(near.coverage, &in_front);
            fill(near.radius, &|i| if coc[i] < 0.0 { -coc[i] } else { 0.0 });
            fill(near.inverse, &|i| in_front(i) * inverse(i));
            fill(rest.seen, &|i| 1.0 - in_front(i));
            for c in 0..size.channels {
                let color = &frame.layer.color[c * size.pixels() + from..][..size.width];
                fill(near.color + c * area, &|i| if coc[i] < 0.0 { color[columns[i]] } else { 0.0 });
                fill(rest.color + c * area, &|i| if coc[i] < 0.0 { 0.0 } else { color[columns[i]] });
            }
        }
        self.reach = Reach::new(&self.values[self.coc..][..area], self.stride);
    }
}

/// How far light comes, block by block.
#[derive(Default)]
struct Reach {
    across: usize,
    /// Radius of the largest circle of confusion in front from which light may get into a block in two passes.
    near: Vec<f32>,
    /// Distance beyond which no pixel of a block looks for anything else.
    rest: Vec<f32>,
}

impl Reach {
    fn new(coc: &[f32], stride: usize) -> Reach {
        let (across, down) = (stride.div_ceil(BLOCK.0), (coc.len() / stride).div_ceil(BLOCK.1));
        let (mut in_front, mut rest) = (vec![0.0f32; across * down], vec![0.0f32; across * down]);
        let mut largest = 0.0f32;
        for (y, row) in coc.chunks(stride).enumerate() {
            for (x, &c) in row.iter().enumerate() {
                let block = y / BLOCK.1 * across + x / BLOCK.0;
                in_front[block] = in_front[block].max(-c);
                // Behind the focus, light comes from circles of confusion of up to twice a pixel's own.
                rest[block] = rest[block].max(if c > 0.0 { 2.0 * c } else { -c });
                largest = largest.max(c.abs());
            }
        }
        rest.iter_mut().for_each(|r| *r = r.min(largest));
        let mut near = vec![0.0f32; across * down];
        for (block, &radius) in in_front.iter().enumerate().filter(|(_, radius)| **radius > 0.0) {
            let blocks = |side: usize| ((2.0 * radius + 1.0) as usize).div_ceil(side);
            let (x, y, rx, ry) = (block % across, block / across, blocks(BLOCK.0), blocks(BLOCK.1));
            for row in near.chunks_mut(across).take(y + ry + 1).skip(y.saturating_sub(ry)) {
                for near in row.iter_mut().take(x + rx + 1).skip(x.saturating_sub(rx)) {
                    *near = near.max(radius);
                }
            }
        }
        Reach { across, near, rest }
    }

    /// Whether there is nothing but what is in focus.
    fn is_none(&self) -> bool {
        self.near.iter().chain(&self.rest).all(|reach| *reach == 0.0)
    }

    /// The reach of light in front and of the rest at index `at` of a plane.
    fn of(&self, at: usize, stride: usize) -> (f32, f32) {
        let block = at / stride / BLOCK.1 * self.across + at % stride / BLOCK.0;
        (self.near[block], self.rest[block])
    }
}

#[inline(always)]
fn lane(plane: &[f32], at: usize) -> &Lane {
    debug_assert!(at + LANES <= plane.len());
    // SAFETY: a field's margins are the plan's own, which hold every look-up from its tile, and lanes that overhang.
    unsafe { &*plane.as_ptr().add(at).cast::<Lane>() }
}

#[inline(always)]
fn lane_mut(plane: &mut [f32], at: usize) -> &mut Lane {
    plane[at..].first_chunk_mut().expect("the surroundings hold whole lanes")
}

#[inline(always)]
fn look_up(at: usize, tap: Tap, stride: usize) -> usize {
    at.wrapping_add_signed(tap.dy as isize * stride as isize + tap.dx as isize)
}

/// The part of the light of a circle of confusion that a step of a line receives.
#[inline(always)]
fn part(tap: Tap, radius: f32, inverse: f32) -> f32 {
    let beyond = radius - tap.from_px;
    let reached = if beyond > 0.0 { beyond } else { 0.0 };
    let reached = if reached < tap.step_px { reached } else { tap.step_px };
    tap.share * reached * inverse
}

/// Light in front that reaches a pixel.
#[derive(Clone, Copy)]
struct NearSum<const C: usize> {
    color: [Lane; C],
    coverage: Lane,
    /// The largest circle of confusion among it.
    radius: Lane,
}

impl<const C: usize> NearSum<C> {
    const NONE: Self = NearSum { color: [[0.0; LANES]; C], coverage: [0.0; LANES], radius: [0.0; LANES] };

    /// Adds what comes along a line.
    #[inline(always)]
    fn add(&mut self, field: &Field, near: Near, line: &[Tap], at: usize, reach: f32) {
        let values = &field.values;
        for &tap in line.iter().take_while(|tap| tap.from_px < reach) {
            let from = look_up(at, tap, field.stride);
            let (radius, inverse) = (*lane(values, near.radius + from), *lane(values, near.inverse + from));
            let coverage = lane(values, near.coverage + from);
            let mut weight = [0.0; LANES];
            for i in 0..LANES {
                weight[i] = part(tap, radius[i], inverse[i]);
                self.coverage[i] += weight[i] * coverage[i];
                let carried = if weight[i] > 0.0 { radius[i] } else { 0.0 };
                self.radius[i] = if carried > self.radius[i] { carried } else { self.radius[i] };
            }
            for c in 0..C {
                let color = lane(values, near.color + c * field.area + from);
                for i in 0..LANES {
                    self.color[c][i] += weight[i] * color[i];
                }
            }
        }
    }

    #[inline(always)]
    fn store(&self, values: &mut [f32], area: usize, near: Near, at: usize) {
        for c in 0..C {
            *lane_mut(values, near.color + c * area + at) = self.color[c];
        }
        *lane_mut(values, near.coverage + at) = self.coverage;
        *lane_mut(values, near.radius + at) = self.radius;
        let inverse = lane_mut(values, near.inverse + at);
        for i in 0..LANES {
            inverse[i] = if self.radius[i] > 0.0 { 1.0 / self.radius[i] } else { 0.0 };
        }
    }
}

/// What a pixel sees that is not in front.
#[derive(Clone, Copy)]
struct RestSum<const C: usize> {
    color: [Lane; C],
    seen: Lane,
}

impl<const C: usize> RestSum<C> {
    const NONE: Self = RestSum { color: [[0.0; LANES]; C], seen: [0.0; LANES] };

    /// Adds the mean of what is seen along a line.
    ///
    /// A pixel behind the focus sees what circles of confusion of less than twice its own bring; one in front looks
    /// behind itself as far as its own reaches; one in focus sees itself.
    #[inline(always)]
    fn add(&mut self, field: &Field, rest: Rest, line: &[Tap], at: usize, reach: f32) {
        let values = &field.values;
        let (own_coc, own_inverse) = (*lane(values, field.coc + at), *lane(values, field.inverse + at));
        let mut sum = Self::NONE;
        let mut total = [0.0; LANES];
        for &tap in line.iter().take_while(|tap| tap.from_px < reach) {
            let from = look_up(at, tap, field.stride);
            let (coc, inverse) = (*lane(values, field.coc + from), *lane(values, field.inverse + from));
            let seen = lane(values, rest.seen + from);
            let mut weight = [0.0; LANES];
            for i in 0..LANES {
                let near_enough = if coc[i] < 2.0 * own_coc[i] { coc[i] } else { 0.0 };
                // Of the two, only one is not zero: a negative radius has no part.
                weight[i] = part(tap, near_enough, inverse[i]) + part(tap, -own_coc[i], own_inverse[i]);
                total[i] += weight[i];
                sum.seen[i] += weight[i] * seen[i];
            }
            for c in 0..C {
                let color = lane(values, rest.color + c * field.area + from);
                for i in 0..LANES {
                    sum.color[c][i] += weight[i] * color[i];
                }
            }
        }
        // Where nothing reaches a pixel, it sees itself.
        let (mut scale, mut own) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            (scale[i], own[i]) = if total[i] > 0.0 { (1.0 / total[i], 0.0) } else { (0.0, 1.0) };
        }
        let seen = lane(values, rest.seen + at);
        for i in 0..LANES {
            self.seen[i] += sum.seen[i] * scale[i] + own[i] * seen[i];
        }
        for c in 0..C {
            let color = lane(values, rest.color + c * field.area + at);
            for i in 0..LANES {
                self.color[c][i] += sum.color[c][i] * scale[i] + own[i] * color[i];
            }
        }
    }

    #[inline(always)]
    fn store(&self, values: &mut [f32], area: usize, rest: Rest, at: usize) {
        for c in 0..C {
            *lane_mut(values, rest.color + c * area + at) = self.color[c];
        }
        *lane_mut(values, rest.seen + at) = self.seen;
    }
}

/// Fills the targets of the first pass at the lanes from `at` on.
#[inline(always)]
fn gather<const C: usize>(plan: &Plan, field: &mut Field, at: usize) {
    let (near_reach, rest_reach) = field.reach.of(at, field.stride);
    let (mut near, mut rest) = (NearSum::<C>::NONE, RestSum::<C>::NONE);
    for (i, target) in plan.targets.iter().enumerate() {
        for line in &target.gathered {
            near.add(field, field.picture.near, line, at, near_reach);
            rest.add(field, field.picture.rest, line, at, rest_reach);
        }
        let planes = field.targets[i];
        near.store(&mut field.values, field.area, planes.near, at);
        rest.store(&mut field.values, field.area, planes.rest, at);
    }
}

/// Blurs and adds the targets, and lays the light in front over the rest.
#[inline(always)]
fn shade<const C: usize>(plan: &Plan, field: &Field, at: usize) -> [Lane; C] {
    let (near_reach, rest_reach) = field.reach.of(at, field.stride);
    let (mut near, mut rest) = (NearSum::<C>::NONE, RestSum::<C>::NONE);
    for (target, planes) in plan.targets.iter().zip(&field.targets) {
        for line in &target.spread {
            near.add(field, planes.near, line, at, near_reach);
            rest.add(field, planes.rest, line, at, rest_reach);
        }
    }
    let coc = lane(&field.values, field.coc + at);
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
            out[c][i] = layers.over(coc[i]);
        }
    }
    out
}

/// One channel of a pixel before its layers are put together.
struct Layers {
    near: f32,
    coverage: f32,
    rest: f32,
    seen: f32,
    sharp: f32,
}

impl Layers {
    #[inline(always)]
    fn over(&self, coc: f32) -> f32 {
        // A surface in front is as opaque as it is there, and what it lets past is what is seen around it.
        let silhouette = (self.near + self.rest) / (self.coverage + self.seen);
        // Blurred and sharp are blended over the first pixel of the circle of confusion.
        let blend = if coc < 1.0 { coc } else { 1.0 };
        let behind = self.sharp + blend * (self.rest - self.sharp);
        let excess = if self.coverage > 1.0 { self.coverage } else { 1.0 };
        let shown = 1.0 - self.coverage / excess;
        if coc < 0.0 { silhouette } else { self.near / excess + shown * behind }
    }
}

/// A tile in focus.
fn copy_tile<const C: usize>(layer: &Layer, size: Size, tile: &mut Tile) {
    for (y, row) in tile.rows.iter_mut().enumerate() {
        let from = (tile.origin.1 + y) * size.width + tile.origin.0;
        for (x, pixel) in row.chunks_exact_mut(C).enumerate() {
            for c in 0..C {
                pixel[c] = layer.color[c * size.pixels() + from + x];
            }
        }
    }
}

multiversion! {
    /// Both passes over one tile.
    fn shade_tile<const C: usize>(plan: &Plan, field: &mut Field, tile: &mut Tile) {
        let (columns, rows) = (tile.rows[0].len() / C, tile.rows.len());
        let left = field.second.left.next_multiple_of(LANES);
        // Down narrow strips, whose surroundings stay in the first level of the cache.
        let end = left + columns + field.second.right;
        for strip in (0..end).step_by(STRIP) {
            for y in 0..rows + field.second.above + field.second.below {
                let first = field.index(-(left as isize), y as isize - field.second.above as isize);
                for x in (strip..end.min(strip + STRIP)).step_by(LANES) {
                    gather::<C>(plan, field, first + x);
                }
            }
        }
        for strip in (0..columns).step_by(STRIP) {
            for (y, row) in tile.rows.iter_mut().enumerate() {
                let out = &mut row[strip * C..columns.min(strip + STRIP) * C];
                for (i, out) in out.chunks_mut(LANES * C).enumerate() {
                    let at = field.index((strip + i * LANES) as isize, y as isize);
                    let colors = shade::<C>(plan, field, at);
                    for (x, pixel) in out.chunks_exact_mut(C).enumerate() {
                        for c in 0..C {
                            pixel[c] = colors[c][x];
                        }
                    }
                }
            }
        }
    }
}
