//! The image of a point out of focus as weights of whole pixels that keep the lens's own transfer function.
//!
//! A wall at one depth is its picture convolved with the opening. Pixels sample the picture, and how the opening
//! covers them is a coarse copy of it while it is small: too wide by the width of a pixel, or no blur at all below
//! half of one. The weights here are those, none of them negative, which change sinusoids of up to a little more than
//! a quarter of a cycle a pixel as the opening itself does.
//!
//! They minimise the squared error of the transfer function, averaged over the directions and the frequencies of that
//! band. With `g(x)` the mean of `cos(w x)` over the band, the error is `k' G k - 2 T' k` and a constant: `G` holds
//! `g` of the distances between pixels, and `T` the means of `g` over the opening around each of them.

use super::kernel::Kernel;
use super::opening::Aperture;
use super::profile::Side;
use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::OnceLock;

/// Up to this radius in pixels, the opening lies inside its own pixel, and its blur is an exchange with the direct
/// neighbours: in a sinusoid of `w` radians a pixel, an opening of variance `v` along an axis leaves
/// `1 - v w^2 / 2 + ..`, and weights `b` of both neighbours leave `1 - b (2 - 2 cos w)`.
pub const EXCHANGED_PX: f64 = 0.5;
/// Until this radius, the exchange fades into fitted weights.
const NO_LONGER_EXCHANGED_PX: f64 = 0.75;
/// Up to this radius, kernels are fitted to the transfer function.
const FITTED_PX: f64 = 3.0;
/// From this radius on, the covered areas differ from it by less than one percent, and are used. In between, one kind
/// fades into the other.
const BY_AREA_PX: f64 = 5.0;
/// The greatest frequency of the band in radians a pixel: a tenth above a quarter of a cycle.
const BAND: f64 = 0.55 * PI;
/// Samples of the opening per pixel along each axis.
const FINE: i32 = 4;
/// The pull of each weight towards the covered area. Outside of the band it alone decides.
const PULL: f64 = 3e-4;
/// The pull grows with the squared distance from the opening's rim, so that weights appear and disappear smoothly as
/// the opening grows.
const PULL_PER_PX2: f64 = 0.1;
/// Pixels so far beyond the rim have no weight.
const BEYOND_PX: f64 = 1.5;
/// Steps of the minimisation. What then remains of the error inside the band is a third of a percent.
const STEPS: usize = 200;
/// Weights below this part of the total are left out.
const NEGLIGIBLE: f64 = 1e-5;

/// The mean of `weight(w) cos(w x)` at distance `x` over the band, for all directions and frequencies.
fn band_mean(x: f64, weight: impl Fn(f64) -> f64) -> f64 {
    const FREQUENCIES: usize = 24;
    const DIRECTIONS: usize = 24;
    let middle = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
    let of_frequency = |w: f64| {
        let across = |j: usize| w * x * (FRAC_PI_2 * middle(j, DIRECTIONS)).sin();
        weight(w) * (0..DIRECTIONS).map(|j| across(j).cos()).sum::<f64>()
    };
    let sum: f64 = (0..FREQUENCIES).map(|i| of_frequency(BAND * middle(i, FREQUENCIES))).sum();
    sum / (FREQUENCIES * DIRECTIONS) as f64
}

/// [`band_mean`] of every distance inside a kernel.
struct BandMeans(Vec<f64>);

impl BandMeans {
    /// Entries per pixel. Between them, the means are straight to a hundred-thousandth.
    const PER_PX: f64 = 64.0;

    fn new(weight: impl Fn(f64) -> f64) -> BandMeans {
        let farthest = 2.0 * std::f64::consts::SQRT_2 * (BY_AREA_PX + 2.0);
        let entries = (farthest * Self::PER_PX) as usize + 2;
        BandMeans((0..entries).map(|i| band_mean(i as f64 / Self::PER_PX, &weight)).collect())
    }

