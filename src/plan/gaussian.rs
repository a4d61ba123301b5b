//! One wide separable blur of a half-size copy, composited over the picture by blurriness.
//!
//! After the second half of Riguer, Tatarchuk and Isidoro, "Real-Time Depth of Field Simulation", ShaderX2. The blur
//! along x weighs every tap by the amount by which the tap's own blurriness exceeds a threshold that grows with
//! distance, so that sharp surfaces do not spread. The sum of these weights is kept for each pixel, and weighs it in
//! the blur along y. The result is composited over the picture by each pixel's blurriness.
//!
//! The listings have slips, corrected here: along x the third tap on one side takes the first tap's threshold and the
//! second tap on the other side the first one's colour; along y the fourth tap on one side takes the fifth one's
//! colour. The tables of x and y are the article's, and differ: see [`sigma_px`]. The article interpolates colours
//! and weights of the first blur separately; here weighted colours are interpolated, so that a texel without weight
//! contributes no colour either.

use crate::error::{Result, value_error};
use crate::optics::{Defocus, Measure, Optics};

/// Distances of the taps from the centre, in texels of the half-size copy: each tap reads two texels at once.
const OFFSETS: [f64; 6] = [1.3366, 3.4295, 5.4264, 7.4359, 9.4436, 11.4401];
/// The blurriness above which the centre and each tap count along x. The centre always counts a little.
const THRESHOLDS: [f64; 7] = [-0.01, 0.1, 0.3, 0.5, 0.6, 0.7, 0.8];
/// Weights of the centre and of each tap along y.
const WEIGHTS: [f64; 7] = [0.100, 0.080, 0.075, 0.070, 0.065, 0.060, 0.055];

/// Number of texels of the half-size copy that the blur reaches on every side.
pub const REACH: usize = 12;

/// How blurriness is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Blurriness {
    /// The radius of the circle of confusion, divided by this value.
    CircleOfConfusion { max_coc_px: f64 },
    /// The distance from the focus plane, divided by this value.
    Range { range_m: f64 },
}

/// The choices of the caller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    blurriness: Blurriness,
}

impl Settings {
    /// The radius of the disc that spreads light as far as the blur does, to a pixel.
    pub const MAX_COC_PX: f64 = 24.0;

    /// Blur is full from this distance from the focus plane on, in metres, or from this radius of the circle of
    /// confusion on.
    pub fn new(focal_range: Option<f64>, max_coc_px: Option<f64>) -> Result<Settings> {
        let positive = |name: &str, what: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(value)
            } else {
                Err(value_error!("{name} must be {what}, finite and greater than 0; got {value}"))
            }
        };
        let blurriness = match (focal_range, max_coc_px) {
            (Some(_), Some(_)) => {
                return Err(value_error!(
                    "focal_range and max_coc_px are two measures of the same; only one may be given"
                ));
            }
            (Some(range), None) => {
                Blurriness::Range { range_m: positive("focal_range", "a distance in metres", range)? }
            }
            (None, max_coc_px) => Blurriness::CircleOfConfusion {
                max_coc_px: positive(
                    "max_coc_px",
                    "a radius in pixels",
                    max_coc_px.unwrap_or(Self::MAX_COC_PX),
                )?,
            },
        };
        Ok(Settings { blurriness })
    }

    /// The option that is in metres, if it is used.
    pub fn metric_option(&self) -> Option<&'static str> {
        matches!(self.blurriness, Blurriness::Range { .. }).then_some("focal_range")
    }
}

/// A tap along x. It lies between texels `whole` and `whole + 1`, on both sides of the centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tap {
    /// Number of whole texels from the centre.
    pub whole: usize,
    /// The fraction of a texel beyond them.
    pub fraction: f32,
    /// The blurriness above which it counts.
    pub threshold: f32,
}

/// The plan, which is the same for every pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Threshold of the centre along x.
    pub centre_threshold: f32,
    /// Taps along x, on both sides.
    pub taps: [Tap; 6],
    /// Weights of the texels along y by their distance. The weight of a tap between two texels is divided between
    /// them.
    pub weights: [f32; REACH + 1],
    blurriness: Blurriness,
    optics: Optics,
}

