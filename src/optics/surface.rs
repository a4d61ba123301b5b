//! Focus surfaces other than a plane that faces the camera.
//!
//! A plane of the scene has a disparity that is linear over the picture: with `x = z u` for the picture coordinate `u`
//! (in focal lengths), `z = z0 + s . x` becomes `d = (1 - s . u) / z0`. So a tilted focus plane is a disparity in
//! focus `d_f(p)` that is affine in the pixel, and `t = k (d(q) - d_f(p))` with the pixel that the ray starts from.
//!
//! Let `b` be its gradient, and subtract it from the picture: `d'(q) = d(q) - b . (q - c)`. On the ray `q = p + t l`,
//! `k (d'(q) - d_f(c)) = t - k b . (q - p) = t (1 - k b . l)`. That is the plain lens again, over `d'`, with the lens
//! points `l / (1 - k b . l)`. This is exact, and it is the whole effect of a tilt.
//!
//! Field curvature adds `h |p - c|^2`. It is subtracted likewise. Its own gradient would change lens points by
//! `k 2 h (p - c) . l` relative to themselves, which is neglected: where the curvature has changed the focus by `n`
//! pixels of circle of confusion at `r` pixels from the axis, the relative error of radii towards one side is up to
//! `2 n / r`.

use super::lens::{Base, Lens, Mount};
use crate::error::{Result, value_error};

/// How much nearer the focus is than on the axis, as a disparity: `gradient . (q - c) + curvature |q - c|^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FocusSurface {
    /// The pixel on the axis.
    pub centre: [f64; 2],
    /// Disparity per pixel.
    pub gradient: [f64; 2],
    /// Disparity per square pixel.
    pub curvature: f64,
}

impl FocusSurface {
    /// Whether the surface is a plane that faces the camera.
    pub fn is_facing(&self) -> bool {
        self.gradient == [0.0; 2] && self.curvature == 0.0
    }

    /// Disparity in focus at a pixel, relative to that on the axis.
    #[inline(always)]
    pub fn offset(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x - self.centre[0], y - self.centre[1]);
        self.gradient[0] * x + self.gradient[1] * y + self.curvature * (x * x + y * y)
    }

    /// The effect of the surface on a lens of strength `k`: the change of its focus per pixel, in shift, and the
    /// factor by which the lens has to be stronger for points that are [leaning](crate::aperture::Aperture::leaning)
    /// so far.
    pub fn leaning(&self, k: f64) -> Result<([f64; 2], f64)> {
        let lean = self.lean(k)?;
        Ok((lean, 1.0 / (1.0 - lean[0].hypot(lean[1]))))
    }

    /// The change of the focus per pixel, in shift, under a lens of strength `k`.
    pub fn lean(&self, k: f64) -> Result<[f64; 2]> {
        /// The largest lean. The focus plane meets the plane of the lens at a distance of the opening's radius over
        /// the lean.
        const STEEPEST: f64 = 0.4;
        let lean = self.gradient.map(|b| k * b);
        let steepness = lean[0].hypot(lean[1]);
        if steepness > STEEPEST {
            return Err(value_error!(
                "tilt: the plane in focus passes the lens at {:.2} radii of its opening from the axis; at least \
                 {} is rendered. Tilt it less, or use a smaller aperture",
                1.0 / steepness,
                1.0 / STEEPEST
            ));
        }
        Ok(lean)
    }
}

/// Slopes of the focus plane: change of depth per unit to the right, and per unit down the picture.
fn slopes(tilt_deg: [f64; 2]) -> [f64; 2] {
    let [x, y] = tilt_deg.map(|angle| angle.to_radians().tan());
    [y, -x]
}