    /// The means between two pixels.
    fn of_pixels() -> &'static BandMeans {
        static MEANS: OnceLock<BandMeans> = OnceLock::new();
        MEANS.get_or_init(|| BandMeans::new(|_| 1.0))
    }

    /// The means between a pixel and a sample of the opening. A sample stands for a square of its own size, which blurs
    /// by `1 - w^2 / 24 n^2 + ..` where there are `n` a pixel; that is undone.
    fn of_samples() -> &'static BandMeans {
        static MEANS: OnceLock<BandMeans> = OnceLock::new();
        MEANS.get_or_init(|| BandMeans::new(|w| 1.0 / (1.0 - w * w / f64::from(24 * FINE * FINE))))
    }

    fn at(&self, x: f64) -> f64 {
        let at = x * Self::PER_PX;
        let (i, beyond) = (at as usize, at.fract());
        self.0[i] + beyond * (self.0[i + 1] - self.0[i])
    }
}

/// Rounding of shifts in `f32` moves a surface in focus by this loss of contrast at most, which is none.
pub const ROUNDING: f32 = 1e-8;

/// The weight of each direct neighbour along an axis under shift `t` pixels, where the loss of contrast is `loss` per
/// squared pixel.
#[inline(always)]
pub fn exchange(loss: f32, t: f32) -> f32 {
    let loss = (loss * t * t - ROUNDING).max(0.0);
    // At a quarter of a cycle, `2 - 2 cos w` is 2. The series of a disc, `2 J1(x) / x`, goes on with `x^4 / 192`, a third
    // of the square of `x^2 / 8`.
    0.5 * (loss - loss * loss / 3.0)
}

/// By how much that weight rises with each pixel of shift.
#[inline(always)]
pub fn exchange_slope(loss: f32, t: f32) -> f32 {
    let lost = (loss * t * t - ROUNDING).max(0.0);
    if lost > 0.0 { loss * t * (1.0 - lost / 1.5) } else { 0.0 }
}

impl Aperture {
    /// The loss of contrast at a quarter of a cycle a pixel, to leading order, per squared pixel of radius, along each
    /// axis.
    pub fn loss_per_px2(&self) -> [f32; 2] {
        const RADIUS_PX: f64 = 64.0;
        let large = self.kernel(RADIUS_PX);
        let mean = |of: &dyn Fn([f64; 2]) -> f64| -> f64 {
            large.weights().map(|(dx, dy, weight)| f64::from(weight) * of([dx, dy].map(f64::from))).sum()
        };
        let variance = |axis: usize| {
            let about_centre = mean(&|p| p[axis] * p[axis]) - mean(&|p| p[axis]).powi(2);
            // Less that of a pixel.
            (about_centre - 1.0 / 12.0) / (RADIUS_PX * RADIUS_PX)
        };
        [0, 1].map(|axis| (variance(axis) * FRAC_PI_2 * FRAC_PI_2 / 2.0) as f32)
    }

    /// The image of a point under shift `t` pixels, as weights of pixels with the transfer function of the opening.
    pub fn transfer_kernel(&self, t: f64) -> Kernel {
        // Radii at which kernels of a frame are apart.
        const PER_PX: f64 = 16.0;
        static OF_DISC: [OnceLock<Kernel>; (BY_AREA_PX * PER_PX) as usize] =
            [const { OnceLock::new() }; (BY_AREA_PX * PER_PX) as usize];
        let step = t.abs() * PER_PX;
        if self.is_plain_disc() && step.fract() == 0.0 && t.abs() < BY_AREA_PX {
            return OF_DISC[step as usize].get_or_init(|| self.new_transfer_kernel(t.abs())).clone();
        }
        self.new_transfer_kernel(t)
    }

    fn new_transfer_kernel(&self, t: f64) -> Kernel {
        let by_area = self.kernel(t);
        if t == 0.0 || t.abs() >= BY_AREA_PX {
            return by_area;
        }
        let fit = Fit::new(self, &by_area, t);
        let fitted = fit.minimum();
        let total: f64 = fitted.iter().sum();
        let is_fitted = ((BY_AREA_PX - t.abs()) / (BY_AREA_PX - FITTED_PX)).min(1.0);
        let exchanged = (NO_LONGER_EXCHANGED_PX - t.abs()) / (NO_LONGER_EXCHANGED_PX - EXCHANGED_PX);
        let exchanged = exchanged.clamp(0.0, 1.0);
        let [beside, over] = if exchanged > 0.0 {
            self.loss_per_px2().map(|loss| f64::from(exchange(loss, t as f32)))
        } else {
            [0.0; 2]
        };
        let of_exchange = |pixel: [i32; 2]| match pixel {
            [0, 0] => 1.0 - 2.0 * (beside + over),
            [-1 | 1, 0] => beside,
            [0, -1 | 1] => over,
            _ => 0.0,
        };
        let mut weights: HashMap<[i32; 2], f64> = HashMap::new();
        for ((&pixel, fitted), area) in fit.pixels.iter().zip(&fitted).zip(&fit.areas) {
            let far = is_fitted * fitted / total + (1.0 - is_fitted) * area;
            let weight = exchanged * of_exchange(pixel) + (1.0 - exchanged) * far;
            if weight >= NEGLIGIBLE {
                weights.insert(pixel, weight);
            }
        }
        Kernel::from_weights(fit.reach, |dx, dy| weights.get(&[dx, dy]).copied().unwrap_or(0.0))
    }
}