impl Plan {
    /// The plan for one lens.
    pub fn new(settings: &Settings, optics: &Optics) -> Plan {
        let taps = std::array::from_fn(|i| Tap {
            whole: OFFSETS[i] as usize,
            fraction: OFFSETS[i].fract() as f32,
            threshold: THRESHOLDS[i + 1] as f32,
        });
        Plan {
            centre_threshold: THRESHOLDS[0] as f32,
            taps,
            weights: texel_weights(&WEIGHTS).map(|w| w as f32),
            blurriness: settings.blurriness,
            optics: *optics,
        }
    }

    /// Blurriness of a surface of disparity `d`, 0 to 1.
    #[inline(always)]
    pub fn blurriness(&self, d: f32) -> f32 {
        let d = f64::from(d);
        let blurriness = match self.blurriness {
            Blurriness::CircleOfConfusion { max_coc_px } => self.optics.shift_px(d).abs() / max_coc_px,
            Blurriness::Range { range_m } => self.optics.beyond_focus_m(d).abs() / range_m,
        };
        blurriness.min(1.0) as f32
    }

    /// The signed quantity whose magnitude, limited to 1, is the blurriness.
    pub fn defocus(&self) -> Defocus {
        match self.blurriness {
            Blurriness::CircleOfConfusion { max_coc_px } => {
                self.optics.defocus(Measure::Shift, 1.0 / max_coc_px)
            }
            Blurriness::Range { range_m } => self.optics.defocus(Measure::Distance, 1.0 / range_m),
        }
    }
}

/// Weights of the texels by their distance, from the weights of the centre and of the taps between two texels.
fn texel_weights(taps: &[f64; 7]) -> [f64; REACH + 1] {
    let mut weights = [0.0; REACH + 1];
    weights[0] = taps[0];
    for (offset, weight) in OFFSETS.iter().zip(&taps[1..]) {
        weights[*offset as usize] += weight * (1.0 - offset.fract());
        weights[*offset as usize + 1] += weight * offset.fract();
    }
    weights
}

/// Standard deviation along x and y, in pixels of the picture, of the image of a fully blurred point.
pub fn sigma_px() -> [f64; 2] {
    let variance = |taps: &[f64; 7]| {
        let weights = texel_weights(taps);
        let sides = || weights.iter().enumerate().skip(1);
        let total = weights[0] + 2.0 * sides().map(|(_, w)| w).sum::<f64>();
        2.0 * sides().map(|(i, w)| (i * i) as f64 * w).sum::<f64>() / total
    };
    // Halving the size averages two pixels, 1/4 px^2. Returning to full size interpolates a quarter between texels,
    // 3/16 texel^2.
    let whole = |texels: f64| (4.0 * (texels + 3.0 / 16.0) + 0.25).sqrt();
    [variance(&THRESHOLDS.map(|t| (1.0 - t).min(1.0))), variance(&WEIGHTS)].map(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_blur_spreads_light_as_the_largest_circle_does() {
        let [x, y] = sigma_px();
        assert!((x - 10.75).abs() < 0.01 && (y - 13.07).abs() < 0.01, "{x} {y}");
        // A disc of radius r has the variance r^2 / 4 along each axis.
        let radius = 2.0 * (0.5 * (x * x + y * y)).sqrt();
        assert!((radius - Settings::MAX_COC_PX).abs() < 0.5, "{radius}");
    }

    #[test]
    fn blurriness_is_a_share_of_the_range_or_of_the_circle() {
        let optics = Optics { k: 12.0, d_focus: 0.5 };
        let plan = |range, coc| Plan::new(&Settings::new(range, coc).unwrap(), &optics);
        assert_eq!([0.5, 0.25, 1.0, 0.0].map(|d| plan(Some(4.0), None).blurriness(d)), [0.0, 0.5, 0.25, 1.0]);
        assert_eq!([0.5, 0.0, 1.0, 9.0].map(|d| plan(None, None).blurriness(d)), [0.0, 0.25, 0.25, 1.0]);
        assert_eq!(plan(None, Some(3.0)).blurriness(0.75), 1.0);
    }

    #[test]
    fn bad_values_are_named() {
        for (settings, start) in [
            (Settings::new(Some(0.0), None), "focal_range must be"),
            (Settings::new(None, Some(f64::NAN)), "max_coc_px must be"),
            (Settings::new(Some(1.0), Some(1.0)), "focal_range and max_coc_px"),
        ] {
            let text = settings.unwrap_err().to_string();
            assert!(text.starts_with(start), "{text}");
        }
    }
}
