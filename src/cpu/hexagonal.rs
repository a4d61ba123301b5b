//! Carries out [`plan::hexagonal`](crate::plan::hexagonal), tile by tile.

use super::border::{mirrored, read_mirrored};
use super::rows::{greater, lesser, with_channels};
use super::simd::Simd;
use super::tiles::{self, Tile};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::hexagonal::{Line, Margin, Plan, Settings, Tap};
use rayon::prelude::*;

/// Pixels worked on at once.
const LANES: usize = 16;
/// Columns worked down at once.
const STRIP: usize = 16;
/// Columns and rows over which it is asked once how far light comes.
const BLOCK: (usize, usize) = (32, 8);

type Lane = [f32; LANES];

/// The picture, interleaved.
pub fn render(
    layer: &Layer,
    size: Size,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
    out: &mut [f32],
) -> Result<()> {
    let reach_px = optics.largest_radius_px(layer.disparity_range()).min(settings.max_coc_px) as f32;
    let frame = Frame { layer, size, optics, max_coc_px: settings.max_coc_px, tile: tile_size(reach_px) };
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

/// Larger blurs read more around a tile, so that larger tiles waste less.
fn tile_size(reach_px: f32) -> (usize, usize) {
    let side = (4.0 * reach_px) as usize;
    (side.clamp(256, 512), side.clamp(64, 256))
}

/// What is read from.
struct Frame<'a> {
    layer: &'a Layer,
    size: Size,
    optics: &'a Optics,
    /// Circles of confusion are cut at this radius.
    max_coc_px: f64,
    /// Columns and rows of a tile.
    tile: (usize, usize),
}

/// Signed radius of the circle of confusion at a disparity, cut at `most` pixels.
#[inline(always)]
fn coc(optics: &Optics, most: f64, disparity: f32) -> f32 {
    (-optics.shift_px(f64::from(disparity))).clamp(-most, most) as f32
}

/// The planes of light in front of the focus. Colour and coverage are divided by the radius of the circle of confusion,
/// so that what a step of a line receives is a multiple of them.
#[derive(Debug, Clone, Copy)]
struct Near {
    /// The first colour plane.
    color: usize,
    coverage: usize,
    /// 0 where there is no such light.
    radius: usize,
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
    /// Signed circles of confusion of the picture, and one over those behind the focus; 0 for the others.
    coc: usize,
    inverse: usize,
    values: Vec<f32>,
    /// A row of the picture.
    row: Vec<f32>,
    reach: Reach,
}

impl Field {
    fn new(plan: &Plan, frame: &Frame) -> Field {
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
            near: Near { color: take(channels), coverage: take(1), radius: take(1) },
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
            row: vec![0.0; stride],
            reach: Reach::default(),
        }
    }

    /// Index in every plane of the pixel at `(x, y)` from the tile's origin.
    fn index(&self, x: isize, y: isize) -> usize {
        self.before.0.wrapping_add_signed(x) + self.before.1.wrapping_add_signed(y) * self.stride
    }

    /// Reads a tile and its surroundings; beyond the border lies the picture's mirror image.
    fn read(&mut self, simd: Simd, frame: &Frame, origin: (usize, usize)) {
        let (size, area, stride) = (frame.size, self.area, self.stride);
        let left = origin.0 as i64 - self.before.0 as i64;
        for row in 0..area / stride {
            let y = origin.1 as i64 + row as i64 - self.before.1 as i64;
            let from = mirrored(y, size.height).0 * size.width;
            read_mirrored(&frame.layer.disparity[from..][..size.width], left, &mut self.row);
            simd.run(
                #[inline(always)]
                || circles(frame, &self.row, &mut self.values[self.coc + row * stride..][..stride]),
            );
        }
        self.reach = Reach::new(&self.values[self.coc..][..area], stride, simd);
        if self.reach.is_none() {
            return;
        }
        for row in 0..area / stride {
            let y = origin.1 as i64 + row as i64 - self.before.1 as i64;
            let from = mirrored(y, size.height).0 * size.width;
            simd.run(
                #[inline(always)]
                || measure(self, row * stride),
            );
            for c in 0..size.channels {
                let color = &frame.layer.color[c * size.pixels() + from..][..size.width];
                read_mirrored(color, left, &mut self.row);
                simd.run(
                    #[inline(always)]
                    || part_layers(self, row * stride, c),
                );
            }
        }
    }
}

