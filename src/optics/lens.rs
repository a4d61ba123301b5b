//! The lens as users describe it, checked once.

use super::lens_map::LensMap;
use super::transverse::BarnDoors;
use crate::error::{Result, value_error};
use std::sync::Arc;

/// The side of the picture along which a field of view is measured, in Mitsuba's terms.
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

/// The strength of a lens over relative disparity: radius of the circle of confusion per unit of disparity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Strength {
    /// In pixels.
    Px(f64),
    /// In per cent of the picture's width.
    Percent(f64),
}

/// The size of the opening, the focus, and the mapping of the scene to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Base {
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
    /// A lens over relative disparity (for example from a network), without a metric scale.
    Relative {
        /// Radius per unit of disparity.
        strength: Strength,
        /// The disparity in focus.
        focus_disparity: f64,
    },
}

/// The position of the lens relative to the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// Angles in degrees by which the focus plane is tilted: its top away from the camera, and its right side.
    pub tilt_deg: [f64; 2],
    /// Position of the optical axis relative to the centre of the picture: widths to the right, and heights down.
    pub principal_point: [f64; 2],
    /// Length of the sensor in millimetres along the side that the field of view spans.
    pub sensor_mm: Option<f64>,
    /// Focal length in millimetres of a lens whose field of view changes with its focus.
    pub breathing_focal_length_mm: Option<f64>,
}

impl Mount {
    /// Not tilted and centred, with unspecified sensor and without breathing.
    pub const PLAIN: Mount = Mount {
        tilt_deg: [0.0; 2],
        principal_point: [0.0; 2],
        sensor_mm: None,
        breathing_focal_length_mm: None,
    };
}

/// Whether the picture darkens away from its centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Vignetting {
    /// Equally bright everywhere.
    None,
    /// It darkens by the part of the opening that the second stop clips.
    Optical,
    /// It darkens by the fourth power of the cosine of the angle to the axis.
    Natural,
    /// Both.
    Full,
}

impl Vignetting {
    /// Every kind with the name users give it.
    pub const NAMES: [(&'static str, Vignetting); 4] = [
        ("none", Vignetting::None),
        ("optical", Vignetting::Optical),
        ("natural", Vignetting::Natural),
        ("full", Vignetting::Full),
    ];

    /// Whether the light that the second stop clips is missing.
    pub fn is_optical(self) -> bool {
        matches!(self, Vignetting::Optical | Vignetting::Full)
    }

    /// Whether light falls off with the angle.
    pub fn is_natural(self) -> bool {
        matches!(self, Vignetting::Natural | Vignetting::Full)
    }
}

/// Deviations from a thin lens.
#[derive(Debug, Clone, PartialEq)]
pub struct Aberrations {
    /// Curvature of the image surface in 1/m: see [`FocusSurface`](super::FocusSurface).
    pub field_curvature: f64,
    /// The change of the disparity in focus for red, green and blue, in 1/m.
    pub axial_color: [f64; 3],
    /// Magnification of the red, green and blue pictures, minus 1.
    pub lateral_color: [f64; 3],
    /// Displacement of the second stop across the opening from the centre of the picture to its corners, in radii of
    /// the opening.
    pub cat_eye: f64,
    /// Whether the picture darkens away from its centre.
    pub vignetting: Vignetting,
    /// Length of comets in the corners, in half diagonals; see [`Transverse`](super::Transverse).
    pub coma: f64,
    /// Length of lines in the corners, in half diagonals.
    pub astigmatism: f64,
    /// A rectangular stop in front of the lens.
    pub barn_doors: Option<BarnDoors>,
    /// The lens as it was measured or traced.
    pub psf: Option<Arc<LensMap>>,
}

impl Aberrations {
    /// A thin lens.
    pub const NONE: Aberrations = Aberrations {
        field_curvature: 0.0,
        axial_color: [0.0; 3],
        lateral_color: [0.0; 3],
        cat_eye: 0.0,
        vignetting: Vignetting::None,
        coma: 0.0,
        astigmatism: 0.0,
        barn_doors: None,
        psf: None,
    };

