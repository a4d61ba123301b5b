//! Carries out [`plan::poisson`](crate::plan::poisson).

use super::border::{BLOCK, Window, block};
use super::rows::{interleave, render_bands, with_channels};
use super::simd::{Simd, multiversion};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::poisson::{LeakTest, Plan, Settings, Tap};

/// Rows that are worked on at once, or as many as the margin has if that is more.
const BAND: usize = 16;

/// The picture, interleaved.
pub fn render(
    layer: &Layer,
    size: Size,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Vec<f32>> {
    let plan = Plan::new(settings, optics);
    // The colours, then disparity, then blurriness.
    let planes = Size { channels: size.channels + 2, ..size };
    let read = |plane: usize, y: usize, out: &mut [f32]| {
        let disparity = &layer.disparity[y * size.width..][..size.width];
        if plane < size.channels {
            out.copy_from_slice(&layer.color[plane * size.pixels() + y * size.width..][..size.width]);
        } else if plane == size.channels {
            out.copy_from_slice(disparity);
        } else {
            blurriness_row(simd, &plan, disparity, out);
        }
    };
    let band = BAND.max(plan.margin);
    render_bands(
        size,
        band,
        cancel,
        || Window::new(planes, band, plan.margin),
        |window, first, out| {
            let length = size.width * size.channels;
            window.fill(first, out.len() / length, read);
            for (i, out) in out.chunks_mut(length).enumerate() {
                with_channels!(size.channels, C => row::<C>(simd, &plan, window, first + i, out));
            }
        },
    )
}

multiversion! {
    /// The blurriness of a row.
    fn blurriness_row(plan: &Plan, disparity: &[f32], out: &mut [f32]) {
        for (blurriness, d) in out.iter_mut().zip(disparity) {
            *blurriness = plan.blurriness(*d);
        }
    }
}

/// What a tap counts under the leak test, before its own weight.
#[inline(always)]
fn contribution(centre_disparity: f32, tap_disparity: f32, tap_blurriness: f32) -> f32 {
    if tap_disparity > centre_disparity { tap_blurriness } else { 1.0 }
}

/// From `a` to `b`; exact where they are equal.
#[inline(always)]
fn mix(a: f32, b: f32, fraction: f32) -> f32 {
    a + fraction * (b - a)
}

/// A place as whole pixels and the fraction beyond them.
#[inline(always)]
fn split(x: f32) -> (i32, f32) {
    let towards_zero = x as i32;
    let floor = towards_zero - i32::from(x < towards_zero as f32);
    (floor, x - floor as f32)
}

/// Where one tap reads for each pixel of a block.
trait Places {
    /// The places of a tap for pixels from index `at` on, whose pattern is scaled by `scale_px`.
    fn new(tap: &Tap, scale_px: &[f32; BLOCK], at: usize, stride: usize) -> Self;
    /// Bilinear look-ups at them.
    fn read(&self, plane: &[f32], stride: usize) -> [f32; BLOCK];
}

/// The same place relative to every pixel, since all have one circle of confusion.
struct Shared {
    /// The upper left of the four neighbours of the first pixel's place.
    first: usize,
    right: f32,
    down: f32,
}

impl Places for Shared {
    #[inline(always)]
    fn new(tap: &Tap, scale_px: &[f32; BLOCK], at: usize, stride: usize) -> Shared {
        let ((left, right), (top, down)) = (split(tap.x * scale_px[0]), split(tap.y * scale_px[0]));
        let first = at.wrapping_add_signed(top as isize * stride as isize + left as isize);
        Shared { first, right, down }
    }

    #[inline(always)]
    fn read(&self, plane: &[f32], stride: usize) -> [f32; BLOCK] {
        let mut out = [0.0; BLOCK];
        let (a, b) = (block(plane, self.first), block(plane, self.first + 1));
        let (c, d) = (block(plane, self.first + stride), block(plane, self.first + stride + 1));
        for i in 0..BLOCK {
            out[i] = mix(mix(a[i], b[i], self.right), mix(c[i], d[i], self.right), self.down);
        }
        out
    }
}

/// A place of each pixel's own.
struct Own {
    /// The upper left of the four neighbours of each place.
    first: [i32; BLOCK],
    right: [f32; BLOCK],
    down: [f32; BLOCK],
}

impl Places for Own {
    #[inline(always)]
    fn new(tap: &Tap, scale_px: &[f32; BLOCK], at: usize, stride: usize) -> Own {
        let mut places = Own { first: [0; BLOCK], right: [0.0; BLOCK], down: [0.0; BLOCK] };
        for i in 0..BLOCK {
            let ((left, right), (top, down)) = (split(tap.x * scale_px[i]), split(tap.y * scale_px[i]));
            places.first[i] = at as i32 + i as i32 + top * stride as i32 + left;
            places.right[i] = right;
            places.down[i] = down;
        }
        places
    }

    #[inline(always)]
    fn read(&self, plane: &[f32], stride: usize) -> [f32; BLOCK] {
        let mut out = [0.0; BLOCK];
        for i in 0..BLOCK {
            // SAFETY: taps lie within one radius, and the radius is limited to two pixels less than the margin that
            // the window has around every block, so that a place's four neighbours lie inside the plane.
            let pixel = |step: usize| unsafe { *plane.as_ptr().add(step).offset(self.first[i] as isize) };
            let above = mix(pixel(0), pixel(1), self.right[i]);
            let below = mix(pixel(stride), pixel(stride + 1), self.right[i]);
            out[i] = mix(above, below, self.down[i]);
        }
        out
    }
}

/// The average over all taps for a block from index `at` on.
#[inline(always)]
fn average<const C: usize, P: Places>(
    plan: &Plan,
    window: &Window,
    at: usize,
    scale_px: &[f32; BLOCK],
) -> [[f32; BLOCK]; C] {
    let disparity = block(window.plane(C), at);
    let mut total = [plan.centre; BLOCK];
    let mut moved = [[0.0f32; BLOCK]; C];
    for tap in &plan.taps {
        let places = P::new(tap, scale_px, at, window.stride);
        let mut counts = [tap.weight; BLOCK];
        if plan.leak_test == LeakTest::On {
            let tap_disparity = places.read(window.plane(C), window.stride);
            let tap_blurriness = places.read(window.plane(C + 1), window.stride);
            for i in 0..BLOCK {
                counts[i] *= contribution(disparity[i], tap_disparity[i], tap_blurriness[i]);
            }
        }
        for i in 0..BLOCK {
            total[i] += counts[i];
        }
        for c in 0..C {
            let (centre, color) = (block(window.plane(c), at), places.read(window.plane(c), window.stride));
            for i in 0..BLOCK {
                moved[c][i] += counts[i] * (color[i] - centre[i]);
            }
        }
    }
    for c in 0..C {
        let centre = block(window.plane(c), at);
        for i in 0..BLOCK {
            // Where nothing counts at all the pixel keeps its colour.
            moved[c][i] = centre[i] + moved[c][i] / total[i].max(f32::MIN_POSITIVE);
        }
    }
    moved
}

/// By what the pattern is scaled around each pixel of a block.
#[inline(always)]
fn scales_px(plan: &Plan, disparity: &[f32; BLOCK]) -> [f32; BLOCK] {
    let mut out = [0.0; BLOCK];
    for i in 0..BLOCK {
        out[i] = plan.scale_px(disparity[i]);
    }
    out
}

/// The different values in a block, if they are few: for so many, a shared place each costs less than own places.
struct Values {
    found: [f32; 4],
    count: usize,
}

impl Values {
    #[inline(always)]
    fn of(block: &[f32; BLOCK]) -> Option<Values> {
        let mut values = Values { found: [block[0]; 4], count: 1 };
        if *block == [block[0]; BLOCK] {
            return Some(values);
        }
        for v in block {
            if !values.found[..values.count].contains(v) {
                *values.found.get_mut(values.count)? = *v;
                values.count += 1;
            }
        }
        Some(values)
    }
}

/// The colours of a block as they are.
#[inline(always)]
fn centre<const C: usize>(window: &Window, at: usize) -> [[f32; BLOCK]; C] {
    let mut out = [[0.0; BLOCK]; C];
    for c in 0..C {
        out[c] = *block(window.plane(c), at);
    }
    out
}

multiversion! {
    /// One row of the picture.
    fn row<const C: usize>(plan: &Plan, window: &Window, y: usize, out: &mut [f32]) {
        for (i, out) in out.chunks_mut(BLOCK * C).enumerate() {
            let at = window.index(i * BLOCK, y);
            let scale_px = scales_px(plan, block(window.plane(C), at));
            let mut blurred = [[0.0f32; BLOCK]; C];
            match Values::of(&scale_px) {
                Some(values) => {
                    for value in &values.found[..values.count] {
                        let shared = if *value == 0.0 {
                            centre::<C>(window, at)
                        } else {
                            average::<C, Shared>(plan, window, at, &[*value; BLOCK])
                        };
                        for c in 0..C {
                            for i in 0..BLOCK {
                                blurred[c][i] = if scale_px[i] == *value { shared[c][i] } else { blurred[c][i] };
                            }
                        }
                    }
                }
                None => blurred = average::<C, Own>(plan, window, at, &scale_px),
            }
            interleave(&blurred, out);
        }
    }
}
