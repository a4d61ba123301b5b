//! Carries out [`plan::taps`](crate::plan::taps).

use super::job::Job;
use super::padded_rows::{BLOCK, PaddedRows, block};
use crate::error::Result;
use crate::picture::Size;
use crate::plan::taps::{Mix, Plan, Settings, Tap};
use crate::rows::{interleave, render_bands, with_channels};

/// Rows that one task processes.
const BAND: usize = 16;

/// Renders the picture, interleaved, into `out`.
pub fn render(job: &Job, settings: &Settings, out: &mut [f32]) -> Result<()> {
    let Job { front: layer, size, optics, simd, cancel } = *job;
    let plan = Plan::new(settings, optics);
    // The colours, and the blur factor as the last plane.
    let planes = Size { channels: size.channels + 1, ..size };
    let read = |plane: usize, y: usize, out: &mut [f32]| {
        if plane < size.channels {
            out.copy_from_slice(&layer.color[plane * size.pixels() + y * size.width..][..size.width]);
        } else {
            simd.run(
                #[inline(always)]
                || blur_row(&plan, &layer.disparity[y * size.width..][..size.width], out),
            );
        }
    };
    let scratch = || PaddedRows::new(planes, BAND, plan.margin);
    render_bands(out, size, BAND, cancel, scratch, |window, first, out| {
        let length = size.width * size.channels;
        window.fill(first, out.len() / length, read);
        for (i, out) in out.chunks_mut(length).enumerate() {
            with_channels!(size.channels, C => simd.run(#[inline(always)] || row::<C>(&plan, window, first + i, out)));
        }
    })
}

/// The blur factors of a row.
#[inline(always)]
fn blur_row(plan: &Plan, disparity: &[f32], out: &mut [f32]) {
    for (blur, d) in out.iter_mut().zip(disparity) {
        *blur = plan.blur(*d);
    }
}

/// The weights of a look-up.
#[inline(always)]
fn weights(mix: Mix, centre_blur: &[f32; BLOCK], tap_blur: &[f32; BLOCK]) -> [f32; BLOCK] {
    let mut out = *centre_blur;
    if mix == Mix::Both {
        for i in 0..BLOCK {
            out[i] = centre_blur[i] * tap_blur[i];
        }
    }
    out
}

/// A block of one plane at the offset of a look-up.
#[inline(always)]
fn look_up(plane: &[f32], stride: usize, at: usize, tap: &Tap) -> [f32; BLOCK] {
    let mut out = [0.0; BLOCK];
    for &(dx, dy, weight) in &tap.pixels {
        let pixels =
            block::<BLOCK>(plane, at.wrapping_add_signed(dy as isize * stride as isize + dx as isize));
        for i in 0..BLOCK {
            out[i] += weight * pixels[i];
        }
    }
    out
}

/// One row of the picture.
#[inline(always)]
fn row<const C: usize>(plan: &Plan, window: &PaddedRows, y: usize, out: &mut [f32]) {
    for (i, out) in out.chunks_mut(BLOCK * C).enumerate() {
        let at = window.index(i * BLOCK, y);
        let centre: [[f32; BLOCK]; C] = window.blocks(at);
        let centre_blur = block::<BLOCK>(window.plane(C), at);
        if *centre_blur == [0.0; BLOCK] {
            interleave(centre.each_ref(), out);
            continue;
        }
        let mut sum = [[0.0f32; BLOCK]; C];
        for tap in &plan.taps {
            let tap_blur = look_up(window.plane(C), window.stride, at, tap);
            let weights = weights(plan.mix, centre_blur, &tap_blur);
            for c in 0..C {
                let color = look_up(window.plane(c), window.stride, at, tap);
                for x in 0..BLOCK {
                    sum[c][x] += weights[x] * (color[x] - centre[c][x]);
                }
            }
        }
        for c in 0..C {
            for x in 0..BLOCK {
                sum[c][x] = centre[c][x] + plan.share * sum[c][x];
            }
        }
        interleave(sum.each_ref(), out);
    }
}