/// Signed circles of confusion of a row.
#[inline(always)]
fn circles(frame: &Frame, disparity: &[f32], out: &mut [f32]) {
    // Copies, which the compiler knows that nothing in the loop changes.
    let (optics, most) = (*frame.optics, frame.max_coc_px);
    map(disparity, out, |d| coc(&optics, most, d));
}

/// What follows from the circles of confusion alone, for the row at index `at` of every plane.
#[inline(always)]
fn measure(field: &mut Field, at: usize) {
    let Planes { near, rest } = field.picture;
    let row = |plane: usize| plane + at..plane + at + field.stride;
    // The planes of circles of confusion are the last.
    let (planes, coc) = field.values.split_at_mut(field.coc);
    let (coc, inverse) = coc.split_at_mut(field.area);
    let coc = &coc[row(0)];
    map(coc, &mut inverse[row(0)], |coc| if coc > 0.0 { 1.0 / coc } else { 0.0 });
    map(coc, &mut planes[row(near.coverage)], |coc| if coc < 0.0 { -1.0 / coc } else { 0.0 });
    map(coc, &mut planes[row(near.radius)], |coc| if coc < 0.0 { -coc } else { 0.0 });
    map(coc, &mut planes[row(rest.seen)], |coc| if coc < 0.0 { 0.0 } else { 1.0 });
}

/// Parts the colours of a row in front from the others.
#[inline(always)]
fn part_layers(field: &mut Field, at: usize, c: usize) {
    let Planes { near, rest } = field.picture;
    let row = |plane: usize| plane + at..plane + at + field.stride;
    let (planes, coc) = field.values.split_at_mut(field.coc);
    let pixels = || field.row.iter().zip(&coc[row(0)]);
    for (out, (color, coc)) in planes[row(near.color + c * field.area)].iter_mut().zip(pixels()) {
        *out = if *coc < 0.0 { -color / coc } else { 0.0 };
    }
    for (out, (color, coc)) in planes[row(rest.color + c * field.area)].iter_mut().zip(pixels()) {
        *out = if *coc < 0.0 { 0.0 } else { *color };
    }
}

/// Fills a row with what each value of another one gives.
#[inline(always)]
fn map(values: &[f32], out: &mut [f32], of: impl Fn(f32) -> f32) {
    for (out, v) in out.iter_mut().zip(values) {
        *out = of(*v);
    }
}

/// The radii of some circles of confusion; of none, the least is the greater.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    least: f32,
    most: f32,
}

impl Span {
    const NONE: Span = Span { least: f32::INFINITY, most: 0.0 };

    #[inline(always)]
    fn with(self, other: Span) -> Span {
        Span { least: self.least.min(other.least), most: self.most.max(other.most) }
    }
}

/// The circles of confusion of a block's pixels, or of all that its look-ups meet.
#[derive(Debug, Clone, Copy)]
struct Circles {
    in_front: Span,
    behind: Span,
    /// Whether some are not in front.
    open: bool,
}

impl Circles {
    const NONE: Circles = Circles { in_front: Span::NONE, behind: Span::NONE, open: false };

    #[inline(always)]
    fn add(&mut self, coc: &Lane) {
        let none = [Span::NONE.least; LANES];
        let (mut in_front, mut behind) = ((none, [0.0; LANES]), (none, [0.0; LANES]));
        for i in 0..LANES {
            in_front.0[i] = if coc[i] < 0.0 { -coc[i] } else { none[i] };
        }
        for i in 0..LANES {
            in_front.1[i] = if coc[i] < 0.0 { -coc[i] } else { 0.0 };
        }
        for i in 0..LANES {
            behind.0[i] = if coc[i] > 0.0 { coc[i] } else { none[i] };
        }
        for i in 0..LANES {
            behind.1[i] = if coc[i] > 0.0 { coc[i] } else { 0.0 };
        }
        let span = |of: (Lane, Lane)| Span { least: reduce(of.0, lesser), most: reduce(of.1, greater) };
        self.in_front = self.in_front.with(span(in_front));
        self.behind = self.behind.with(span(behind));
        self.open |= reduce(*coc, greater) >= 0.0;
    }
}

