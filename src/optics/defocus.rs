//! The defocus of a surface: the circle of confusion from two numbers.

/// The lens for one frame size: `t = k (d - d_focus)`.
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

    /// Signed distance in metres from the focus plane at disparity `d`, positive behind it; only for metric scenes.
    pub fn beyond_focus_m(&self, d: f64) -> f64 {
        // Both distances may be infinite.
        if d == self.d_focus { 0.0 } else { 1.0 / d - 1.0 / self.d_focus }
    }

    /// The radius of the largest circle of confusion in a frame with disparities in this range. The shift is linear
    /// in disparity, so it is largest at one end of the range.
    pub fn largest_radius_px(&self, disparities: [f32; 2]) -> f64 {
        disparities.map(|d| self.shift_px(f64::from(d)).abs()).into_iter().fold(0.0, f64::max)
    }

    /// The distance in metres whose circle of confusion has this signed radius, positive behind the focus; infinite if
    /// no distance has so large a one. Of a metric scene only.
    pub fn distance_m(&self, radius_px: f64) -> f64 {
        let disparity = self.d_focus - radius_px / self.k;
        if disparity > 0.0 { 1.0 / disparity } else { f64::INFINITY }
    }

    /// The nearest and the farthest distance in metres no more blurred than this radius. Of a metric scene only.
    pub fn limits_m(&self, radius_px: f64) -> (f64, f64) {
        if self.k == 0.0 {
            return (0.0, f64::INFINITY);
        }
        (self.distance_m(-radius_px), self.distance_m(radius_px))
    }

    /// The nearest distance in focus, in metres, that leaves infinity no more blurred than this radius: `k / radius`.
    pub fn hyperfocal_m(&self, radius_px: f64) -> f64 {
        self.k / radius_px
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

/// The measure of the distance of a surface from the focus plane.
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
    /// The measure that is multiplied.
    pub measure: Measure,
    /// The factor; it includes the strength of the lens.
    pub scale: f64,
    /// Disparity in focus.
    pub d_focus: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_of_sharpness_have_the_radius_that_was_asked_for() {
        let optics = Optics { k: 60.0, d_focus: 0.5 };
        let (near, far) = optics.limits_m(2.0);
        for (z, radius) in [(near, -2.0), (far, 2.0)] {
            assert!((optics.shift_px(1.0 / z) + radius).abs() < 1e-9);
        }
        // Focused at the hyperfocal distance, infinity is just as blurred as that.
        let focused = Optics { d_focus: 1.0 / optics.hyperfocal_m(2.0), ..optics };
        assert!((focused.shift_px(0.0) + 2.0).abs() < 1e-9);
        assert_eq!(optics.limits_m(31.0).1, f64::INFINITY);
        assert_eq!(Optics { k: 0.0, ..optics }.limits_m(1.0), (0.0, f64::INFINITY));
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
}
