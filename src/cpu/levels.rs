//! Carries out [`plan::levels`](crate::plan::levels).

use super::enlarge::Enlarge;
use super::job::Job;
use crate::error::Result;
use crate::memory::Buffer;
use crate::mirror::mirrored;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::levels::{KEPT, Plan, STEPS, Settings};
use crate::rows::{render_rows, with_channels};
use crate::simd::Simd;
use rayon::prelude::*;

/// Renders the picture, interleaved, into `out`.
pub fn render(job: &Job, settings: &Settings, out: &mut [f32]) -> Result<()> {
    let Job { front: layer, size, optics, simd, cancel } = *job;
    let plan = Plan::new(settings, optics.largest_radius_px(layer.disparity_range()));

    let small =
        Size { width: size.width.div_ceil(plan.scale), height: size.height.div_ceil(plan.scale), ..size };
    let blurred = |planes: &[f32], steps: usize| -> Result<Buffer<f32>> {
        cancel.check()?;
        let mut planes = filter(planes, small, plan.weights, simd);
        for _ in 1..steps {
            cancel.check()?;
            planes = filter(&planes, small, plan.weights, simd);
        }
        Ok(planes)
    };
    let half_way = blurred(&reduce(&layer.color, size, small, plan.scale, simd), KEPT)?;
    let last = blurred(&half_way, STEPS - KEPT)?;
    let scratch = || Scratch::new(size, small, plan.scale);
    with_channels!(size.channels, C => {
        render_rows(out, size, cancel, scratch, |scratch, y, out| {
            let disparity = &layer.disparity[y * size.width..][..size.width];
            simd.run(#[inline(always)] || levels(&plan, optics, disparity, &mut scratch.level));
            scratch.enlarge(simd, y, small, &half_way, &last);
            let sharp = std::array::from_fn(|c| &layer.color[c * size.pixels() + y * size.width..][..size.width]);
            simd.run(#[inline(always)] || interpolate::<C>(&sharp, scratch, out));
        })
    })
}

/// Radius of the circle of confusion at a disparity.
#[inline(always)]
fn radius(optics: &Optics, d: f32) -> f32 {
    optics.shift_px(f64::from(d)).abs() as f32
}

/// The positions of the pixels of a row between the targets.
#[inline(always)]
fn levels(plan: &Plan, optics: &Optics, disparity: &[f32], out: &mut [f32]) {
    for (level, d) in out.iter_mut().zip(disparity) {
        *level = plan.level(radius(optics, *d));
    }
}

/// Planes of the means of blocks; the picture is mirrored at the border.
fn reduce(color: &[f32], size: Size, small: Size, scale: usize, simd: Simd) -> Buffer<f32> {
    let mut out = Buffer::unset(small.pixels() * small.channels);
    out.par_chunks_mut(small.width).enumerate().for_each_init(
        || vec![0.0f32; small.width * scale],
        |sums, (i, out)| {
            let (plane, y) = (i / small.height, i % small.height * scale);
            sums.fill(0.0);
            for y in y..y + scale {
                let from = plane * size.pixels() + mirrored(y as i64, size.height).0 * size.width;
                simd.run(
                    #[inline(always)]
                    || accumulate(&color[from..][..size.width], sums),
                );
            }
            for x in size.width..sums.len() {
                sums[x] = sums[mirrored(x as i64, size.width).0];
            }
            let mean = 1.0 / (scale * scale) as f32;
            for (out, block) in out.iter_mut().zip(sums.chunks_exact(scale)) {
                *out = mean * block.iter().sum::<f32>();
            }
        },
    );
    out
}

/// Adds one row to another.
#[inline(always)]
fn accumulate(row: &[f32], sums: &mut [f32]) {
    for (sum, v) in sums.iter_mut().zip(row) {
        *sum += v;
    }
}

/// One filter step along both axes of all planes.
fn filter(planes: &[f32], size: Size, weights: [f32; 3], simd: Simd) -> Buffer<f32> {
    let mut out = Buffer::unset(planes.len());
    out.par_chunks_mut(size.width).enumerate().for_each_init(
        || vec![0.0f32; size.width + 4],
        |column, (i, out)| {
            let (plane, y) = (i / size.height, (i % size.height) as i64);
            let row = |dy: i64| {
                let row = plane * size.height + mirrored(y + dy, size.height).0;
                &planes[row * size.width..][..size.width]
            };
            simd.run(
                #[inline(always)]
                || down(weights, [-2, -1, 0, 1, 2].map(row), &mut column[2..]),
            );
            // The row is mirrored at its ends.
            for i in [0, 1, size.width + 2, size.width + 3] {
                column[i] = column[2 + mirrored(i as i64 - 2, size.width).0];
            }
            simd.run(
                #[inline(always)]
                || across(weights, column, out),
            );
        },
    );
    out
}

/// Filters five values of a row.
#[inline(always)]
fn step([middle, beside, beyond]: [f32; 3], v: [f32; 5]) -> f32 {
    middle * v[2] + beside * (v[1] + v[3]) + beyond * (v[0] + v[4])
}

/// Filters five rows along y into the middle row.
#[inline(always)]
fn down(weights: [f32; 3], rows: [&[f32]; 5], out: &mut [f32]) {
    let rows = rows.map(|row| &row[..rows[0].len()]);
    for (x, out) in out[..rows[0].len()].iter_mut().enumerate() {
        *out = step(weights, [rows[0][x], rows[1][x], rows[2][x], rows[3][x], rows[4][x]]);
    }
}

/// Filters a row, which has two more pixels at either end, along x.
#[inline(always)]
fn across(weights: [f32; 3], row: &[f32], out: &mut [f32]) {
    for (out, v) in out.iter_mut().zip(row.windows(5)) {
        *out = step(weights, [v[0], v[1], v[2], v[3], v[4]]);
    }
}

/// The scratch rows of one worker.
struct Scratch {
    enlarge: Enlarge,
    /// The position of each pixel between the targets.
    level: Vec<f32>,
    /// For each channel, a row of a target at full size.
    half_way: Vec<Vec<f32>>,
    last: Vec<Vec<f32>>,
}

impl Scratch {
    fn new(size: Size, small: Size, scale: usize) -> Scratch {
        let enlarge = Enlarge::new(scale, small.width);
        let rows = vec![enlarge.new_row(); size.channels];
        Scratch { enlarge, level: vec![0.0; size.width], half_way: rows.clone(), last: rows }
    }

    /// Interpolates both targets at the pixels of the picture's row `y`.
    fn enlarge(&mut self, simd: Simd, y: usize, small: Size, half_way: &[f32], last: &[f32]) {
        let rows = self.enlarge.rows(y, small.height);
        for c in 0..small.channels {
            for (target, out) in [(half_way, &mut self.half_way[c]), (last, &mut self.last[c])] {
                let rows = rows.map(|row| &target[(c * small.height + row) * small.width..][..small.width]);
                self.enlarge.row(simd, y, rows, out);
            }
        }
    }
}

/// Interpolates one row of the picture between its targets.
#[inline(always)]
fn interpolate<const C: usize>(sharp: &[&[f32]; C], scratch: &Scratch, out: &mut [f32]) {
    for c in 0..C {
        let first = scratch.enlarge.first();
        let (half_way, last) = (&scratch.half_way[c][first..], &scratch.last[c][first..]);
        let blurred = half_way.iter().zip(last);
        for (((pixel, level), sharp), (half_way, last)) in
            out.chunks_exact_mut(C).zip(&scratch.level).zip(sharp[c]).zip(blurred)
        {
            pixel[c] = between_levels(*level, *sharp, *half_way, *last);
        }
    }
}

/// The value at `level` between a picture (0) and its targets (0.5 and 1).
#[inline(always)]
fn between_levels(level: f32, sharp: f32, half_way: f32, last: f32) -> f32 {
    let upper = level > 0.5;
    let (from, to) = if upper { (half_way, last) } else { (sharp, half_way) };
    let along = if upper { 2.0 * level - 1.0 } else { 2.0 * level };
    from + along * (to - from)
}
