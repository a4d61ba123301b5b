//! Depth without its noise.

use super::plane::{Plane, fade};

/// Half of the window within which values are averaged.
const REACH: usize = 2;
/// Values that differ by this many standard deviations belong to different surfaces. Two samples of one value differ
/// by 1.4 of them on average.
const APART: f32 = 5.0;

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