impl Lens {
    /// The focus surface in a frame with a focal length of `focal_px` pixels, and with the axis at `centre`.
    pub(super) fn focus_surface(&self, focal_px: Option<f64>, centre: [f64; 2]) -> FocusSurface {
        let flat = FocusSurface { centre, gradient: [0.0; 2], curvature: 0.0 };
        match (self.base, focal_px) {
            (Base::Thin { focus_distance, .. }, Some(f)) if self.has_surface() => FocusSurface {
                gradient: slopes(self.mount.tilt_deg).map(|s| -s / (focus_distance * f)),
                // An image surface of radius R is tan^2 v^2 / 2R away from the sensor, which moves the focus by that
                // over v^2.
                curvature: 0.5 * self.aberrations.field_curvature / (f * f),
                ..flat
            },
            _ => flat,
        }
    }

    fn has_surface(&self) -> bool {
        self.mount.tilt_deg != [0.0; 2] || self.aberrations.field_curvature != 0.0
    }

    /// The disparity that has to be in focus on the axis so that the focus surface contains a point of disparity `d`
    /// at position `u`, in focal lengths to the right of the axis and below it. `None` if no point in front of the
    /// camera does that.
    pub fn on_axis(&self, d: f64, u: [f64; 2]) -> Option<f64> {
        if !self.has_surface() {
            return Some(d);
        }
        // d = d0 (1 - s . u) + h |u|^2 / 2
        let s = slopes(self.mount.tilt_deg);
        let leaning = 1.0 - s[0] * u[0] - s[1] * u[1];
        let on_axis = (d - 0.5 * self.aberrations.field_curvature * (u[0] * u[0] + u[1] * u[1])) / leaning;
        (leaning > 0.0 && on_axis > 0.0).then_some(on_axis)
    }

    /// The same lens with its focus plane through three points `[u_x, u_y, d]`: position `u` and disparity `d`.
    pub fn focused_on_plane(&self, places: [[f64; 3]; 3]) -> Result<Lens> {
        // Each point is an equation a + g . u = d, minus the contribution of the curvature.
        let [p, q, r] =
            places.map(|[x, y, d]| [x, y, d - 0.5 * self.aberrations.field_curvature * (x * x + y * y)]);
        let [e, f] = [q, r].map(|v| [v[0] - p[0], v[1] - p[1], v[2] - p[2]]);
        let determinant = e[0] * f[1] - e[1] * f[0];
        let (longest, smallest) = (e[0].hypot(e[1]).max(f[0].hypot(f[1])), 1e-6);
        if determinant.abs() <= smallest * longest * longest {
            return Err(value_error!("pixels must not lie on one line: they have to span a plane"));
        }
        let g = [(e[2] * f[1] - e[1] * f[2]) / determinant, (e[0] * f[2] - e[2] * f[0]) / determinant];
        let on_axis = p[2] - g[0] * p[0] - g[1] * p[1];
        if on_axis <= 0.0 {
            return Err(value_error!(
                "pixels: the plane through what they see does not meet the optical axis in front of the camera"
            ));
        }
        // g = -s d0, and s = (tan y, -tan x)
        let tilt_deg = [g[1] / on_axis, -g[0] / on_axis].map(|tan| tan.atan().to_degrees());
        let upright = Lens { mount: Mount { tilt_deg: [0.0; 2], ..self.mount }, ..self.clone() };
        let focused = upright.focused_at_disparity(on_axis)?;
        focused.mounted(Mount { tilt_deg, ..self.mount })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Aberrations, FovAxis};

    fn lens(tilt_deg: [f64; 2], field_curvature: f64) -> Lens {
        let lens = Lens::thin(0.05, 3.0, 50.0, FovAxis::X).unwrap();
        let lens = lens.mounted(Mount { tilt_deg, ..Mount::PLAIN }).unwrap();
        lens.with_aberrations(Aberrations { field_curvature, ..Aberrations::NONE }).unwrap()
    }

    #[test]
    fn the_surface_is_the_plane_through_the_focus_that_leans_by_the_angles() {
        let (f, centre) = (800.0, [320.0, 240.0]);
        let surface = lens([20.0, -35.0], 0.0).focus_surface(Some(f), centre);
        for (x, y) in [(320.0, 240.0), (10.0, 30.0), (600.0, 400.0)] {
            // A point of the plane z = 3 + tan(-35) X + tan(20) (up), up = -Y, at this pixel.
            let u = [(x - centre[0]) / f, (y - centre[1]) / f];
            let leaning = 1.0 - (-35f64).to_radians().tan() * u[0] + 20f64.to_radians().tan() * u[1];
            let z = 3.0 / leaning;
            assert!((1.0 / z - 1.0 / 3.0 - surface.offset(x, y)).abs() < 1e-12);
        }
    }

