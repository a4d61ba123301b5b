//! The disparity for which a lens is a plain one: a focus plane that faces the camera, and no bound on the blur.
//!
//! A [`FocusSurface`], a range in focus and a bound on the radius are each a map of disparity, applied in this order:
//!
//! ```text
//! d1 = d - offset(x, y)                          the focus surface is a plane that faces the camera
//! d2 = d_focus + (d1 - clamp(d1, least, most))   the range in focus is that plane
//! d3 = clamp(d2, d_focus - r/k, d_focus + r/k)   no radius |k (d - d_focus)| is larger than r
//! ```
//!
//! Each is continuous and never decreasing, so what was in front of something else is not behind it afterwards. The
//! plain lens over `d3` is the lens over `d`. So methods and kernels know of none of the three.

use super::defocus::Optics;
use super::lens::positive;
use super::surface::FocusSurface;
use crate::error::Result;

/// A bound on the radius of circles of confusion, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaxRadius(f64);

impl MaxRadius {
    /// A bound of so many pixels.
    pub fn new(px: f64) -> Result<MaxRadius> {
        positive("max_coc_px", px, "a radius in pixels").map(MaxRadius)
    }

    /// In pixels.
    pub fn px(self) -> f64 {
        self.0
    }
}

/// A range of disparity that is in focus.
#[derive(Debug, Clone, Copy, PartialEq)]
struct InFocus {
    least: f64,
    most: f64,
    /// The disparity that all of it becomes.
    d_focus: f64,
}

/// The map of one frame's disparity under one lens. It depends on the focus only as far as a range in focus and a bound
/// do; without them all pictures of a focal stack have the same map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisparityMap {
    surface: FocusSurface,
    /// The range in focus, if it is no plane.
    in_focus: Option<InFocus>,
    /// Least and greatest disparity within the bound, if there is one.
    bounded: Option<[f32; 2]>,
}

impl DisparityMap {
    /// The map under a lens with this focus surface, range in focus and bound.
    pub(super) fn new(
        optics: &Optics,
        surface: FocusSurface,
        in_focus: Option<[f64; 2]>,
        bound: Option<MaxRadius>,
    ) -> DisparityMap {
        let Optics { k, d_focus } = *optics;
        let in_focus = in_focus.map(|[least, most]| InFocus { least, most, d_focus });
        let bounded = bound.map(|bound| within(d_focus, bound.px() / k));
        DisparityMap { surface, in_focus, bounded }
    }

    /// Whether all disparities of this range stay what they are. The range is computed only if that matters.
    pub fn keeps(&self, range: impl FnOnce() -> [f32; 2]) -> bool {
        let plane = self.surface.is_facing() && self.in_focus.is_none();
        plane
            && self.bounded.is_none_or(|[least, most]| {
                let [lo, hi] = range();
                least <= lo && hi <= most
            })
    }

    /// The disparity of a point that pixel (x, y) sees at disparity `d`.
    #[inline(always)]
    pub fn at(&self, x: f64, y: f64, d: f64) -> f64 {
        let d = d - self.surface.offset(x, y);
        let d = match self.in_focus {
            Some(InFocus { least, most, d_focus }) => d_focus + (d - d.clamp(least, most)),
            None => d,
        };
        match self.bounded {
            Some([least, most]) => d.clamp(f64::from(least), f64::from(most)),
            None => d,
        }
    }
}

/// The least and the greatest `f32` that are no farther than `most` from `d`, and the one next to `d`.
///
/// Disparities are stored as `f32`. Bounds that are such numbers are kept by them exactly.
fn within(d: f64, most: f64) -> [f32; 2] {
    let (lo, hi) = (d - most, d + most);
    let (least, greatest) = (lo as f32, hi as f32);
    let least = if f64::from(least) < lo { least.next_up() } else { least };
    let greatest = if f64::from(greatest) > hi { greatest.next_down() } else { greatest };
    [least.min(d as f32), greatest.max(d as f32)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACING: FocusSurface = FocusSurface { centre: [0.0; 2], gradient: [0.0; 2], curvature: 0.0 };

    fn map(in_focus: Option<[f64; 2]>, max_px: Option<f64>) -> (Optics, DisparityMap) {
        let optics = Optics { k: 70.0, d_focus: 0.3 };
        let bound = max_px.map(|px| MaxRadius::new(px).unwrap());
        (optics, DisparityMap::new(&optics, FACING, in_focus, bound))
    }

    #[test]
    fn the_range_is_in_focus_and_the_rest_is_measured_from_its_nearer_end() {
        let (optics, map) = map(Some([0.2, 0.5]), None);
        for (d, shift) in [(0.0, -14.0), (0.1, -7.0), (0.2, 0.0), (0.4, 0.0), (0.5, 0.0), (0.7, 14.0)] {
            assert!((optics.shift_px(map.at(3.0, 4.0, d)) - shift).abs() < 1e-12, "{d}");
        }
    }

    #[test]
    fn no_radius_exceeds_the_bound_once_the_disparity_is_stored() {
        for px in [1e-9, 1e-3, 0.37, 5.1, 2048.0, 1e12] {
            let (optics, map) = map(None, Some(px));
            for d in [-1e30, -1.0, 0.0, 0.29, 0.3, 0.31, 1.0, 1e6, 1e30] {
                let stored = map.at(0.0, 0.0, d) as f32;
                let radius = optics.shift_px(f64::from(stored)).abs();
                let rounding = optics.shift_px(f64::from(0.3f32)).abs();
                assert!(radius <= px.max(rounding), "{px} {d}: {radius}");
                let plain = optics.shift_px(d).clamp(-px, px);
                assert!((optics.shift_px(f64::from(stored)) - plain).abs() <= 1e-6 * (21.0 + plain.abs()));
            }
        }
    }

    #[test]
    fn what_changes_nothing_is_known() {
        assert!(map(None, None).1.keeps(|| panic!("the range does not matter")));
        assert!(map(None, Some(7.0)).1.keeps(|| [0.21, 0.39]));
        assert!(!map(None, Some(7.0)).1.keeps(|| [0.19, 0.39]));
        assert!(!map(None, Some(7.0)).1.keeps(|| [0.21, 0.41]));
        assert!(!map(Some([0.2, 0.4]), None).1.keeps(|| [0.3, 0.3]));
        // A pinhole bounds nothing.
        let pinhole = Optics { k: 0.0, d_focus: 0.3 };
        let bound = Some(MaxRadius::new(1.0).unwrap());
        assert!(DisparityMap::new(&pinhole, FACING, None, bound).keeps(|| [-1e38, 1e38]));
    }

    #[test]
    fn bounds_that_are_none_are_named() {
        for px in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(MaxRadius::new(px).unwrap_err().to_string().starts_with("max_coc_px must be"));
        }
    }
}
