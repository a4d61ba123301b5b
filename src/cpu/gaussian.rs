//! Carries out [`plan::gaussian`](crate::plan::gaussian).

use super::job::Job;
use super::padded_rows::{BLOCK, block};
use crate::error::Result;
use crate::memory::Buffer;
use crate::mirror::mirrored;
use crate::picture::{Layer, Size};
use crate::plan::gaussian::{Plan, REACH, Settings};
use crate::rows::{interleave, mix, render_bands, with_channels};
use crate::simd::Simd;
use rayon::prelude::*;

/// Rows of the half-size copy that one task processes.
const BAND: usize = 16;
/// Mirrored texels on both sides of a row of the half-size copy: taps also read the texel beyond their reach.
const MARGIN: usize = REACH + 1;
/// Values of a row that are blurred together along y.
const ROW_BLOCK: usize = 64;

/// Renders the picture, interleaved, into `out`.
pub fn render(job: &Job, settings: &Settings, out: &mut [f32]) -> Result<()> {
    let Job { front: layer, size, optics, simd, cancel } = *job;
    let plan = Plan::new(settings, optics);
    let input = Input { layer, size, half: (size.width.div_ceil(2), size.height.div_ceil(2)) };
    // Rows of the half-size copy, blurred along x. A row has one line for each weighted colour and one for the
    // weights.
    let used = input.used();
    let length = used.next_multiple_of(ROW_BLOCK);
    let mut across = Buffer::unset(length * input.half.1);
    across.par_chunks_mut(BAND * length).enumerate().try_for_each_init(
        || Halved::new(&input),
        |halved, (band, out)| {
            cancel.check()?;
            for (i, out) in out.chunks_mut(length).enumerate() {
                halved.read(simd, &plan, &input, band * BAND + i);
                with_channels!(size.channels, C => simd.run(#[inline(always)] || blur_x::<C>(&plan, halved, &mut out[..used])));
            }
            Ok(())
        },
    )?;
    let across = Across { values: across, length, rows: input.half.1 };
    render_bands(
        out,
        size,
        2 * BAND,
        cancel,
        || Blurred::new(&input),
        |blurred, first, out| {
            for (i, out) in out.chunks_mut(size.width * size.channels).enumerate() {
                blurred.interpolate(simd, &plan, &across, first + i);
                simd.run(
                    #[inline(always)]
                    || blurriness_row(&plan, input.disparity(first + i), &mut blurred.blurriness),
                );
                with_channels!(size.channels, C => simd.run(#[inline(always)] || composite::<C>(&input, blurred, first + i, out)));
            }
        },
    )
}

/// The picture, and the number of columns and rows of its half-size copy.
struct Input<'a> {
    layer: &'a Layer,
    size: Size,
    half: (usize, usize),
}

impl Input<'_> {
    /// Number of values in a row of the half-size copy: its lines, one after the other.
    fn used(&self) -> usize {
        self.half.0 * (self.size.channels + 1)
    }

    #[inline(always)]
    fn color(&self, c: usize, y: usize) -> &[f32] {
        &self.layer.color[c * self.size.pixels() + y * self.size.width..][..self.size.width]
    }

    #[inline(always)]
    fn disparity(&self, y: usize) -> &[f32] {
        &self.layer.disparity[y * self.size.width..][..self.size.width]
    }
}

/// The blurriness of a row.
#[inline(always)]
fn blurriness_row(plan: &Plan, disparity: &[f32], out: &mut [f32]) {
    for (blurriness, d) in out.iter_mut().zip(disparity) {
        *blurriness = plan.blurriness(*d);
    }
}

/// A row of the half-size copy with a margin: the colours, then blurriness.
struct Halved {
    lines: Vec<Vec<f32>>,
    /// Blurriness of the two rows of the picture from which a row is made.
    blurriness: [Vec<f32>; 2],
}

impl Halved {
    fn new(input: &Input) -> Halved {
        let line = vec![0.0; input.half.0.next_multiple_of(BLOCK) + 2 * MARGIN];
        Halved {
            lines: vec![line; input.size.channels + 1],
            blurriness: [vec![0.0; input.size.width], vec![0.0; input.size.width]],
        }
    }

    /// Reads row `y` of the half-size copy.
    fn read(&mut self, simd: Simd, plan: &Plan, input: &Input, y: usize) {
        let rows = [2 * y, mirrored(2 * y as i64 + 1, input.size.height).0];
        for (row, out) in rows.into_iter().zip(&mut self.blurriness) {
            simd.run(
                #[inline(always)]
                || blurriness_row(plan, input.disparity(row), out),
            );
        }
        let width = input.half.0;
        for (plane, line) in self.lines.iter_mut().enumerate() {
            let [top, bottom]: [&[f32]; 2] = if plane < input.size.channels {
                rows.map(|row| input.color(plane, row))
            } else {
                self.blurriness.each_ref().map(Vec::as_slice)
            };
            simd.run(
                #[inline(always)]
                || halve(top, bottom, &mut line[MARGIN..][..width]),
            );
            for at in (0..MARGIN).chain(MARGIN + width..line.len()) {
                line[at] = line[MARGIN + mirrored(at as i64 - MARGIN as i64, width).0];
            }
        }
    }
}

/// The means of two by two pixels from two rows.
#[inline(always)]
fn halve(top: &[f32], bottom: &[f32], out: &mut [f32]) {
    for ((out, top), bottom) in out.iter_mut().zip(top.chunks_exact(2)).zip(bottom.chunks_exact(2)) {
        *out = 0.25 * ((top[0] + top[1]) + (bottom[0] + bottom[1]));
    }
    if let ([top], [bottom], Some(out)) =
        (top.chunks_exact(2).remainder(), bottom.chunks_exact(2).remainder(), out.last_mut())
    {
        // The mirror image of the last column is that column itself.
        *out = 0.5 * (top + bottom);
    }
}

/// The weight of a tap of this blurriness.
#[inline(always)]
fn weight(blurriness: f32, threshold: f32) -> f32 {
    (blurriness - threshold).clamp(0.0, 1.0)
}

/// A block of a line, interpolated between the texels at two indices.
#[inline(always)]
fn between(line: &[f32], near: usize, far: usize, fraction: f32) -> [f32; BLOCK] {
    let (a, b) = (block::<BLOCK>(line, near), block::<BLOCK>(line, far));
    let mut out = [0.0; BLOCK];
    for i in 0..BLOCK {
        out[i] = mix(a[i], b[i], fraction);
    }
    out
}

/// Weighted colours of a block, and their weights.
struct Weighted<const C: usize> {
    colors: [[f32; BLOCK]; C],
    total: [f32; BLOCK],
}

impl<const C: usize> Weighted<C> {
    /// Adds a tap that lies between the texels at two indices.
    #[inline(always)]
    fn add(&mut self, halved: &Halved, near: usize, far: usize, fraction: f32, threshold: f32) {
        let blurriness = between(&halved.lines[C], near, far, fraction);
        let mut weights = [0.0; BLOCK];
        for i in 0..BLOCK {
            weights[i] = weight(blurriness[i], threshold);
            self.total[i] += weights[i];
        }
        for c in 0..C {
            let color = between(&halved.lines[c], near, far, fraction);
            for i in 0..BLOCK {
                self.colors[c][i] += weights[i] * color[i];
            }
        }
    }
}

/// Blurs a row of the half-size copy along x. The result is a weighted sum, not yet divided by the weights.
#[inline(always)]
fn blur_x<const C: usize>(plan: &Plan, halved: &Halved, out: &mut [f32]) {
    let width = out.len() / (C + 1);
    for x in (0..width).step_by(BLOCK) {
        let centre = MARGIN + x;
        let mut sums = Weighted { colors: [[0.0; BLOCK]; C], total: [0.0; BLOCK] };
        sums.add(halved, centre, centre, 0.0, plan.centre_threshold);
        for tap in &plan.taps {
            sums.add(halved, centre + tap.whole, centre + tap.whole + 1, tap.fraction, tap.threshold);
            sums.add(halved, centre - tap.whole, centre - tap.whole - 1, tap.fraction, tap.threshold);
        }
        let n = BLOCK.min(width - x);
        for (line, values) in sums.colors.iter().chain([&sums.total]).enumerate() {
            out[line * width + x..][..n].copy_from_slice(&values[..n]);
        }
    }
}

/// The half-size copy blurred along x.
struct Across {
    values: Buffer<f32>,
    /// Number of values in a row, rounded up to whole blocks; the values after its lines are undefined.
    length: usize,
    rows: usize,
}

impl Across {
    /// A row of the half-size copy, mirrored at the border.
    fn row(&self, y: i64) -> &[f32] {
        &self.values[mirrored(y, self.rows).0 * self.length..][..self.length]
    }
}

/// Blurred colours around one row of the picture.
struct Blurred {
    /// The lines of colour of two rows of the half-size copy, with a margin of one texel. A row is stored at its
    /// number modulo their count.
    rows: [(Option<i64>, Vec<f32>); 2],
    /// Weighted sums of a row, in whole blocks, of which this many values are used.
    sums: Vec<f32>,
    used: usize,
    /// A line interpolated between the two rows.
    line: Vec<f32>,
    /// Distance from one line to the next.
    stride: usize,
    blurriness: Vec<f32>,
}

impl Blurred {
    fn new(input: &Input) -> Blurred {
        let stride = input.half.0.next_multiple_of(BLOCK) + 2;
        let lines = vec![0.0; stride * input.size.channels];
        Blurred {
            rows: [(None, lines.clone()), (None, lines.clone())],
            sums: vec![0.0; input.used().next_multiple_of(ROW_BLOCK)],
            used: input.used(),
            line: lines,
            stride,
            blurriness: vec![0.0; input.size.width],
        }
    }

    /// Interpolates the rows of the half-size copy above and below row `y` of the picture.
    fn interpolate(&mut self, simd: Simd, plan: &Plan, across: &Across, y: usize) {
        // Row y of the picture is at row y / 2 - 1/4 of the half-size copy.
        let (above, fraction) =
            if y.is_multiple_of(2) { (y as i64 / 2 - 1, 0.75) } else { (y as i64 / 2, 0.25) };
        for row in [above, above + 1] {
            let (held, lines) = &mut self.rows[row.rem_euclid(2) as usize];
            if *held != Some(row) {
                *held = Some(row);
                let around: [&[f32]; 2 * REACH + 1] =
                    std::array::from_fn(|i| across.row(row + i as i64 - REACH as i64));
                simd.run(
                    #[inline(always)]
                    || blur_y(plan, &around, &mut self.sums),
                );
                simd.run(
                    #[inline(always)]
                    || divide(&self.sums[..self.used], self.stride, lines),
                );
            }
        }
        let [above, below] = [above, above + 1].map(|row| &self.rows[row.rem_euclid(2) as usize].1);
        simd.run(
            #[inline(always)]
            || mix_lines(above, below, fraction, &mut self.line),
        );
    }
}

/// Blurs rows along y into the middle row.
#[inline(always)]
fn blur_y(plan: &Plan, rows: &[&[f32]; 2 * REACH + 1], out: &mut [f32]) {
    for (i, out) in out.as_chunks_mut::<ROW_BLOCK>().0.iter_mut().enumerate() {
        let part = |row: usize| block::<ROW_BLOCK>(rows[row], ROW_BLOCK * i);
        let centre = part(REACH);
        let mut sums = [0.0f32; ROW_BLOCK];
        for x in 0..ROW_BLOCK {
            sums[x] = plan.weights[0] * centre[x];
        }
        for distance in 1..=REACH {
            let (a, b, weight) = (part(REACH - distance), part(REACH + distance), plan.weights[distance]);
            for x in 0..ROW_BLOCK {
                sums[x] += weight * (a[x] + b[x]);
            }
        }
        *out = sums;
    }
}

/// Divides weighted sums by their weights, which are the last line, and writes them to lines with a margin.
#[inline(always)]
fn divide(sums: &[f32], stride: usize, lines: &mut [f32]) {
    let count = lines.len() / stride;
    let width = sums.len() / (count + 1);
    let weights = &sums[count * width..];
    for (sums, line) in sums.chunks_exact(width).zip(lines.chunks_exact_mut(stride)) {
        for ((out, sum), weight) in line[1..].iter_mut().zip(sums).zip(weights) {
            *out = sum / weight;
        }
        line[0] = line[1];
        line[width + 1] = line[width];
    }
}

/// Interpolates between two lines.
#[inline(always)]
fn mix_lines(a: &[f32], b: &[f32], fraction: f32, out: &mut [f32]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = mix(*a, *b, fraction);
    }
}

/// Composites the blurred colours over row `y` of the picture by its blurriness.
#[inline(always)]
fn composite<const C: usize>(input: &Input, blurred: &Blurred, y: usize, out: &mut [f32]) {
    for (i, out) in out.chunks_mut(BLOCK * C).enumerate() {
        let (x, n) = (i * BLOCK, out.len() / C);
        let blurriness = &blurred.blurriness[x..][..n];
        let mut colors = [[0.0f32; BLOCK]; C];
        for c in 0..C {
            // Columns are a quarter of a texel to the left and to the right of the centres of texels.
            let texels = &blurred.line[c * blurred.stride + x / 2..][..BLOCK / 2 + 2];
            for k in 0..BLOCK / 2 {
                colors[c][2 * k] = mix(texels[k + 1], texels[k], 0.25);
                colors[c][2 * k + 1] = mix(texels[k + 1], texels[k + 2], 0.25);
            }
            let sharp = &input.color(c, y)[x..][..n];
            for k in 0..n {
                colors[c][k] = mix(sharp[k], colors[c][k], blurriness[k]);
            }
        }
        interleave(colors.each_ref(), out);
    }
}
