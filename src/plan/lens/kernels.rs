//! The discs of a frame: one kernel for each radius that occurs, quantised to a fraction of a pixel.

use crate::aperture::{Aperture, Kernel};
use crate::cancel::Cancel;
use crate::error::Result;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Radii below this are quantised more finely.
pub const SMALL_PX: f64 = 4.0;
/// Radius steps per pixel below [`SMALL_PX`].
pub const FINE: f64 = 64.0;
/// Radius steps per pixel above [`SMALL_PX`].
pub const COARSE: f64 = 16.0;

/// The position of shift `t` on the scale of radius steps.
#[inline(always)]
pub fn position(t: f64) -> f64 {
    let r = t.abs();
    let steps = if r < SMALL_PX { r * FINE } else { SMALL_PX * FINE + (r - SMALL_PX) * COARSE };
    steps.copysign(t)
}

/// Radius steps per pixel at shift `t`.
pub fn steps_per_px(t: f64) -> f64 {
    if t.abs() < SMALL_PX { FINE } else { COARSE }
}

/// The shift of a radius step.
pub fn shift(key: i32) -> f64 {
    let steps = f64::from(key.abs());
    let r =
        if steps < SMALL_PX * FINE { steps / FINE } else { SMALL_PX + (steps - SMALL_PX * FINE) / COARSE };
    r.copysign(f64::from(key))
}

/// Kernels by key, sorted.
struct Table<K> {
    keys: Vec<K>,
    kernels: Vec<Kernel>,
}

impl<K: Copy + Ord + Sync> Table<K> {
    fn new(
        aperture: &Aperture,
        keys: BTreeSet<K>,
        shift: impl Fn(K) -> f64 + Sync,
        cancel: &Cancel,
    ) -> Result<Table<K>> {
        let keys: Vec<K> = keys.into_iter().collect();
        let kernel = |&key: &K| {
            cancel.check()?;
            Ok(aperture.transfer_kernel(shift(key)))
        };
        let kernels = keys.par_iter().map(kernel).collect::<Result<_>>()?;
        Ok(Table { keys, kernels })
    }

    /// The kernel of a key; the table must have been built with that key.
    fn get(&self, key: K) -> &Kernel {
        &self.kernels[self.keys.partition_point(|&k| k < key)]
    }

    fn iter(&self) -> impl Iterator<Item = (K, &Kernel)> {
        self.keys.iter().copied().zip(&self.kernels)
    }
}

/// Kernels by radius step. Surfaces that face the camera have kernels of their exact shift.
pub struct Kernels {
    steps: Table<i32>,
    /// Keyed by the bits of shifts relative to infinity.
    level: Table<u32>,
}

impl Kernels {
    /// The kernels of these radius steps, and of these shifts relative to infinity.
    pub fn new(
        aperture: &Aperture,
        s_focus: f64,
        steps: BTreeSet<i32>,
        level: impl Iterator<Item = f32>,
        cancel: &Cancel,
    ) -> Result<Kernels> {
        let of_bits = |bits: u32| f64::from(f32::from_bits(bits)) - s_focus;
        Ok(Kernels {
            steps: Table::new(aperture, steps, shift, cancel)?,
            level: Table::new(aperture, level.map(f32::to_bits).collect(), of_bits, cancel)?,
        })
    }

    /// The kernel of a radius step.
    pub fn get(&self, key: i32) -> &Kernel {
        self.steps.get(key)
    }

    /// The kernel of a shift relative to infinity.
    pub fn level(&self, s: f32) -> &Kernel {
        self.level.get(s.to_bits())
    }

    /// The kernels of all radius steps.
    pub fn of_steps(&self) -> impl Iterator<Item = (i32, &Kernel)> {
        self.steps.iter()
    }

    /// The kernels of all exact shifts.
    pub fn of_shifts(&self) -> impl Iterator<Item = (f32, &Kernel)> {
        self.level.iter().map(|(bits, kernel)| (f32::from_bits(bits), kernel))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_have_the_radius_that_is_at_their_position() {
        for key in -4000..4000 {
            assert!((position(shift(key)) - f64::from(key)).abs() < 1e-9);
        }
    }
}
