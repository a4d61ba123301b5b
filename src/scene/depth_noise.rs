//! Depths without their noise.
//!
//! Depth from a sensor or a network scatters around the surface. Taken at its word, each pixel would be a surface of
//! its own that hides its neighbours. On a plane, the mean of two opposite neighbours is the pixel's own disparity.

use crate::memory::Buffer;
use crate::noise::deviation;
use crate::picture::Size;
use crate::rows::ITEMS_PER_TASK;
use crate::simd::Simd;
use rayon::prelude::*;

/// Noise below this moves nothing by a visible amount: the depths stay as they are.
const NEGLIGIBLE_PX: f32 = 1e-3;
/// A pixel and the mean of two opposite neighbours differ by `sqrt(3 / 2)` deviations of the noise. At six to
/// seven times as much, they are on different surfaces.
const OTHER_SURFACE: f32 = 8.0;
/// Distance in pixels to the farthest neighbours.
const REACH: usize = 3;
/// A pixel that weighs one has pairs around it that weigh up to fifteen; along a straight edge they weigh three, at a
/// corner or in a thing of two pixels nothing. Where a pixel and its pairs weigh no more than the first of these, it is
/// put on a plane instead, and in part up to the second.
const FEW_PAIRS: [f32; 2] = [2.0, 4.0];
/// So much of the spread of cells in a direction, in square pixels, tells no slope: a plane through a single row of cells
/// does not rise across it.
const NO_SPREAD: f32 = 1e-3;

/// The weight of a neighbour so many columns or rows away.
fn share(d: isize) -> f32 {
    1.0 - d.abs() as f32 / (REACH + 1) as f32
}

/// Half of the neighbours within [`REACH`], as columns, rows and weights. Each stands for the opposite one too. The
/// weights fall linearly along both axes.
fn neighbours() -> impl Iterator<Item = (isize, usize, f32)> {
    let reach = REACH as isize;
    let half = (0..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| (dx, dy)));
    half.filter(|&(dx, dy)| dy > 0 || dx > 0)
        .map(move |(dx, dy)| (dx, dy as usize, 2.0 * share(dx) * share(dy)))
}

/// The rows around one row, with [`REACH`] cells more on every side, which have no shift.
struct Around {
    rows: [Vec<f32>; 2 * REACH + 1],
    sum: Vec<f32>,
    weight: Vec<f32>,
}

impl Around {
    fn new(width: usize) -> Around {
        let row = || vec![f32::NAN; width + 2 * REACH];
        Around { rows: std::array::from_fn(|_| row()), sum: vec![0.0; width], weight: vec![0.0; width] }
    }

    fn read(&mut self, s: &[f32], size: Size, y: usize) {
        for (i, row) in self.rows.iter_mut().enumerate() {
            let row = &mut row[REACH..][..size.width];
            match (y + i).checked_sub(REACH).filter(|y| *y < size.height) {
                Some(y) => row.copy_from_slice(&s[y * size.width..][..size.width]),
                None => row.fill(f32::NAN),
            }
        }
    }

    /// Writes the row without noise of this deviation.
    #[inline(always)]
    fn smooth(&mut self, deviation: f32, out: &mut [f32]) {
        let n = out.len();
        let Around { rows, sum, weight } = self;
        let (sum, weight) = (&mut sum[..n], &mut weight[..n]);
        sum.fill(0.0);
        weight.fill(1.0);
        let own = &rows[REACH][REACH..][..n];
        let per_px2 = (OTHER_SURFACE * deviation).powi(-2);
        for (dx, dy, share) in neighbours() {
            let one = &rows[REACH + dy][REACH.wrapping_add_signed(dx)..][..n];
            let opposite = &rows[REACH - dy][REACH.wrapping_add_signed(-dx)..][..n];
            for x in 0..n {
                let off = 0.5 * (one[x] + opposite[x]) - own[x];
                // Falls smoothly to nothing where the pair is of another surface.
                let same = 1.0 - off * off * per_px2;
                let (same, off) = if same > 0.0 { (same, off) } else { (0.0, 0.0) };
                let share = share * same * same;
                sum[x] += share * off;
                weight[x] += share;
            }
        }
        for x in 0..n {
            out[x] = own[x] + sum[x] / weight[x];
        }
        let few = |weight: f32| ((FEW_PAIRS[1] - weight) / (FEW_PAIRS[1] - FEW_PAIRS[0])).clamp(0.0, 1.0);
        for x in (0..n).filter(|&x| weight[x] < FEW_PAIRS[1] && !own[x].is_nan()) {
            out[x] += few(weight[x]) * (on_plane(rows, x, per_px2) - out[x]);
        }
    }
}

