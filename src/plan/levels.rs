//! A picture between filter levels: a chain of blurs, three of whose targets are interpolated by circle of confusion.
//!
//! After "Depth of Field: Controlling Camera Parameters" (B. Dudash, NVIDIA SDK White Paper WP-01396-001, 2004). The
//! picture is filtered five times in a row; each filter reads the previous target. With the circle of confusion of
//! the paper's equation 1, which is that of the thin lens in [`optics`](crate::optics), the value
//!
//! ```text
//! x = clamp(diameter / c0 - 1, 0, 1)          0 at diameter c0 or less, 1 at 2 c0 or more
//! ```
//!
//! interpolates between three targets: the picture itself at 0, the third target at 1/2 and the fifth at 1. The paper
//! says that a diameter of `c0` is both 0 and 0.5; the first is followed here. Then 0.5 is a diameter of 1.5 `c0`,
//! which is just what the third of five equal steps represents: variances of blurs in a row add, a disc's variance
//! grows with the square of its diameter, and 3/5 of the fifth target's variance is that of a disc of 1.55 `c0`. The
//! paper looks `x` up in a table over the distances of the camera and the focus because its shaders could not compute
//! it.
//!
//! The paper leaves the filter open. Here the fifth target has the variance of the disc of diameter `2 c0`, filtered at
//! a scale at which five look-ups along each axis are enough.

use crate::error::{Result, value_error};
use crate::optics::{Defocus, Measure, Optics};

/// Number of filter steps; see [`KEPT`].
pub const STEPS: usize = 5;
/// The step whose target is half-way to the last.
pub const KEPT: usize = 3;

/// The choices of the caller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    c0_px: Option<f64>,
}

/// The largest diameter at which blur may begin. A wider filter is slow, and one wrong depth, for example a millionth
/// of a metre instead of missing depth, would otherwise ask for a filter of any width.
const MAX_C0_PX: f64 = 1024.0;

impl Settings {
    /// The diameter in pixels at which blur begins. The default is half of the frame's largest circle of confusion,
    /// up to [`MAX_C0_PX`].
    pub fn new(c0_px: Option<f64>) -> Result<Settings> {
        if let Some(c0) = c0_px
            && !(0.5..=MAX_C0_PX).contains(&c0)
        {
            return Err(value_error!("c0_px must be a diameter in pixels from 0.5 to {MAX_C0_PX}; got {c0}"));
        }
        Ok(Settings { c0_px })
    }
}

/// The chain of filters, and the interpolation between its targets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// The picture is filtered at one over this of its size along each axis; a power of two.
    pub scale: usize,
    /// Weights of a filter step along either axis: of the centre, of the two look-ups beside it, and of the two
    /// beyond.
    pub weights: [f32; 3],
    /// The increase of `x` per pixel of the circle of confusion's radius, from `x = -1` at radius 0.
    x_per_px: f64,
}

impl Plan {
    /// The plan for a frame whose largest circle of confusion has this radius.
    pub fn new(settings: &Settings, largest_radius_px: f64) -> Plan {
        let c0 = settings
            .c0_px
            .unwrap_or_else(|| if largest_radius_px > 0.5 { largest_radius_px.min(MAX_C0_PX) } else { 0.5 });
        // At this size the standard deviation of the last target is at least 1.35 pixels, smooth enough to
        // interpolate.
        let scale = 1 << (c0 / 2.7).max(1.0).log2() as usize;
        let s = scale as f64;
        // Averaging blocks of s pixels moves light by the variance (s^2 - 1) / 12. Interpolating between the blocks
        // moves it by s^2 / 6 + 1 / 12, averaged over a block.
        let resampled = if scale > 1 { 0.25 * s * s } else { 0.0 };
        // Along each axis, the variance of a disc is a sixteenth of its diameter squared.
        let disc = (2.0 * c0).powi(2) / 16.0;
        let step = (disc - resampled) / STEPS as f64 / (s * s);
        // The filter (a, 1 - 2 a, a) has the variance 2 a, and applied twice 4 a.
        let (side, middle) = (0.25 * step, 1.0 - 0.5 * step);
        let weights = [middle * middle + 2.0 * side * side, 2.0 * side * middle, side * side];
        Plan { scale, weights: weights.map(|w| w as f32), x_per_px: 2.0 / c0 }
    }

    /// The position of a pixel with this circle of confusion between the first target (0) and the last (1).
    #[inline(always)]
    pub fn level(&self, radius_px: f32) -> f32 {
        let x = radius_px * self.x_per_px as f32 - 1.0;
        let x = if x > 0.0 { x } else { 0.0 };
        if x < 1.0 { x } else { 1.0 }
    }

    /// The signed quantity whose magnitude is `x + 1`, before `x` is limited to 0 and 1.
    pub fn beginning(&self, optics: &Optics) -> Defocus {
        optics.defocus(Measure::Shift, self.x_per_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_begin_at_c0_and_end_at_twice_that() {
        let plan = Plan::new(&Settings::new(Some(10.0)).unwrap(), 99.0);
        let at = |diameter: f32| plan.level(0.5 * diameter);
        assert_eq!([0.0, 9.0, 10.0, 15.0, 20.0, 90.0].map(at), [0.0, 0.0, 0.0, 0.5, 1.0, 1.0]);
    }

    #[test]
    fn filters_stay_positive_and_narrow_at_every_width() {
        for c0 in [0.5, 1.0, 2.6, 2.7, 5.3, 5.4, 10.7, 10.8, 33.0, 1024.0] {
            let plan = Plan::new(&Settings::new(Some(c0)).unwrap(), 0.0);
            let [middle, beside, beyond] = plan.weights;
            assert!(middle > beside && beside > beyond && beyond > 0.0, "{c0}: {plan:?}");
            assert!((middle + 2.0 * (beside + beyond) - 1.0).abs() < 1e-6);
            assert!(plan.scale.is_power_of_two() && plan.scale as f64 <= (c0 / 2.7).max(1.0));
        }
    }

    #[test]
    fn the_last_target_is_the_largest_blur_unless_told_otherwise() {
        let plan = |radius| Plan::new(&Settings::new(None).unwrap(), radius);
        assert_eq!(plan(12.0), Plan::new(&Settings::new(Some(12.0)).unwrap(), 1.0));
        assert_eq!(plan(12.0).level(12.0), 1.0);
        assert_eq!(plan(0.0).level(0.0), 0.0);
        assert_eq!(plan(1e9), plan(MAX_C0_PX));
        assert_eq!(plan(1e9).level(1e9), 1.0);
    }

    #[test]
    fn a_width_that_is_none_is_named() {
        for c0 in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Settings::new(Some(c0)).unwrap_err().to_string().starts_with("c0_px"));
        }
    }
}