/// What light may come to the pixels of each block, in both passes.
#[derive(Default)]
struct Reach {
    across: usize,
    blocks: Vec<Circles>,
}

impl Reach {
    fn new(coc: &[f32], stride: usize, simd: Simd) -> Reach {
        let (across, down) = (stride.div_ceil(BLOCK.0), (coc.len() / stride).div_ceil(BLOCK.1));
        let mut own = vec![Circles::NONE; across * down];
        for (y, row) in coc.chunks(stride).enumerate() {
            for (own, coc) in own[y / BLOCK.1 * across..].iter_mut().zip(row.chunks(BLOCK.0)) {
                simd.run(
                    #[inline(always)]
                    || coc.chunks_exact(LANES).for_each(|coc| own.add(lane(coc, 0))),
                );
            }
        }
        let largest = own.iter().fold(Circles::NONE, |all, own| Circles {
            in_front: all.in_front.with(own.in_front),
            behind: all.behind.with(own.behind),
            open: all.open || own.open,
        });
        // Blocks that hold anything within some distance of block `i`.
        let around = |i: usize, px: f32| {
            let blocks = |side: usize| (px as usize + 1).div_ceil(side);
            let (x, y, rx, ry) = (i % across, i / across, blocks(BLOCK.0), blocks(BLOCK.1));
            let (left, right) = (x.saturating_sub(rx), (x + rx + 1).min(across));
            (y.saturating_sub(ry)..(y + ry + 1).min(down))
                .flat_map(move |y| y * across + left..y * across + right)
        };
        let mut blocks = vec![Circles::NONE; own.len()];
        for (i, own) in own.iter().enumerate().filter(|(_, own)| own.in_front.most > 0.0) {
            for near in around(i, 2.0 * own.in_front.most) {
                blocks[near].in_front.most = blocks[near].in_front.most.max(own.in_front.most);
            }
        }
        for (i, block) in blocks.iter_mut().enumerate() {
            // Look-ups go as far as the largest gets, and meet smaller ones on the way.
            if block.in_front.most > 0.0 {
                let met = around(i, 2.0 * block.in_front.most).map(|j| own[j].in_front.least);
                block.in_front.least = met.fold(f32::INFINITY, f32::min);
            }
            // Behind the focus, light comes from circles of confusion of up to twice a pixel's own.
            if own[i].behind.most > 0.0 {
                let px = (2.0 * own[i].behind.most).min(largest.behind.most);
                block.behind = around(i, px).fold(Span::NONE, |all, j| all.with(own[j].behind));
            }
            // A pixel in front looks behind itself, and finds there what others in front have seen behind themselves.
            if own[i].in_front.most > 0.0 {
                block.open = around(i, own[i].in_front.most + largest.in_front.most).any(|j| own[j].open);
            }
        }
        Reach { across, blocks }
    }

    /// Whether there is nothing but what is in focus.
    fn is_none(&self) -> bool {
        self.blocks.iter().all(|block| block.in_front.most == 0.0 && block.behind.most == 0.0)
    }