/// The shift at the pixel in column `x` of the middle row on a plane through the cells of its surface, by least squares.
fn on_plane(rows: &[Vec<f32>; 2 * REACH + 1], x: usize, per_px2: f32) -> f32 {
    let own = rows[REACH][REACH + x];
    let (mut all, mut sums, mut products) = (0.0, [0.0f32; 3], [0.0f32; 5]);
    for (dy, row) in (-(REACH as isize)..).zip(rows) {
        for (dx, s) in (-(REACH as isize)..).zip(&row[x..=x + 2 * REACH]) {
            let off = s - own;
            let same = 1.0 - off * off * per_px2;
            // False where there is no cell.
            if same > 0.0 {
                let (weight, place) = (share(dx) * share(dy) * same * same, [dx as f32, dy as f32]);
                all += weight;
                let [u, v] = place;
                [u, v, off].iter().zip(&mut sums).for_each(|(value, sum)| *sum += weight * value);
                let values = [u * u, u * v, v * v, u * off, v * off];
                values.iter().zip(&mut products).for_each(|(value, sum)| *sum += weight * value);
            }
        }
    }
    let [u, v, off] = sums.map(|sum| sum / all);
    let [uu, uv, vv, u_off, v_off] = products.map(|product| product / all);
    let (uu, uv, vv) = (uu - u * u + NO_SPREAD, uv - u * v, vv - v * v + NO_SPREAD);
    let (u_off, v_off) = (u_off - u * off, v_off - v * off);
    let scale = (uu * vv - uv * uv).recip();
    let slope = [scale * (vv * u_off - uv * v_off), scale * (uu * v_off - uv * u_off)];
    own + off - slope[0] * u - slope[1] * v
}

/// The shifts without their noise. Depth without noise comes back as it is. Cells without a shift are NaN, and stay it.
pub fn without_noise(s: Buffer<f32>, size: Size, simd: Simd) -> Buffer<f32> {
    let deviation = deviation(&s, size);
    if deviation < NEGLIGIBLE_PX {
        return s;
    }
    let mut smooth = Buffer::unset(s.len());
    let rows = smooth.par_chunks_mut(size.width).enumerate().with_min_len(ITEMS_PER_TASK);
    rows.for_each_init(
        || Around::new(size.width),
        |around, (y, out)| {
            around.read(&s, size, y);
            simd.run(
                #[inline(always)]
                || around.smooth(deviation, out),
            );
        },
    );
    smooth
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 96, height: 64, channels: 3 };

    /// Two planes, one before the other.
    fn planes() -> Buffer<f32> {
        let at = |i: usize| {
            let (x, y) = ((i % SIZE.width) as f32, (i / SIZE.width) as f32);
            if x < 40.0 { 12.0 - 0.25 * y } else { 0.5 * x - 0.125 * y - 60.0 }
        };
        (0..SIZE.pixels()).map(at).collect()
    }

    fn with_noise(s: &[f32], deviation: f32) -> Buffer<f32> {
        // Knuth's linear congruential generator.
        let mut state = 7u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        // The sum of twelve uniform values has a variance of one.
        let mut normal = || (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
        s.iter().map(|s| s + deviation * normal()).collect()
    }

    #[test]
    fn planes_without_noise_come_back_bit_for_bit() {
        assert_eq!(deviation(&planes(), SIZE), 0.0);
        assert_eq!(without_noise(planes(), SIZE, Simd::PORTABLE), planes());
    }

    #[test]
    fn the_deviation_is_found_and_little_of_it_is_left() {
        for expected in [0.05, 0.4] {
            let noisy = with_noise(&planes(), expected);
            assert!((deviation(&noisy, SIZE) / expected - 1.0).abs() < 0.05);
            let smooth = without_noise(noisy, SIZE, Simd::PORTABLE);
            let errors =
                smooth.iter().zip(&*planes()).map(|(s, exact)| (s - exact).powi(2)).collect::<Vec<_>>();
            let rms = (errors.iter().sum::<f32>() / errors.len() as f32).sqrt();
            // Beside the step and at the border, fewer pixels are averaged.
            assert!(rms < 0.36 * expected, "{rms} of {expected}");
        }
    }

    #[test]
    fn small_things_have_their_noise_taken_out_and_keep_their_slope() {
        // Squares of three pixels far in front of a plane; both have slopes.
        let at = |i: usize| {
            let (x, y) = (i % SIZE.width, i / SIZE.width);
            let is_thing = x % 8 < 3 && y % 8 < 3;
            0.05 * x as f32 + 0.1 * y as f32 + if is_thing { 40.0 } else { 0.0 }
        };
        let exact: Buffer<f32> = (0..SIZE.pixels()).map(at).collect();
        let smooth = without_noise(with_noise(&exact, 0.2), SIZE, Simd::PORTABLE);
        // Away from the border, by places in a thing.
        let mut errors = [[0.0f32; 2]; 9];
        let mut things = 0.0;
        for (x, y) in (1..7).flat_map(|y| (1..11).map(move |x| (8 * x, 8 * y))) {
            things += 1.0;
            for (place, error) in errors.iter_mut().enumerate() {
                let i = (y + place / 3) * SIZE.width + x + place % 3;
                let off = (smooth[i] - exact[i]) / 0.2;
                *error = [error[0] + off, error[1] + off * off];
            }
        }
        for [sum, squares] in errors {
            // At a corner of nine cells, a plane has 4 / 9 of the noise's variance.
            let (mean, rms) = (sum / things, (squares / things).sqrt());
            assert!(mean.abs() < 0.3 && rms < 0.8, "{mean} and {rms} deviations");
        }
    }

    #[test]
    fn a_pixel_without_a_shift_stays_one_and_touches_no_other() {
        let mut noisy = with_noise(&planes(), 0.1);
        let all = without_noise(noisy.clone(), SIZE, Simd::PORTABLE);
        let hole = 30 * SIZE.width + 60;
        noisy[hole] = f32::NAN;
        let smooth = without_noise(noisy, SIZE, Simd::PORTABLE);
        for (i, (s, all)) in smooth.iter().zip(&*all).enumerate() {
            assert_eq!(s.is_nan(), i == hole);
            assert!(i == hole || (s - all).abs() < 0.1);
        }
    }
}
