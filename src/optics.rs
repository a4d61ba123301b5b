//! The thin lens, in one place and in `f64`.
//!
//! With disparity `d = 1/z` the circle of confusion is linear in disparity. Everything else in the crate works
//! in *shift* units: `s = k d` is a disparity in pixels of circle of confusion, and
//!
//! ```text
//! t = k (d - d_focus)            signed shift in pixels: > 0 in front of the focus plane
//! radius_px = -t                 the signed radius the public `coc` reports: > 0 behind the focus plane
//! q(d) = p + t l                 where the ray through output pixel p and lens point l, |l| <= 1, meets d
//! ```
//!
//! so a whole frame needs two numbers, `k` and `d_focus`, and no kernel ever sees a focal length.

use crate::error::{Result, value_error};

/// The side of the picture that a field of view is measured along, in Mitsuba's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FovAxis {
    /// The width.
    X,
    /// The height.
    Y,
    /// From corner to corner.
    Diagonal,
    /// The shorter side.
    Smaller,
    /// The longer side.
    Larger,
}

impl FovAxis {
    /// Every axis with the name users give it.
    pub const NAMES: [(&'static str, FovAxis); 5] = [
        ("x", FovAxis::X),
        ("y", FovAxis::Y),
        ("diagonal", FovAxis::Diagonal),
        ("smaller", FovAxis::Smaller),
        ("larger", FovAxis::Larger),
    ];

    /// Length in pixels of the side that the field of view spans.
    fn extent_px(self, width: usize, height: usize) -> f64 {
        let (w, h) = (width as f64, height as f64);
        match self {
            FovAxis::X => w,
            FovAxis::Y => h,
            FovAxis::Diagonal => w.hypot(h),
            FovAxis::Smaller => w.min(h),
            FovAxis::Larger => w.max(h),
        }
    }
}

/// A lens: how wide it is open, where it is focused and how it maps the scene to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// A thin lens in a metric scene.
    Thin {
        /// Radius of the entrance pupil in metres.
        aperture_radius: f64,
        /// Distance of the plane in focus, along the optical axis, in metres; may be infinite.
        focus_distance: f64,
        /// Field of view in degrees along `fov_axis`.
        fov: f64,
        /// The side that `fov` spans.
        fov_axis: FovAxis,
    },
    /// A lens over relative disparity (from a network, say) with no metric claim.
    Relative {
        /// Circle-of-confusion radius in pixels per unit of disparity.
        strength_px: f64,
        /// The disparity in focus.
        focus_disparity: f64,
    },
}

/// What a lens means for one frame size: `t = k (d - d_focus)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optics {
    /// Pixels of circle-of-confusion radius per unit of disparity.
    pub k: f64,
    /// Disparity in focus.
    pub d_focus: f64,
}

impl Optics {
    /// Signed shift in pixels at disparity `d`: positive in front of the focus plane.
    #[inline(always)]
    pub fn shift_px(&self, d: f64) -> f64 {
        self.k * (d - self.d_focus)
    }

    /// Signed distance in metres from the focus plane at disparity `d`, positive behind it; of a metric scene only.
    pub fn beyond_focus_m(&self, d: f64) -> f64 {
        // Both may be infinitely far away.
        if d == self.d_focus { 0.0 } else { 1.0 / d - 1.0 / self.d_focus }
    }
}

/// What the distance of a surface from the focus plane is measured by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// The shift in pixels.
    Shift = 0,
    /// The distance along the optical axis in metres.
    Distance = 1,
}

/// A multiple of a surface's distance from the focus plane, as plain numbers: `scale (d - d_focus)` or
/// `scale (1/d - 1/d_focus)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defocus {
    /// What is multiplied.
    pub measure: Measure,
    /// By what; the lens's own strength is in it.
    pub scale: f64,
    /// Disparity in focus.
    pub d_focus: f64,
}

impl Optics {
    /// The radius of the largest circle of confusion in a frame with disparities in this range. The shift is linear in
    /// disparity, so that it is largest at one end.
    pub fn largest_radius_px(&self, disparities: [f32; 2]) -> f64 {
        disparities.map(|d| self.shift_px(f64::from(d)).abs()).into_iter().fold(0.0, f64::max)
    }

    /// `factor` times the distance from the focus plane.
    pub fn defocus(&self, measure: Measure, factor: f64) -> Defocus {
        let scale = match measure {
            Measure::Shift => self.k * factor,
            Measure::Distance => factor,
        };
        Defocus { measure, scale, d_focus: self.d_focus }
    }
}

fn positive(name: &str, value: f64, what: &str) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(value_error!("{name} must be {what}, a finite number greater than 0; got {value}"))
    }
}

impl Lens {
    /// A thin lens in Mitsuba's terms: metres and degrees.
    pub fn thin(aperture_radius: f64, focus_distance: f64, fov: f64, fov_axis: FovAxis) -> Result<Lens> {
        if !(aperture_radius.is_finite() && aperture_radius >= 0.0) {
            return Err(value_error!(
                "aperture_radius must be a radius in metres, finite and not negative; got {aperture_radius}"
            ));
        }
        if focus_distance.is_nan() || focus_distance <= 0.0 {
            return Err(value_error!(
                "focus_distance must be a distance in metres greater than 0 (infinity is allowed); \
                 got {focus_distance}"
            ));
        }
        if !(fov.is_finite() && fov > 0.0 && fov < 180.0) {
            return Err(value_error!("fov must be an angle in degrees between 0 and 180; got {fov}"));
        }
        Ok(Lens::Thin { aperture_radius, focus_distance, fov, fov_axis })
    }