/// A problem of least squares: see the module.
struct Fit {
    reach: i32,
    /// The pixels that may have a weight.
    pixels: Vec<[i32; 2]>,
    /// The covered areas, as parts of the whole.
    areas: Vec<f64>,
    /// The symmetric matrix, row by row, and the right-hand side.
    matrix: Vec<f64>,
    wanted: Vec<f64>,
}

impl Fit {
    fn new(aperture: &Aperture, by_area: &Kernel, t: f64) -> Fit {
        let (of_pixels, of_samples) = (BandMeans::of_pixels(), BandMeans::of_samples());
        let within = t.abs() + BEYOND_PX;
        let reach = within.ceil() as i32;
        let square = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| [dx, dy]));
        let from_centre = |[dx, dy]: [i32; 2]| f64::from(dx).hypot(f64::from(dy));
        let pixels: Vec<[i32; 2]> = square.filter(|&pixel| from_centre(pixel) <= within).collect();
        let areas: HashMap<[i32; 2], f64> =
            by_area.weights().map(|(dx, dy, weight)| ([dx, dy], f64::from(weight))).collect();
        let areas: Vec<f64> = pixels.iter().map(|pixel| areas.get(pixel).copied().unwrap_or(0.0)).collect();
        let places: Vec<[f64; 2]> = pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
        let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let opening: Vec<([f64; 2], f64)> = aperture
            .kernel_on(Side::of(t), f64::from(FINE) * t)
            .weights()
            .map(|(dx, dy, weight)| ([dx, dy].map(|v| f64::from(v) / f64::from(FINE)), f64::from(weight)))
            .collect();
        let mut matrix: Vec<f64> =
            places.iter().flat_map(|a| places.iter().map(move |b| of_pixels.at(distance(a, b)))).collect();
        let mean_over_opening = |p: &[f64; 2]| {
            opening.iter().map(|(u, weight)| weight * of_samples.at(distance(p, u))).sum::<f64>()
        };
        let mut wanted: Vec<f64> = places.iter().map(mean_over_opening).collect();
        for (i, &pixel) in pixels.iter().enumerate() {
            let beyond = (from_centre(pixel) - t.abs() - 0.5).max(0.0);
            let pull = PULL + PULL_PER_PX2 * beyond * beyond;
            matrix[i * pixels.len() + i] += pull;
            wanted[i] += pull * areas[i];
        }
        Fit { reach, pixels, areas, matrix, wanted }
    }

    /// The weights that minimise the error, none of them negative: by projected gradients with Nesterov's momentum,
    /// from the covered areas on.
    fn minimum(&self) -> Vec<f64> {
        let n = self.areas.len();
        let row = |i: usize| &self.matrix[i * n..][..n];
        // No eigenvalue exceeds the largest sum of magnitudes of a row.
        let steepest = (0..n).map(|i| row(i).iter().map(|v| v.abs()).sum::<f64>()).fold(0.0, f64::max);
        let (mut weights, mut ahead) = (self.areas.clone(), self.areas.clone());
        let mut gradient = vec![0.0; n];
        let mut momentum = 1.0f64;
        for _ in 0..STEPS {
            gradient.iter_mut().zip(&self.wanted).for_each(|(g, wanted)| *g = -wanted);
            for (i, weight) in ahead.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                gradient.iter_mut().zip(row(i)).for_each(|(g, m)| *g += weight * m);
            }
            let next = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
            let kept = (momentum - 1.0) / next;
            momentum = next;
            for i in 0..n {
                let weight = (ahead[i] - gradient[i] / steepest).max(0.0);
                ahead[i] = weight + kept * (weight - weights[i]);
                weights[i] = weight;
            }
        }
        weights
    }
}
