//! Carries out [`plan::taps`](crate::plan::taps).

use super::border::{BLOCK, Padded};
use super::rows::{interleave, render_rows, with_channels};
use super::simd::{Simd, multiversion};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::taps::{Mix, Plan, Settings, Tap};

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
    // The colours, and the blur factor as the last plane.
    let planes = Size { channels: size.channels + 1, ..size };
    let padded = Padded::new(planes, plan.margin, |plane, y, out| {
        if plane < size.channels {
            out.copy_from_slice(&layer.color[plane * size.pixels() + y * size.width..][..size.width]);
        } else {
            let disparity = &layer.disparity[y * size.width..][..size.width];
            out.iter_mut().zip(disparity).for_each(|(blur, d)| *blur = plan.blur(*d));
        }
    });
    let scratch = || ();
    with_channels!(size.channels, C => {
        render_rows(size, cancel, scratch, |(), y, out| row::<C>(simd, &plan, &padded, y, out))
    })
}

/// The weight of a look-up.
#[inline(always)]
fn weight(mix: Mix, centre_blur: f32, tap_blur: f32) -> f32 {
    match mix {
        Mix::Both => centre_blur * tap_blur,
        Mix::Centre => centre_blur,
    }
}

/// A block of one plane from index `at` on.
#[inline(always)]
fn block(plane: &[f32], at: usize) -> &[f32; BLOCK] {
    plane[at..].first_chunk().expect("padded rows hold whole blocks")
}

/// A block of one plane as a look-up sees it.
#[inline(always)]
fn look_up(plane: &[f32], stride: usize, at: usize, tap: &Tap) -> [f32; BLOCK] {
    let mut out = [0.0; BLOCK];
    for &(dx, dy, weight) in &tap.pixels {
        let pixels = block(plane, at.wrapping_add_signed(dy as isize * stride as isize + dx as isize));
        for i in 0..BLOCK {
            out[i] += weight * pixels[i];
        }
    }
    out
}

multiversion! {
    /// One row of the picture.
    fn row<const C: usize>(plan: &Plan, padded: &Padded, y: usize, out: &mut [f32]) {
        for (i, out) in out.chunks_mut(BLOCK * C).enumerate() {
            let at = padded.index(i * BLOCK, y);
            let centre_blur = block(padded.plane(C), at);
            let mut sum = [[0.0f32; BLOCK]; C];
            for tap in &plan.taps {
                let tap_blur = look_up(padded.plane(C), padded.stride, at, tap);
                for c in 0..C {
                    let centre = block(padded.plane(c), at);
                    let color = look_up(padded.plane(c), padded.stride, at, tap);
                    for x in 0..BLOCK {
                        sum[c][x] += weight(plan.mix, centre_blur[x], tap_blur[x]) * (color[x] - centre[x]);
                    }
                }
            }
            for c in 0..C {
                let centre = block(padded.plane(c), at);
                for x in 0..BLOCK {
                    sum[c][x] = centre[x] + plan.share * sum[c][x];
                }
            }
            interleave(&sum, out);
        }
    }
}