    /// A photographic lens: focal length, f-number, focus distance and sensor width.
    ///
    /// The image distance is `v = f u / (u - f)`, so the field of view narrows as the focus comes closer,
    /// as it does for a real lens that focuses by moving as a whole. With `aperture_radius = f / (2 N)` and
    /// `focal_px = width v / sensor_width` the circle of confusion on the sensor is the textbook
    /// `b = (f/N) f |u - z| / (z (u - f))`.
    pub fn from_camera(
        focal_length_mm: f64,
        f_number: f64,
        focus_distance: f64,
        sensor_width_mm: f64,
    ) -> Result<Lens> {
        let f = positive("focal_length_mm", focal_length_mm, "a focal length in millimetres")? * 1e-3;
        let n = positive("f_number", f_number, "an f-number")?;
        let sensor = positive("sensor_width_mm", sensor_width_mm, "a sensor width in millimetres")? * 1e-3;
        if focus_distance.is_nan() || focus_distance <= f {
            return Err(value_error!(
                "focus_distance must be greater than the focal length ({f} m) for the lens to form an image; \
                 got {focus_distance}"
            ));
        }
        let image_distance =
            if focus_distance.is_infinite() { f } else { f * focus_distance / (focus_distance - f) };
        let fov = 2.0 * (0.5 * sensor / image_distance).atan().to_degrees();
        Lens::thin(f / (2.0 * n), focus_distance, fov, FovAxis::X)
    }

    /// A lens over relative disparity: `radius_px = strength_px * |disparity - focus|`.
    pub fn from_disparity(strength_px: f64, focus: f64) -> Result<Lens> {
        if !(strength_px.is_finite() && strength_px >= 0.0) {
            return Err(value_error!(
                "strength_px must be a number of pixels per unit of disparity, finite and not negative; \
                 got {strength_px}"
            ));
        }
        if !focus.is_finite() {
            return Err(value_error!("focus must be a finite disparity; got {focus}"));
        }
        Ok(Lens::Relative { strength_px, focus_disparity: focus })
    }

    /// Focal length in pixels for a frame of this size; `None` for a relative lens, which has none.
    pub fn focal_px(&self, width: usize, height: usize) -> Option<f64> {
        match *self {
            Lens::Thin { fov, fov_axis, .. } => {
                Some(0.5 * fov_axis.extent_px(width, height) / (0.5 * fov.to_radians()).tan())
            }
            Lens::Relative { .. } => None,
        }
    }

    /// The two numbers that a frame of this size needs.
    pub fn optics(&self, width: usize, height: usize) -> Optics {
        match *self {
            Lens::Thin { aperture_radius, focus_distance, .. } => Optics {
                k: aperture_radius * self.focal_px(width, height).unwrap_or(0.0),
                d_focus: 1.0 / focus_distance,
            },
            Lens::Relative { strength_px, focus_disparity } => {
                Optics { k: strength_px, d_focus: focus_disparity }
            }
        }
    }

    /// The same lens focused at disparity `d` of the scene.
    pub fn focused_at_disparity(&self, d: f64) -> Result<Lens> {
        match *self {
            Lens::Thin { aperture_radius, fov, fov_axis, .. } => {
                Lens::thin(aperture_radius, 1.0 / d, fov, fov_axis)
            }
            Lens::Relative { strength_px, .. } => Lens::from_disparity(strength_px, d),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_gives_the_textbook_circle_of_confusion() {
        let (f_mm, n, u, sensor_mm, width) = (50.0, 1.8, 3.0, 36.0, 1920);
        let lens = Lens::from_camera(f_mm, n, u, sensor_mm).unwrap();
        let optics = lens.optics(width, 1080);
        let f = f_mm * 1e-3;
        for z in [0.7, 1.5, 2.9, 3.0, 4.2, 100.0] {
            let diameter_m = (f / n) * f * (u - z) / (z * (u - f));
            let radius_px = 0.5 * diameter_m / (sensor_mm * 1e-3) * width as f64;
            let shift = optics.shift_px(1.0 / z);
            assert!((shift - radius_px).abs() < 1e-9, "z = {z}: {shift} against {radius_px}");
        }
    }

    #[test]
    fn distances_from_the_focus_are_signed_and_may_be_infinite() {
        let at = |focus: f64| Optics { k: 1.0, d_focus: 1.0 / focus };
        assert_eq!(at(2.0).beyond_focus_m(0.25), 2.0);
        assert_eq!(at(2.0).beyond_focus_m(1.0), -1.0);
        assert_eq!(at(2.0).beyond_focus_m(0.0), f64::INFINITY);
        assert_eq!(at(f64::INFINITY).beyond_focus_m(0.0), 0.0);
        assert_eq!(at(f64::INFINITY).beyond_focus_m(1.0), f64::NEG_INFINITY);
    }

    #[test]
    fn bad_values_are_named() {
        for (lens, name) in [
            (Lens::thin(-0.1, 1.0, 40.0, FovAxis::X), "aperture_radius"),
            (Lens::thin(0.1, 0.0, 40.0, FovAxis::X), "focus_distance"),
            (Lens::thin(0.1, f64::NAN, 40.0, FovAxis::X), "focus_distance"),
            (Lens::thin(0.1, 1.0, 180.0, FovAxis::X), "fov"),
            (Lens::from_camera(50.0, 0.0, 1.0, 36.0), "f_number"),
            (Lens::from_camera(50.0, 2.0, 0.04, 36.0), "focus_distance"),
            (Lens::from_disparity(f64::INFINITY, 1.0), "strength_px"),
        ] {
            let text = lens.unwrap_err().to_string();
            assert!(text.starts_with(name), "{text}");
        }
    }
}
