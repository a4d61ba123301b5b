//! The sums over the taps of a pixel.

use super::field::{Field, Near, Rest};
use super::lanes::{LANES, Lane, add, lane, lane_mut, parts, product, reduce, whole};
use super::reach::{BlockTaps, Taps};
use crate::plan::hexagonal::Tap;
use crate::rows::{greater, lesser};

#[inline(always)]
fn look_up(at: usize, tap: Tap, stride: usize) -> usize {
    at.wrapping_add_signed(tap.dy as isize * stride as isize + tap.dx as isize)
}

/// Adds weighted light from several planes to sums.
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

/// The circles of confusion of the shaded pixels.
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
    /// The largest circle of confusion of that light.
    radius: Lane,
}

impl<const C: usize> NearSum<C> {
    pub const NONE: Self = NearSum { color: [[0.0; LANES]; C], coverage: [0.0; LANES], radius: [0.0; LANES] };

    /// Adds the light that arrives along a line.
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
            // A circle of confusion that does not reach the pixel is not passed on.
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

/// The light that a pixel receives from everything that is not in front.
#[derive(Clone, Copy)]
pub struct RestSum<const C: usize> {
    pub color: [Lane; C],
    pub seen: Lane,
}

impl<const C: usize> RestSum<C> {
    pub const NONE: Self = RestSum { color: [[0.0; LANES]; C], seen: [0.0; LANES] };

    /// Adds the mean of the visible light along a line.
    ///
    /// A pixel behind the focus receives light from circles of confusion smaller than twice its own. A pixel in front
    /// gathers the light behind itself as far as its own circle reaches. A pixel in focus shows itself.
    #[inline(always)]
    pub fn add(&mut self, field: &Field, rest: Rest, taps: &BlockTaps, at: usize, pixel: &PixelCoc) {
        let values = &field.values;
        let mut sum = Self::NONE;
        let mut total = [0.0; LANES];
        if pixel.most > 0.0 {
            for &tap in taps.behind.all {
                let from = look_up(at, tap, field.stride);
                let weight = product(&whole(tap), lane(values, field.inverse + from));
                add(&mut total, &weight);
                add_planes(&mut sum.color, values, rest.color + from, field.area, &weight);
            }
            for &tap in taps.behind.some {
                let from = look_up(at, tap, field.stride);
                let (coc, inverse) = (lane(values, field.coc + from), lane(values, field.inverse + from));
                let mut near_enough = [0.0; LANES];
                for i in 0..LANES {
                    near_enough[i] = if coc[i] < 2.0 * pixel.coc[i] { coc[i] } else { 0.0 };
                }
                let weight = product(&parts(tap, &near_enough), inverse);
                add(&mut total, &weight);
                add_planes(&mut sum.color, values, rest.color + from, field.area, &weight);
            }
        }
        if pixel.least < 0.0 {
            for &tap in taps.through.all {
                sum.add_step(field, rest, look_up(at, tap, field.stride), &whole(tap), &mut total);
            }
            for &tap in taps.through.some {
                let weight = parts(tap, &pixel.coc.map(|coc| -coc));
                sum.add_step(field, rest, look_up(at, tap, field.stride), &weight, &mut total);
            }
        }
        // A pixel that no light reaches shows itself.
        let (mut scale, mut alone) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            (scale[i], alone[i]) = if total[i] > 0.0 { (1.0 / total[i], 0.0) } else { (0.0, 1.0) };
        }
        let seen = lane(values, rest.seen + at);
        for i in 0..LANES {
            // A pixel behind the focus receives only light from behind the focus, which is as visible as the pixel
            // itself.
            self.seen[i] += if pixel.coc[i] < 0.0 { sum.seen[i] * scale[i] } else { seen[i] };
        }
        for c in 0..C {
            let color = lane(values, rest.color + c * field.area + at);
            for i in 0..LANES {
                self.color[c][i] += sum.color[c][i] * scale[i] + alone[i] * color[i];
            }
        }
    }

    /// Adds the light that a pixel in front finds behind itself at one tap.
    #[inline(always)]
    fn add_step(&mut self, field: &Field, rest: Rest, from: usize, weight: &Lane, total: &mut Lane) {
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

/// One channel of a pixel before its layers are composited.
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
        // A surface in front is as opaque as its coverage; the light that passes it is the visible light around it.
        let silhouette = (self.near + self.rest) / (self.coverage + self.seen);
        // Blurred and sharp colours are blended over the first pixel of the circle of confusion.
        let blend = if coc < 1.0 { coc } else { 1.0 };
        let behind = self.sharp + blend * (self.rest - self.sharp);
        let excess = if self.coverage > 1.0 { self.coverage } else { 1.0 };
        let shown = 1.0 - self.coverage / excess;
        if coc < 0.0 { silhouette } else { self.near / excess + shown * behind }
    }
}
