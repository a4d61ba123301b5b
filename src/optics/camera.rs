//! Cameras: a lens of some focal length and f-number in front of a sensor of some size.

use super::lens::{Base, FovAxis, Lens, Mount, positive};
use crate::error::{Result, value_error};

/// The size of a sensor in millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Width in millimetres.
    pub width_mm: f64,
    /// Height in millimetres.
    pub height_mm: f64,
}

const fn sensor(width_mm: f64, height_mm: f64) -> Sensor {
    Sensor { width_mm, height_mm }
}

/// Sensors by name. The sensors of individual makers differ by some tenths of a millimetre.
pub const SENSORS: [(&str, Sensor); 11] = [
    ("medium format", sensor(43.8, 32.9)),
    ("full frame", sensor(36.0, 24.0)),
    ("super 35", sensor(24.89, 18.66)),
    ("aps-c", sensor(23.6, 15.7)),
    ("aps-c canon", sensor(22.3, 14.9)),
    ("micro four thirds", sensor(17.3, 13.0)),
    ("1-inch", sensor(13.2, 8.8)),
    ("super 16", sensor(12.52, 7.41)),
    ("phone 1/1.3", sensor(9.8, 7.3)),
    ("phone", sensor(7.6, 5.7)),
    ("phone 1/2.55", sensor(5.6, 4.2)),
];

impl Lens {
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
        let fov = 2.0 * (0.5 * sensor / image_distance(f, focus_distance)).atan().to_degrees();
        let lens = Lens::thin(f / (2.0 * n), focus_distance, fov, FovAxis::X)?;
        lens.mounted(Mount { sensor_mm: Some(sensor_width_mm), ..Mount::PLAIN })
    }

    /// The same lens with focus breathing: from now on its field of view changes with its focus, as its focal length
    /// implies.
    pub fn breathing(self) -> Result<Lens> {
        let focal_length_mm = self.focal_length_mm("breathing")?;
        let mount = self.mount;
        self.mounted(Mount { breathing_focal_length_mm: Some(focal_length_mm), ..mount })
    }

    /// Aperture radius and focus distance in metres, and the distance in metres of the image behind the lens. `what`
    /// names the caller in errors.
    fn metric(&self, what: &str) -> Result<(f64, f64, f64)> {
        match (self.base, self.mount) {
            (Base::Thin { aperture_radius, focus_distance, .. }, mount) if mount.sensor_mm.is_some() => {
                let picture = self.picture_distance_mm().unwrap_or_default() * 1e-3;
                let v = match mount.breathing_focal_length_mm {
                    Some(mm) => image_distance(mm * 1e-3, focus_distance),
                    None => picture,
                };
                Ok((aperture_radius, focus_distance, v))
            }
            _ => Err(value_error!(
                "{what} needs a lens whose sensor is known: Lens.from_camera, or a metric lens with sensor_mm"
            )),
        }
    }

    /// Distance in millimetres of a sensor that the picture's field of view fills.
    fn picture_distance_mm(&self) -> Option<f64> {
        match self.base {
            Base::Thin { fov, .. } => {
                self.mount.sensor_mm.map(|sensor| 0.5 * sensor / (0.5 * fov.to_radians()).tan())
            }
            Base::Relative { .. } => None,
        }
    }

    /// The magnification of the picture at the present focus of the lens: 1 unless it breathes.
    pub(super) fn magnification(&self) -> f64 {
        match (self.mount.breathing_focal_length_mm, self.base, self.picture_distance_mm()) {
            (Some(mm), Base::Thin { focus_distance, .. }, Some(picture)) => {
                image_distance(mm * 1e-3, focus_distance) * 1e3 / picture
            }
            _ => 1.0,
        }
    }

    /// Focal length in millimetres: `1/f = 1/u + 1/v`.
    pub fn focal_length_mm(&self, what: &str) -> Result<f64> {
        let (_, u, v) = self.metric(what)?;
        Ok(1e3 / (1.0 / u + 1.0 / v))
    }

    /// Focal length divided by the diameter of the opening.
    pub fn f_number(&self, what: &str) -> Result<f64> {
        let (aperture_radius, ..) = self.metric(what)?;
        Ok(1e-3 * self.focal_length_mm(what)? / (2.0 * aperture_radius))
    }

    /// Diameter in millimetres, on the sensor, of the circle of confusion of a point at depth `z`.
    pub fn coc_diameter_mm(&self, z: f64) -> Result<f64> {
        let (aperture_radius, u, v) = self.metric("coc_diameter_mm")?;
        if z.is_nan() || z <= 0.0 {
            return Err(value_error!("z must be a depth in metres greater than 0; got {z}"));
        }
        let [farthest, nearest] = self.disparities_in_focus().unwrap_or([1.0 / u; 2]);
        Ok(2e3 * aperture_radius * v * ((1.0 / z).clamp(farthest, nearest) - 1.0 / z).abs())
    }

    /// The nearest focus at which the blur of infinity is no larger than `coc_limit_mm`: `f^2 / (N c) + f`.
    pub fn hyperfocal_distance(&self, coc_limit_mm: f64) -> Result<f64> {
        let (aperture_radius, ..) = self.metric("hyperfocal_distance")?;
        let c = positive("coc_limit_mm", coc_limit_mm, "a diameter in millimetres")?;
        let f = self.focal_length_mm("hyperfocal_distance")?;
        // f^2 / N is f times the diameter of the opening.
        Ok(2.0 * aperture_radius * f / c + f * 1e-3)
    }

    /// Nearest and farthest depth whose blur is no larger than `coc_limit_mm`. The blur is linear in `1/z`, so both
    /// are `c / (2 A v)` from what is in focus.
    pub fn depth_of_field(&self, coc_limit_mm: f64) -> Result<(f64, f64)> {
        let (aperture_radius, u, v) = self.metric("depth_of_field")?;
        let c = positive("coc_limit_mm", coc_limit_mm, "a diameter in millimetres")? * 1e-3;
        let apart = c / (2.0 * aperture_radius * v);
        let [farthest, nearest] = self.disparities_in_focus().unwrap_or([1.0 / u; 2]);
        let far = farthest - apart;
        Ok((1.0 / (nearest + apart), if far > 0.0 { 1.0 / far } else { f64::INFINITY }))
    }
}

