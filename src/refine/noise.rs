//! Noise of depth: how strong it is, and depth without it.

use super::plane::{Plane, fade};
use super::quantile::quantiles;
use rayon::prelude::*;

/// Half of the window within which values are averaged.
const REACH: usize = 2;
/// Values that differ by this many standard deviations belong to different surfaces. Two samples of one value differ
/// by 1.4 of them on average.
const APART: f32 = 5.0;

/// The standard deviation of the noise: what is left of a pixel when the mean of its four neighbours is subtracted,
/// which nothing is of a plane. The median ignores the few pixels at edges.
pub fn deviation(depth: &Plane) -> f32 {
    let rows = (1..depth.height.saturating_sub(1)).into_par_iter();
    let residuals = rows.flat_map_iter(|y| {
        let y = y as isize;
        let (above, row, below) = (depth.row(y - 1), depth.row(y), depth.row(y + 1));
        (1..depth.width.saturating_sub(1))
            .map(move |x| (row[x] - 0.25 * (above[x] + below[x] + row[x - 1] + row[x + 1])).abs())
    });
    let [median] = quantiles(residuals, [0.5]);
    // The median of the magnitudes is 0.6745 deviations, and the variance of the difference 1 + 4 / 16.
    median / (0.6745 * 1.25f32.sqrt())
}

/// Depth averaged over what differs from it by no more than noise does.
///
/// `sigma` is the noise's standard deviation, and `range` the extent of all depths. Noise that is not there changes
/// nothing: depth without any comes back to the bit, and rounding to 16 bits is none.
pub fn without_noise(depth: &Plane, sigma: f32, range: f32) -> Option<Plane> {
    let strength = fade(sigma / range, 2e-4, 1e-3);
    if strength <= 0.0 {
        return None;
    }
    let scale = 1.0 / (APART * sigma).powi(2);
    Some(depth.like(|y, out| {
        let centre = depth.row(y as isize);
        let mut padded = vec![[0.0f32; 2]; out.len()];
        for dy in -(REACH as isize)..=REACH as isize {
            let row = depth.row(y as isize + dy);
            for dx in 0..=2 * REACH {
                for (x, sums) in padded.iter_mut().enumerate() {
                    let v = row[(x + dx).saturating_sub(REACH).min(row.len() - 1)];
                    let difference = v - centre[x];
                    // Tukey's biweight: smooth, and zero from where on values are apart.
                    let near = (1.0 - difference * difference * scale).max(0.0);
                    let weight = near * near;
                    sums[0] += weight * difference;
                    sums[1] += weight;
                }
            }
        }
        for ((out, sums), v) in out.iter_mut().zip(&padded).zip(centre) {
            *out = v + strength * (sums[0] / sums[1]);
        }
    }))
}
