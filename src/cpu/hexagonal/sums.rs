//! What the look-ups of a pixel add up to.

use super::field::{Field, Near, Rest};
use super::lanes::{LANES, Lane, add, lane, lane_mut, parts, product, reduce, whole};
use super::reach::{Looks, Taps};
use crate::plan::hexagonal::Tap;
use crate::rows::{greater, lesser};

#[inline(always)]
fn look_up(at: usize, tap: Tap, stride: usize) -> usize {
    at.wrapping_add_signed(tap.dy as isize * stride as isize + tap.dx as isize)
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
pub struct PixelCoc {
    pub coc: Lane,
    least: f32,
    most: f32,
}

impl PixelCoc {
    #[inline(always)]
    pub fn new(coc: &Lane) -> PixelCoc {
        PixelCoc { coc: *coc, least: reduce(*coc, lesser), most: reduce(*coc, greater) }
    }
}

/// Light in front that reaches a pixel.
#[derive(Clone, Copy)]
pub struct NearSum<const C: usize> {
    pub color: [Lane; C],
    pub coverage: Lane,
    /// The largest circle of confusion among it.
    radius: Lane,
}

impl<const C: usize> NearSum<C> {
    pub const NONE: Self = NearSum { color: [[0.0; LANES]; C], coverage: [0.0; LANES], radius: [0.0; LANES] };

    /// Adds what comes along a line.
    #[inline(always)]
    pub fn add(&mut self, field: &Field, near: Near, taps: Taps, at: usize) {
        let values = &field.values;
        for &tap in taps.all {
            let from = look_up(at, tap, field.stride);
            self.add_step(field, near, from, &whole(tap), lane(values, near.radius + from));
        }
        for &tap in taps.some {
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
    pub fn store(&self, values: &mut [f32], area: usize, near: Near, at: usize) {
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
pub struct RestSum<const C: usize> {
    pub color: [Lane; C],
    pub seen: Lane,
}

impl<const C: usize> RestSum<C> {
    pub const NONE: Self = RestSum { color: [[0.0; LANES]; C], seen: [0.0; LANES] };

    /// Adds the mean of what is seen along a line.
    ///
    /// A pixel behind the focus sees what circles of confusion of less than twice its own bring; one in front looks
    /// behind itself as far as its own reaches; one in focus sees itself.
    #[inline(always)]
    pub fn add(&mut self, field: &Field, rest: Rest, looks: &Looks, at: usize, own: &PixelCoc) {
        let values = &field.values;
        let mut sum = Self::NONE;
        let mut total = [0.0; LANES];
        if own.most > 0.0 {
            for &tap in looks.behind.all {
                let from = look_up(at, tap, field.stride);
                let weight = product(&whole(tap), lane(values, field.inverse + from));
                add(&mut total, &weight);
                add_planes(&mut sum.color, values, rest.color + from, field.area, &weight);
            }
            for &tap in looks.behind.some {
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
        if own.least < 0.0 {
            for &tap in looks.through.all {
                sum.look(field, rest, look_up(at, tap, field.stride), &whole(tap), &mut total);
            }
            for &tap in looks.through.some {
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
    pub fn store(&self, values: &mut [f32], area: usize, rest: Rest, at: usize) {
        for c in 0..C {
            *lane_mut(values, rest.color + c * area + at) = self.color[c];
        }
        *lane_mut(values, rest.seen + at) = self.seen;
    }
}

/// One channel of a pixel before its layers are put together.
pub struct Layers {
    pub near: f32,
    pub coverage: f32,
    pub rest: f32,
    pub seen: f32,
    pub sharp: f32,
}

impl Layers {
    #[inline(always)]
    pub fn over(&self, coc: f32) -> f32 {
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