/// The image distance of a point at distance `u` for a lens of focal length `f`, all in metres.
fn image_distance(f: f64, u: f64) -> f64 {
    if u.is_infinite() { f } else { f * u / (u - f) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Frame;

    #[test]
    fn camera_gives_the_textbook_circle_of_confusion() {
        let (f_mm, n, u, sensor_mm, width) = (50.0, 1.8, 3.0, 36.0, 1920);
        let lens = Lens::from_camera(f_mm, n, u, sensor_mm).unwrap();
        let optics = Frame::plain(width, 1080).optics(&lens);
        let f = f_mm * 1e-3;
        for z in [0.7, 1.5, 2.9, 3.0, 4.2, 100.0] {
            let diameter_m = (f / n) * f * (u - z) / (z * (u - f));
            let radius_px = 0.5 * diameter_m / (sensor_mm * 1e-3) * width as f64;
            let shift = optics.shift_px(1.0 / z);
            assert!((shift - radius_px).abs() < 1e-9, "z = {z}: {shift} against {radius_px}");
            let on_sensor = lens.coc_diameter_mm(z).unwrap();
            assert!((on_sensor - 1e3 * diameter_m.abs()).abs() < 1e-9);
        }
        assert!((lens.focal_length_mm("test").unwrap() - f_mm).abs() < 1e-9);
        assert!((lens.f_number("test").unwrap() - n).abs() < 1e-9);
    }

    #[test]
    fn limits_have_the_blur_that_they_are_the_limits_of() {
        let lens = Lens::from_camera(35.0, 4.0, 2.0, 23.6).unwrap();
        let (near, far) = lens.depth_of_field(0.02).unwrap();
        for z in [near, far] {
            assert!((lens.coc_diameter_mm(z).unwrap() - 0.02).abs() < 1e-12);
        }
        let h = lens.hyperfocal_distance(0.02).unwrap();
        let focused = Lens::from_camera(35.0, 4.0, h, 23.6).unwrap();
        assert!((focused.coc_diameter_mm(f64::INFINITY).unwrap() - 0.02).abs() < 1e-12);
        // The far limit is infinity, except for rounding.
        let (near, far) = focused.depth_of_field(0.02).unwrap();
        assert!((near / (0.5 * h) - 1.0).abs() < 1e-9 && far > 1e12, "{near} {far}");
    }

    #[test]
    fn a_lens_that_breathes_shows_the_scene_as_large_as_its_image_is_far() {
        let at = |u: f64| {
            let lens = Lens::from_camera(50.0, 2.0, f64::INFINITY, 36.0).unwrap().breathing().unwrap();
            lens.focused_at_disparity(1.0 / u).unwrap()
        };
        assert!((at(f64::INFINITY).magnification() - 1.0).abs() < 1e-12);
        for u in [0.5, 3.0] {
            assert!((at(u).magnification() - u / (u - 0.05)).abs() < 1e-12);
            // The result is the same as for a lens that was made for that focus.
            let made = Lens::from_camera(50.0, 2.0, u, 36.0).unwrap();
            assert!((at(u).coc_diameter_mm(9.0).unwrap() - made.coc_diameter_mm(9.0).unwrap()).abs() < 1e-12);
        }
    }

    #[test]
    fn bad_values_are_named() {
        for (lens, name) in [
            (Lens::from_camera(50.0, 0.0, 1.0, 36.0), "f_number"),
            (Lens::from_camera(50.0, 2.0, 0.04, 36.0), "focus_distance"),
            (Lens::thin(0.1, 1.0, 40.0, FovAxis::X).unwrap().breathing(), "breathing"),
        ] {
            assert!(lens.unwrap_err().to_string().starts_with(name));
        }
    }
}