    /// The name of the first aberration, if any, that makes rays land elsewhere than those of a thin lens, or stops some.
    pub fn transverse(&self) -> Option<&'static str> {
        let own = [
            ("coma", self.coma != 0.0),
            ("astigmatism", self.astigmatism != 0.0),
            ("barn_doors", self.barn_doors.is_some()),
            ("psf", self.psf.is_some()),
        ];
        own.into_iter().find(|(_, has)| *has).map(|(name, _)| name)
    }
}

/// A lens.
#[derive(Debug, Clone, PartialEq)]
pub struct Lens {
    /// A thin lens, or one over relative disparity.
    pub base: Base,
    /// Its position relative to the sensor.
    pub mount: Mount,
    /// Its deviations from a thin lens.
    pub aberrations: Aberrations,
    /// The nearer and the farther end of the range in focus, if that is no plane: distances in metres, or relative
    /// disparities. The focus of `base` is its middle in disparity.
    pub in_focus: Option<[f64; 2]>,
}

/// The longest comets and lines, in half diagonals.
const LONGEST: f64 = 0.25;

pub(super) fn positive(name: &str, value: f64, what: &str) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(value_error!("{name} must be {what}, a finite number greater than 0; got {value}"))
    }
}

/// Checks that all numbers are within a bound.
fn within(name: &str, values: &[f64], bound: f64, what: &str) -> Result<()> {
    match values.iter().find(|v| v.is_nan() || v.abs() > bound) {
        None => Ok(()),
        Some(v) => Err(value_error!("{name} must be {what}, from {} to {bound}; got {v}", -bound)),
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
        let base = Base::Thin { aperture_radius, focus_distance, fov, fov_axis };
        Ok(Lens { base, mount: Mount::PLAIN, aberrations: Aberrations::NONE, in_focus: None })
    }

    /// A lens over relative disparity: the radius is `strength * |disparity - focus|`.
    pub fn from_disparity(strength: Strength, focus: f64) -> Result<Lens> {
        let (name, value, what) = match strength {
            Strength::Px(v) => ("strength_px", v, "pixels"),
            Strength::Percent(v) => ("strength_percent", v, "per cent of the picture's width"),
        };
        if !(value.is_finite() && value >= 0.0) {
            return Err(value_error!(
                "{name} must be a number of {what} per unit of disparity, finite and not negative; got {value}"
            ));
        }
        if !focus.is_finite() {
            return Err(value_error!("focus must be a finite disparity; got {focus}"));
        }
        let base = Base::Relative { strength, focus_disparity: focus };
        Ok(Lens { base, mount: Mount::PLAIN, aberrations: Aberrations::NONE, in_focus: None })
    }

    /// The same lens with this mount.
    pub fn mounted(self, mount: Mount) -> Result<Lens> {
        if let Some(angle) = mount.tilt_deg.iter().find(|angle| angle.is_nan() || angle.abs() >= 90.0) {
            return Err(value_error!(
                "tilt must be two angles in degrees between -90 and 90; got {angle} for one"
            ));
        }
        within("principal_point", &mount.principal_point, 10.0, "two fractions of the width and the height")?;
        if let Some(mm) = mount.sensor_mm {
            positive("sensor_mm", mm, "a length of the sensor in millimetres")?;
        }
        if let Base::Relative { .. } = self.base {
            for (name, given) in [
                ("tilt", mount.tilt_deg != [0.0; 2]),
                ("sensor_mm", mount.sensor_mm.is_some()),
                ("breathing_focal_length_mm", mount.breathing_focal_length_mm.is_some()),
            ] {
                if given {
                    return Err(value_error!(
                        "{name} needs a metric lens; this one is over relative disparity"
                    ));
                }
            }
        }
        if let Base::Thin { focus_distance, .. } = self.base {
            if focus_distance.is_infinite() && mount.tilt_deg != [0.0; 2] {
                return Err(value_error!("tilt needs a plane in focus at a finite focus_distance; got inf"));
            }
            if let Some(mm) = mount.breathing_focal_length_mm {
                let f = positive("breathing_focal_length_mm", mm, "a focal length in millimetres")? * 1e-3;
                if focus_distance <= f {
                    return Err(value_error!(
                        "focus_distance must be greater than the focal length ({f} m) for the lens to form an \
                         image; got {focus_distance}"
                    ));
                }
                if mount.sensor_mm.is_none() {
                    return Err(value_error!("breathing_focal_length_mm needs sensor_mm"));
                }
            }
        }
        Ok(Lens { mount, ..self })
    }

    /// The same lens with these aberrations.
    pub fn with_aberrations(self, aberrations: Aberrations) -> Result<Lens> {
        within("field_curvature", &[aberrations.field_curvature], 1e6, "a curvature in 1/m")?;
        within("axial_color", &aberrations.axial_color, 1e6, "three disparities (red, green, blue)")?;
        within(
            "lateral_color",
            &aberrations.lateral_color,
            0.1,
            "three relative magnifications (red, green, blue)",
        )?;
        if !(0.0..=1.0).contains(&aberrations.cat_eye) {
            return Err(value_error!(
                "cat_eye must be how far the second stop moves, in radii of the opening, from 0 to 1; got {}",
                aberrations.cat_eye
            ));
        }
        within("coma", &[aberrations.coma], LONGEST, "a length in half diagonals of the picture")?;
        within(
            "astigmatism",
            &[aberrations.astigmatism],
            LONGEST,
            "a length in half diagonals of the picture",
        )?;
        if let Some(BarnDoors { half, moves }) = aberrations.barn_doors {
            let valid = half.iter().all(|v| (0.05..=100.0).contains(v)) && (0.0..=1.0).contains(&moves);
            if !valid {
                return Err(value_error!(
                    "barn_doors must be half the width and half the height of the stop, from 0.05 to 100 radii of the \
                     opening, and how far it moves, from 0 to 1 radius; got ({}, {}, {moves})",
                    half[0],
                    half[1]
                ));
            }
        }
        for (name, value) in [("coma", aberrations.coma), ("astigmatism", aberrations.astigmatism)] {
            if aberrations.psf.is_some() && value != 0.0 {
                return Err(value_error!(
                    "{name} must be 0 with psf, which holds all aberrations; got {value}"
                ));
            }
        }
        if aberrations.vignetting.is_optical() && aberrations.cat_eye == 0.0 {
            return Err(value_error!(
                "vignetting={:?} keeps what cat_eye clips, and cat_eye is 0",
                if aberrations.vignetting.is_natural() { "full" } else { "optical" }
            ));
        }
        if let Base::Relative { .. } = self.base {
            for (name, given) in [
                ("field_curvature", aberrations.field_curvature != 0.0),
                ("natural vignetting", aberrations.vignetting.is_natural()),
            ] {
                if given {
                    return Err(value_error!(
                        "{name} needs a metric lens; this one is over relative disparity"
                    ));
                }
            }
        }
        Ok(Lens { aberrations, ..self })
    }

    /// Focal length in pixels for a frame of this size; `None` for a lens over relative disparity, which has none.
    pub fn focal_px(&self, width: usize, height: usize) -> Option<f64> {
        match self.base {
            Base::Thin { fov, fov_axis, .. } => {
                Some(0.5 * fov_axis.extent_px(width, height) / (0.5 * fov.to_radians()).tan())
            }
            Base::Relative { .. } => None,
        }
    }

    /// The same lens with a range in focus, from its nearer to its farther end: distances in metres, of which the
    /// farther may be infinite, or relative disparities.
    ///
    /// Its own focus is from then on the plane that blurs both ends alike, the middle of their disparities.
    pub fn focused_over(&self, [near, far]: [f64; 2]) -> Result<Lens> {
        let lens = match self.base {
            Base::Thin { aperture_radius, fov, fov_axis, .. } => {
                if !(near.is_finite() && 0.0 < near && near <= far) {
                    return Err(value_error!(
                        "in_focus must be two distances in metres, the nearer and the farther, greater than 0; the \
                         farther may be infinite; got ({near}, {far})"
                    ));
                }
                // 2 / (1/near + 1/far), and exactly `near` if both are equal.
                Lens::thin(aperture_radius, near * (2.0 / (1.0 + near / far)), fov, fov_axis)
            }
            Base::Relative { strength, .. } => {
                if !(near.is_finite() && far.is_finite() && far <= near) {
                    return Err(value_error!(
                        "in_focus must be two finite disparities, that of the nearer end, which is the larger, and that \
                         of the farther; got ({near}, {far})"
                    ));
                }
                Lens::from_disparity(strength, 0.5 * near + 0.5 * far)
            }
        }?;
        let lens = lens.mounted(self.mount)?.with_aberrations(self.aberrations.clone())?;
        Ok(Lens { in_focus: Some([near, far]), ..lens })
    }

    /// The least and the greatest disparity of the range in focus, if there is one.
    pub(super) fn disparities_in_focus(&self) -> Option<[f64; 2]> {
        self.in_focus.map(|[near, far]| match self.base {
            Base::Thin { .. } => [1.0 / far, 1.0 / near],
            Base::Relative { .. } => [far, near],
        })
    }

    /// The same lens with another disparity in focus on its axis.
    pub fn focused_at_disparity(&self, d: f64) -> Result<Lens> {
        let lens = match self.base {
            Base::Thin { aperture_radius, fov, fov_axis, .. } => {
                Lens::thin(aperture_radius, 1.0 / d, fov, fov_axis)
            }
            Base::Relative { strength, .. } => Lens::from_disparity(strength, d),
        }?;
        lens.mounted(self.mount)?.with_aberrations(self.aberrations.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_values_are_named() {
        let thin = |u: f64| Lens::thin(0.1, u, 40.0, FovAxis::X).unwrap();
        let relative = Lens::from_disparity(Strength::Px(1.0), 0.0).unwrap();
        let tilted = Mount { tilt_deg: [10.0, 0.0], ..Mount::PLAIN };
        for (lens, name) in [
            (Lens::thin(-0.1, 1.0, 40.0, FovAxis::X), "aperture_radius"),
            (Lens::thin(0.1, 0.0, 40.0, FovAxis::X), "focus_distance"),
            (Lens::thin(0.1, f64::NAN, 40.0, FovAxis::X), "focus_distance"),
            (Lens::thin(0.1, 1.0, 180.0, FovAxis::X), "fov"),
            (Lens::from_disparity(Strength::Px(f64::INFINITY), 1.0), "strength_px"),
            (Lens::from_disparity(Strength::Percent(-1.0), 1.0), "strength_percent"),
            (thin(1.0).mounted(Mount { tilt_deg: [90.0, 0.0], ..Mount::PLAIN }), "tilt"),
            (thin(f64::INFINITY).mounted(tilted), "tilt"),
            (relative.clone().mounted(tilted), "tilt"),
            (thin(1.0).mounted(Mount { sensor_mm: Some(0.0), ..Mount::PLAIN }), "sensor_mm"),
            (thin(1.0).focused_over([0.0, 1.0]), "in_focus"),
            (thin(1.0).focused_over([2.0, 1.0]), "in_focus"),
            (thin(1.0).focused_over([f64::INFINITY; 2]), "in_focus"),
            (relative.focused_over([0.1, 0.2]), "in_focus"),
            (relative.focused_over([f64::NAN, 0.2]), "in_focus"),
            (thin(1.0).with_aberrations(Aberrations { cat_eye: 1.5, ..Aberrations::NONE }), "cat_eye"),
            (
                thin(1.0).with_aberrations(Aberrations { vignetting: Vignetting::Full, ..Aberrations::NONE }),
                "vignetting",
            ),
            (
                thin(1.0)
                    .with_aberrations(Aberrations { lateral_color: [0.0, 0.0, 2.0], ..Aberrations::NONE }),
                "lateral_color",
            ),
            (
                relative.with_aberrations(Aberrations { field_curvature: 1.0, ..Aberrations::NONE }),
                "field_curvature",
            ),
        ] {
            let text = lens.unwrap_err().to_string();
            assert!(text.starts_with(name), "{text}");
        }
    }

    #[test]
    fn a_range_in_focus_blurs_its_ends_alike_from_its_middle() {
        let lens = Lens::thin(0.1, 9.0, 40.0, FovAxis::X).unwrap();
        for (range, middle) in [([2.0, 2.0], 2.0), ([2.0, 6.0], 3.0), ([2.0, f64::INFINITY], 4.0)] {
            let Base::Thin { focus_distance, .. } = lens.focused_over(range).unwrap().base else { panic!() };
            assert_eq!(focus_distance, middle);
        }
        let relative =
            Lens::from_disparity(Strength::Px(1.0), 0.0).unwrap().focused_over([0.75, 0.25]).unwrap();
        assert_eq!(relative.base, Base::Relative { strength: Strength::Px(1.0), focus_disparity: 0.5 });
        assert_eq!(relative.focused_at_disparity(0.1).unwrap().in_focus, None);
    }
}