    /// What comes to index `at` of a plane.
    #[inline(always)]
    fn of(&self, at: usize, stride: usize) -> Circles {
        self.blocks[at / stride / BLOCK.1 * self.across + at % stride / BLOCK.0]
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

/// How much of a step of a line circles of confusion reach, times the step's share.
#[inline(always)]
fn parts(tap: Tap, radius: &Lane) -> Lane {
    let mut reached = *radius;
    for i in 0..LANES {
        reached[i] -= tap.from_px;
    }
    for i in 0..LANES {
        reached[i] = greater(0.0, reached[i]);
    }
    for i in 0..LANES {
        reached[i] = lesser(tap.step_px, reached[i]);
    }
    for i in 0..LANES {
        reached[i] *= tap.share;
    }
    reached
}

/// The same where all of it is reached.
#[inline(always)]
fn whole(tap: Tap) -> Lane {
    [tap.share * tap.step_px; LANES]
}

// One operation a loop: of loops that do more at once the compiler leaves some lanes out of its vectors.
#[inline(always)]
fn product(a: &Lane, b: &Lane) -> Lane {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = a[i] * b[i];
    }
    out
}

#[inline(always)]
fn add(sum: &mut Lane, v: &Lane) {
    for i in 0..LANES {
        sum[i] += v[i];
    }
}

/// Adds some of the light of planes to sums.
#[inline(always)]
fn add_planes<const C: usize>(
    sums: &mut [Lane; C],
    values: &[f32],
    first: usize,
    area: usize,
    weight: &Lane,
) {
    for c in 0..C {
        add(&mut sums[c], &product(weight, lane(values, first + c * area)));
    }
}

/// The circles of confusion of the pixels that are shaded.
#[derive(Clone, Copy)]
struct Own {
    coc: Lane,
    least: f32,
    most: f32,
}

impl Own {
    #[inline(always)]
    fn new(coc: &Lane) -> Own {
        Own { coc: *coc, least: reduce(*coc, lesser), most: reduce(*coc, greater) }
    }
}

/// What `pick` leaves of a lane, by halves.
#[inline(always)]
fn reduce(mut values: Lane, pick: impl Fn(f32, f32) -> f32) -> f32 {
    let mut n = LANES / 2;
    while n > 0 {
        for i in 0..n {
            values[i] = pick(values[i], values[i + n]);
        }
        n /= 2;
    }
    values[0]
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

    /// Adds what comes along a line from circles of confusion of these radii.
    #[inline(always)]
    fn add(&mut self, field: &Field, near: Near, line: &Line, at: usize, radii: Span) {
        let values = &field.values;
        let (all, some) = line.split(radii.least, radii.most);
        for &tap in all {
            let from = look_up(at, tap, field.stride);
            self.add_step(field, near, from, &whole(tap), lane(values, near.radius + from));
        }
        for &tap in some {
            let from = look_up(at, tap, field.stride);
            let radius = lane(values, near.radius + from);
            let weight = parts(tap, radius);
            // What does not get there is not carried on.
            let mut carried = *radius;
            for i in 0..LANES {
                carried[i] = if carried[i] > tap.from_px { carried[i] } else { 0.0 };
            }
            self.add_step(field, near, from, &weight, &carried);
        }
    }

    #[inline(always)]
    fn add_step(&mut self, field: &Field, near: Near, from: usize, weight: &Lane, radius: &Lane) {
        let coverage = lane(&field.values, near.coverage + from);
        add(&mut self.coverage, &product(weight, coverage));
        for i in 0..LANES {
            self.radius[i] = if radius[i] > self.radius[i] { radius[i] } else { self.radius[i] };
        }
        add_planes(&mut self.color, &field.values, near.color + from, field.area, weight);
    }

    #[inline(always)]
    fn store(&self, values: &mut [f32], area: usize, near: Near, at: usize) {
        let mut inverse = [0.0; LANES];
        for i in 0..LANES {
            inverse[i] = if self.radius[i] > 0.0 { 1.0 / self.radius[i] } else { 0.0 };
        }
        *lane_mut(values, near.radius + at) = self.radius;
        let coverage = lane_mut(values, near.coverage + at);
        for i in 0..LANES {
            coverage[i] = self.coverage[i] * inverse[i];
        }
        for c in 0..C {
            let color = lane_mut(values, near.color + c * area + at);
            for i in 0..LANES {
                color[i] = self.color[c][i] * inverse[i];
            }
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
    fn add(&mut self, field: &Field, rest: Rest, line: &Line, at: usize, own: &Own, around: Circles) {
        let values = &field.values;
        let mut sum = Self::NONE;
        let mut total = [0.0; LANES];
        if own.most > 0.0 {
            // Where all pixels are behind the focus and no circle is too large for any, none need be asked.
            let known = if around.behind.most < 2.0 * own.least { around.behind.least } else { 0.0 };
            let (all, some) = line.split(known, around.behind.most.min(2.0 * own.most));
            for &tap in all {
                let from = look_up(at, tap, field.stride);
                let weight = product(&whole(tap), lane(values, field.inverse + from));
                add(&mut total, &weight);
                add_planes(&mut sum.color, values, rest.color + from, field.area, &weight);
            }
            for &tap in some {
                let from = look_up(at, tap, field.stride);
                let (coc, inverse) = (lane(values, field.coc + from), lane(values, field.inverse + from));
                let mut near_enough = [0.0; LANES];
                for i in 0..LANES {
                    near_enough[i] = if coc[i] < 2.0 * own.coc[i] { coc[i] } else { 0.0 };
                }
                let weight = product(&parts(tap, &near_enough), inverse);
                add(&mut total, &weight);
                add_planes(&mut sum.color, values, rest.color + from, field.area, &weight);
            }
        }
        if own.least < 0.0 && around.open {
            let (all, some) = line.split((-own.most).max(0.0), -own.least);
            for &tap in all {
                sum.look(field, rest, look_up(at, tap, field.stride), &whole(tap), &mut total);
            }
            for &tap in some {
                let weight = parts(tap, &own.coc.map(|coc| -coc));
                sum.look(field, rest, look_up(at, tap, field.stride), &weight, &mut total);
            }
        }
        // Where nothing reaches a pixel, it sees itself.
        let (mut scale, mut alone) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            (scale[i], alone[i]) = if total[i] > 0.0 { (1.0 / total[i], 0.0) } else { (0.0, 1.0) };
        }
        let seen = lane(values, rest.seen + at);
        for i in 0..LANES {
            // What is behind the focus sees nothing but that, which is seen as much as itself.
            self.seen[i] += if own.coc[i] < 0.0 { sum.seen[i] * scale[i] } else { seen[i] };
        }
        for c in 0..C {
            let color = lane(values, rest.color + c * field.area + at);
            for i in 0..LANES {
                self.color[c][i] += sum.color[c][i] * scale[i] + alone[i] * color[i];
            }
        }
    }

    /// Adds what a pixel in front sees behind itself at one place.
    #[inline(always)]
    fn look(&mut self, field: &Field, rest: Rest, from: usize, weight: &Lane, total: &mut Lane) {
        let seen = lane(&field.values, rest.seen + from);
        add(total, weight);
        add(&mut self.seen, &product(weight, seen));
        add_planes(&mut self.color, &field.values, rest.color + from, field.area, weight);
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
    let around = field.reach.of(at, field.stride);
    let own = Own::new(lane(&field.values, field.coc + at));
    let (mut near, mut rest) = (NearSum::<C>::NONE, RestSum::<C>::NONE);
    for (i, target) in plan.targets.iter().enumerate() {
        for line in &target.gathered {
            near.add(field, field.picture.near, line, at, around.in_front);
            rest.add(field, field.picture.rest, line, at, &own, around);
        }
        let planes = field.targets[i];
        near.store(&mut field.values, field.area, planes.near, at);
        rest.store(&mut field.values, field.area, planes.rest, at);
    }
}

/// Blurs and adds the targets, and lays the light in front over the rest.
#[inline(always)]
fn shade<const C: usize>(plan: &Plan, field: &Field, at: usize) -> [Lane; C] {
    let around = field.reach.of(at, field.stride);
    let own = Own::new(lane(&field.values, field.coc + at));
    let (mut near, mut rest) = (NearSum::<C>::NONE, RestSum::<C>::NONE);
    for (target, planes) in plan.targets.iter().zip(&field.targets) {
        for line in &target.spread {
            near.add(field, planes.near, line, at, around.in_front);
            rest.add(field, planes.rest, line, at, &own, around);
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
            out[c][i] = layers.over(own.coc[i]);
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

/// Both passes over one tile.
#[inline(always)]
fn shade_tile<const C: usize>(
    plan: &Plan,
    field: &mut Field,
    tile: &mut Tile,
    cancel: &Cancel,
) -> Result<()> {
    let (columns, rows) = (tile.rows[0].len() / C, tile.rows.len());
    let left = field.second.left.next_multiple_of(LANES);
    // Down narrow strips, whose surroundings stay in the first level of the cache.
    let end = left + columns + field.second.right;
    for strip in (0..end).step_by(STRIP) {
        cancel.check()?;
        for y in 0..rows + field.second.above + field.second.below {
            let first = field.index(-(left as isize), y as isize - field.second.above as isize);
            for x in (strip..end.min(strip + STRIP)).step_by(LANES) {
                gather::<C>(plan, field, first + x);
            }
        }
    }
    for strip in (0..columns).step_by(STRIP) {
        cancel.check()?;
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
    Ok(())
}
