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
    fn distances_from_the_focus_are_signed_and_may_be_infinite() {
        let at = |focus: f64| Optics { k: 1.0, d_focus: 1.0 / focus };
        assert_eq!(at(2.0).beyond_focus_m(0.25), 2.0);
        assert_eq!(at(2.0).beyond_focus_m(1.0), -1.0);
        assert_eq!(at(2.0).beyond_focus_m(0.0), f64::INFINITY);
        assert_eq!(at(f64::INFINITY).beyond_focus_m(0.0), 0.0);
        assert_eq!(at(f64::INFINITY).beyond_focus_m(1.0), f64::NEG_INFINITY);
    }
}