    #[test]
    fn curvature_of_one_over_the_distance_is_a_sphere_about_the_lens() {
        let surface = lens([0.0; 2], 1.0 / 3.0).focus_surface(Some(1000.0), [0.0; 2]);
        for x in [10.0, 50.0, 100.0] {
            // At the distance 3 along the ray, z = 3 / sqrt(1 + tan^2).
            let tan: f64 = x / 1000.0;
            let exact = (1.0 + tan * tan).sqrt() / 3.0 - 1.0 / 3.0;
            assert!((surface.offset(x, 0.0) / exact - 1.0).abs() < 0.003);
        }
    }

    #[test]
    fn focusing_puts_the_places_on_the_surface() {
        let curved = lens([10.0, 20.0], 0.1);
        let at = |lens: &Lens, u: [f64; 2]| {
            let d_focus = match lens.base {
                Base::Thin { focus_distance, .. } => 1.0 / focus_distance,
                Base::Relative { .. } => 0.0,
            };
            d_focus + lens.focus_surface(Some(1.0), [0.0; 2]).offset(u[0], u[1])
        };
        let one = curved.focused_at_disparity(curved.on_axis(0.2, [0.3, -0.1]).unwrap()).unwrap();
        assert!((at(&one, [0.3, -0.1]) - 0.2).abs() < 1e-12);
        assert_eq!(one.mount.tilt_deg, [10.0, 20.0]);
        let places = [[0.3, -0.1, 0.2], [-0.4, 0.0, 0.3], [0.1, 0.35, 0.45]];
        let plane = curved.focused_on_plane(places).unwrap();
        for [x, y, d] in places {
            assert!((at(&plane, [x, y]) - d).abs() < 1e-12, "{plane:?}");
        }
        let line = [[0.0, 0.0, 0.2], [0.1, 0.1, 0.3], [0.2, 0.2, 0.45]];
        assert!(curved.focused_on_plane(line).unwrap_err().to_string().starts_with("pixels"));
    }

    /// A lens tilted about a horizontal axis, from thin-lens conjugates in its own frame and nothing else.
    #[test]
    fn a_tilted_lens_is_sharp_where_scheimpflugs_rule_says() {
        let (u, v, phi) = (2.5, 0.06, 8f64.to_radians());
        // The planes of the sensor, the lens and the focus meet in one line, v / tan(phi) below the axis.
        let hinge = v / phi.tan();
        let slope = (u + v) / hinge;
        let tilt_x = slope.atan().to_degrees();
        let tilted = Lens::thin(0.001, u, 40.0, FovAxis::X).unwrap();
        let tilted = tilted.mounted(Mount { tilt_deg: [tilt_x, 0.0], ..Mount::PLAIN }).unwrap();
        let surface = tilted.focus_surface(Some(1.0), [0.0; 2]);
        // The axis of the lens in (height, z), and its focal length from the conjugates on the picture's axis.
        let axis = [-phi.sin(), phi.cos()];
        let along = |p: [f64; 2]| p[0] * axis[0] + p[1] * axis[1];
        let f = 1.0 / (1.0 / along([0.0, u]) + 1.0 / -along([0.0, -v]));
        for height in [-0.3, 0.0, 0.2, 0.7] {
            let z = u + slope * height;
            let point = [height, z];
            let a = along(point);
            let magnification = -f / (a - f);
            let image = point.map(|c| magnification * c);
            assert!((image[1] + v).abs() < 1e-9, "the image lies on the sensor: {image:?}");
            // Up is the negative of the picture's y.
            assert!((1.0 / u + surface.offset(0.0, -height / z) - 1.0 / z).abs() < 1e-12);
        }
    }
}
