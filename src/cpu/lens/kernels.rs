//! The discs of a frame, one for each radius that occurs, told apart to a fraction of a pixel.

use crate::aperture::{Aperture, Kernel};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Radii below this are told apart more finely.
pub const SMALL_PX: f64 = 4.0;
/// Steps to a pixel, below and above [`SMALL_PX`].
pub const FINE: f64 = 64.0;
/// As [`FINE`].
pub const COARSE: f64 = 16.0;

/// Where shift `t` lies between the radius steps.
#[inline(always)]
pub fn position(t: f64) -> f64 {
    let r = t.abs();
    let steps = if r < SMALL_PX { r * FINE } else { SMALL_PX * FINE + (r - SMALL_PX) * COARSE };
    steps.copysign(t)
}

/// The radius step that shift `t` falls to.
pub fn key(t: f64) -> i32 {
    position(t).round() as i32
}

/// The shift that a step stands for.
fn shift(key: i32) -> f64 {
    let steps = f64::from(key.abs());
    let r =
        if steps < SMALL_PX * FINE { steps / FINE } else { SMALL_PX + (steps - SMALL_PX * FINE) / COARSE };
    r.copysign(f64::from(key))
}

/// Kernels by radius step.
pub struct Kernels {
    keys: Vec<i32>,
    kernels: Vec<Kernel>,
}

impl Kernels {
    /// The kernels of all these steps.
    pub fn new(aperture: &Aperture, keys: BTreeSet<i32>) -> Kernels {
        let keys: Vec<i32> = keys.into_iter().collect();
        let kernels = keys.par_iter().map(|&k| aperture.kernel(shift(k))).collect();
        Kernels { keys, kernels }
    }

    /// The kernel of a step, which must have been asked for.
    pub fn get(&self, key: i32) -> &Kernel {
        &self.kernels[self.keys.partition_point(|&k| k < key)]
    }

    /// All kernels by their steps.
    pub fn iter(&self) -> impl Iterator<Item = (i32, &Kernel)> {
        self.keys.iter().copied().zip(&self.kernels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_close_to_the_radius_they_stand_for() {
        for i in -4000..4000 {
            let t = f64::from(i) * 0.0123;
            assert!((shift(key(t)) - t).abs() <= 0.5 / COARSE + 1e-9);
            assert_eq!(key(shift(key(t))), key(t));
        }
    }
}
