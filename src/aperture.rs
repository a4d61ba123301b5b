//! The shape of the aperture: lens points for the flagship and area-exact kernels for constant depth.
//!
//! Lens coordinates have the picture's axes (x right, y down) and the unit disc as their bound. A point behind
//! the focus plane is drawn as the aperture itself, one in front of it as the aperture turned by 180 degrees.

use crate::error::{Result, value_error};
use std::f64::consts::{PI, TAU};

/// The outline of the opening.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Outline {
    Disc,
    /// A regular polygon with its vertices on the unit circle, the first one at `first_angle` (radians,
    /// counter-clockwise on screen from the x axis).
    Polygon {
        blades: u32,
        first_angle: f64,
    },
}

/// The aperture: where light passes and how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    outline: Outline,
    /// Standard deviation of a Gaussian transmission, as a fraction of the way from the centre to the rim.
    apodization: Option<f64>,
}

impl Aperture {
    /// An open disc.
    pub const DISC: Aperture = Aperture { outline: Outline::Disc, apodization: None };

    /// A disc (`blades = 0`) or a regular polygon, with an optional Gaussian transmission.
    pub fn new(blades: u32, rotation_deg: f64, apodization: Option<f64>) -> Result<Aperture> {
        if !(blades == 0 || (3..=64).contains(&blades)) {
            return Err(value_error!("blades must be 0 (a disc) or from 3 to 64; got {blades}"));
        }
        if !rotation_deg.is_finite() {
            return Err(value_error!("rotation must be a finite angle in degrees; got {rotation_deg}"));
        }
        if let Some(sigma) = apodization
            && !(sigma.is_finite() && sigma >= 0.05)
        {
            return Err(value_error!(
                "apodization must be the standard deviation of the transmission as a fraction of the aperture \
                 radius, at least 0.05; got {sigma}"
            ));
        }
        let outline = match blades {
            0 => Outline::Disc,
            _ => Outline::Polygon { blades, first_angle: rotation_deg.to_radians().rem_euclid(TAU) },
        };
        Ok(Aperture { outline, apodization })
    }

    /// Blades, and the first corner's angle in radians counter-clockwise on screen from the x axis; none for a disc.
    pub fn polygon(&self) -> Option<(u32, f64)> {
        match self.outline {
            Outline::Disc => None,
            Outline::Polygon { blades, first_angle } => Some((blades, first_angle)),
        }
    }

    /// Whether all light passes, everywhere inside the outline.
    pub fn is_clear(&self) -> bool {
        self.apodization.is_none()
    }

    /// The corners of a polygon, in lens coordinates; empty for a disc.
    fn vertices(&self) -> Vec<[f64; 2]> {
        match self.outline {
            Outline::Disc => Vec::new(),
            Outline::Polygon { blades, first_angle } => (0..blades)
                .map(|i| {
                    let angle = first_angle + TAU * f64::from(i) / f64::from(blades);
                    [angle.cos(), -angle.sin()]
                })
                .collect(),
        }
    }

    /// Whether the opening is a disc, however much of its light passes where.
    pub fn is_round(&self) -> bool {
        self.outline == Outline::Disc
    }

    /// Share of the light that passes at a lens point inside the opening.
    pub fn transmission(&self, l: [f64; 2]) -> f64 {
        self.apodization.map_or(1.0, |sigma| (-0.5 * (self.rim_fraction(l) / sigma).powi(2)).exp())
    }

    /// Area of the opening over that of its enclosing disc.
    pub fn relative_area(&self) -> f64 {
        match self.outline {
            Outline::Disc => 1.0,
            Outline::Polygon { blades, .. } => {
                let n = f64::from(blades);
                0.5 * n * (TAU / n).sin() / PI
            }
        }
    }

    /// The rim point below which the fraction `v` of the opening's area lies, going round.
    pub fn rim(&self, v: f64) -> [f64; 2] {
        match self.outline {
            Outline::Disc => [(TAU * v).cos(), -(TAU * v).sin()],
            // Triangles from the centre to equal lengths of the rim have equal areas.
            Outline::Polygon { blades, .. } => {
                let vertices = self.vertices();
                let along = v * f64::from(blades);
                let i = (along as usize).min(vertices.len() - 1);
                let (a, b, f) = (vertices[i], vertices[(i + 1) % vertices.len()], along - i as f64);
                [a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1])]
            }
        }
    }

    /// How far from the centre to the rim the fraction `u` of the light passes.
    fn radial_quantile(&self, u: f64) -> f64 {
        match self.apodization {
            None => u.sqrt(),
            // The transmission exp(-r^2 / 2 sigma^2), cut at the rim, has this closed quantile.
            Some(sigma) => {
                let rim = (-0.5 / (sigma * sigma)).exp();
                (-2.0 * (1.0 - u * (1.0 - rim)).ln()).sqrt() * sigma
            }
        }
    }

    /// `n` points of equal weight over the opening: a Fibonacci (Kronecker) lattice in area coordinates.
    pub fn lens_points(&self, n: usize) -> Vec<[f64; 2]> {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        (0..n)
            .map(|i| {
                let rho = self.radial_quantile((i as f64 + 0.5) / n as f64);
                let rim = self.rim((0.5 + i as f64 * GOLDEN).fract());
                [rho * rim[0], rho * rim[1]]
            })
            .collect()
    }

    /// The picture of a point under shift `t` pixels: how much of each pixel the opening, scaled by `t`, covers.
    pub fn kernel(&self, t: f64) -> Kernel {
        let reach = (t.abs() + 0.5).ceil() as i32;
        let vertices: Vec<[f64; 2]> = self.vertices().iter().map(|v| [t * v[0], t * v[1]]).collect();
        // The unit pixel's nearest and farthest points from the centre settle most cases: openings are convex.
        let outside = |d: i32| (f64::from(d.abs()) - 0.5).max(0.0);
        let corner_inside = |dx: i32, dy: i32, (cx, cy): (f64, f64)| {
            self.rim_fraction([(f64::from(dx) + cx) / t, (f64::from(dy) + cy) / t]) <= 1.0
        };
        const CORNERS: [(f64, f64); 4] = [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)];
        let weight = |dx: i32, dy: i32| {
            if outside(dx).hypot(outside(dy)) >= t.abs() {
                return 0.0;
            }
            match (self.apodization, self.outline) {
                (Some(_), _) => self.apodized_pixel_weight(t, dx, dy),
                _ if CORNERS.iter().all(|&corner| corner_inside(dx, dy, corner)) => 1.0,
                (None, Outline::Disc) => disc_pixel_area(t.abs(), dx, dy),
                (None, Outline::Polygon { .. }) => polygon_pixel_area(&vertices, dx, dy),
            }
        };
        Kernel::from_weights(reach, weight)
    }

    /// Transmission integrated over a pixel of the scaled opening by a fine midpoint rule.
    fn apodized_pixel_weight(&self, t: f64, dx: i32, dy: i32) -> f64 {
        const STEPS: usize = 16;
        let inside = |i: usize| (i as f64 + 0.5) / STEPS as f64 - 0.5;
        let mut sum = 0.0;
        for j in 0..STEPS {
            for i in 0..STEPS {
                let l = [(f64::from(dx) + inside(i)) / t, (f64::from(dy) + inside(j)) / t];
                if self.rim_fraction(l) <= 1.0 {
                    sum += self.transmission(l);
                }
            }
        }
        sum / (STEPS * STEPS) as f64
    }

    /// How far along the way from the centre to the rim a lens point lies.
    pub fn rim_fraction(&self, l: [f64; 2]) -> f64 {
        let r = l[0].hypot(l[1]);
        match self.outline {
            Outline::Disc => r,
            Outline::Polygon { blades, first_angle } => {
                let half = PI / f64::from(blades);
                let angle = ((-l[1]).atan2(l[0]) - first_angle).rem_euclid(2.0 * half) - half;
                r * angle.cos() / half.cos()
            }
        }
    }
}

/// Area that the disc of radius `r` around the origin shares with the unit pixel at `(dx, dy)`.
fn disc_pixel_area(r: f64, dx: i32, dy: i32) -> f64 {
    // By symmetry in the first quadrant; a pixel that an axis cuts in half is two halves.
    let side = |d: i32| {
        let d = f64::from(d.abs());
        if d == 0.0 { (0.0, 0.5, 2.0) } else { (d - 0.5, d + 0.5, 1.0) }
    };
    let ((x0, x1, nx), (y0, y1, ny)) = (side(dx), side(dy));
    let half_chord = |y: f64| (r * r - y * y).max(0.0).sqrt();
    let arc = |x: f64| 0.5 * (x * half_chord(x) + r * r * (x / r).clamp(-1.0, 1.0).asin());
    // Over [x0, full] the pixel's column is covered whole, over [full, end] up to the arc.
    let end = half_chord(y0).min(x1);
    let full = half_chord(y1).clamp(x0, x1).min(end.max(x0));
    let whole = (y1 - y0) * (full - x0);
    let part = if end > full { arc(end) - arc(full) - y0 * (end - full) } else { 0.0 };
    if y0 >= r { 0.0 } else { nx * ny * (whole + part.max(0.0)) }
}

/// Area that a convex polygon shares with the unit pixel at `(dx, dy)`: the polygon clipped by four lines.
fn polygon_pixel_area(vertices: &[[f64; 2]], dx: i32, dy: i32) -> f64 {
    let mut polygon = vertices.to_vec();
    for (axis, centre) in [(0, f64::from(dx)), (1, f64::from(dy))] {
        for side in [-1.0, 1.0] {
            let inside = |v: &[f64; 2]| 0.5 - side * (v[axis] - centre);
            let mut clipped = Vec::with_capacity(polygon.len() + 1);
            for (i, a) in polygon.iter().enumerate() {
                let b = &polygon[(i + 1) % polygon.len()];
                let (da, db) = (inside(a), inside(b));
                if da >= 0.0 {
                    clipped.push(*a);
                }
                if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
                    let f = da / (da - db);
                    clipped.push([a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1])]);
                }
            }
            polygon = clipped;
        }
    }
    let twice: f64 = (0..polygon.len())
        .map(|i| {
            let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            a[0] * b[1] - a[1] * b[0]
        })
        .sum();
    0.5 * twice.abs()
}

/// One row of a kernel: a run of equal weights, and the pixels whose weight differs.
#[derive(Debug, Clone, PartialEq)]
pub struct KernelRow {
    /// Row offset.
    pub dy: i32,
    /// Columns `run.0 .. run.1` that the opening covers whole.
    pub run: (i32, i32),
    /// Column offset and weight of the pixels that it covers in part.
    pub partial: Vec<(i32, f32)>,
}

/// A convolution kernel of sum 1, row by row, ready for running sums.
#[derive(Debug, Clone, PartialEq)]
pub struct Kernel {
    /// No weight lies farther than this from the centre, along either axis.
    pub reach: i32,
    /// Weight of every pixel in a row's run.
    pub run_weight: f32,
    /// The rows that have any weight.
    pub rows: Vec<KernelRow>,
}

impl Kernel {
    fn from_weights(reach: i32, weight: impl Fn(i32, i32) -> f64) -> Kernel {
        // A pixel counts as covered whole when rounding alone is missing.
        const WHOLE: f64 = 1.0 - 1e-12;
        let raw: Vec<(i32, Vec<(i32, f64)>)> = (-reach..=reach)
            .map(|dy| (dy, (-reach..=reach).map(|dx| (dx, weight(dx, dy))).filter(|w| w.1 > 0.0).collect()))
            .filter(|(_, row): &(i32, Vec<_>)| !row.is_empty())
            .collect();
        let total: f64 = raw.iter().flat_map(|(_, row)| row).map(|w| w.1).sum();
        if total <= 0.0 {
            let centre = KernelRow { dy: 0, run: (0, 1), partial: Vec::new() };
            return Kernel { reach: 0, run_weight: 1.0, rows: vec![centre] };
        }
        let rows = raw
            .into_iter()
            .map(|(dy, row)| {
                let whole = |w: &&(i32, f64)| w.1 >= WHOLE;
                let run = match (row.iter().find(whole), row.iter().rev().find(whole)) {
                    (Some(first), Some(last)) => (first.0, last.0 + 1),
                    _ => (0, 0),
                };
                let partial = row
                    .iter()
                    .filter(|w| !(run.0..run.1).contains(&w.0))
                    .map(|w| (w.0, (w.1 / total) as f32))
                    .collect();
                KernelRow { dy, run, partial }
            })
            .collect();
        Kernel { reach, run_weight: (1.0 / total) as f32, rows }
    }

    /// Every weight as `(dx, dy, weight)`.
    pub fn weights(&self) -> impl Iterator<Item = (i32, i32, f32)> + '_ {
        self.rows.iter().flat_map(|row| {
            let run = (row.run.0..row.run.1).map(|dx| (dx, row.dy, self.run_weight));
            run.chain(row.partial.iter().map(|&(dx, w)| (dx, row.dy, w)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(weight: impl Fn(i32, i32) -> f64) -> f64 {
        (-12..=12).flat_map(|y| (-12..=12).map(move |x| (x, y))).map(|(x, y)| weight(x, y)).sum()
    }

    #[test]
    fn pixel_areas_add_up_to_the_opening() {
        for r in [0.2, 0.5, 0.7, 1.0, 2.5, 7.3, 10.0] {
            let disc = area(|x, y| disc_pixel_area(r, x, y));
            assert!((disc - PI * r * r).abs() < 1e-9, "disc {r}: {disc}");
            for blades in [3, 5, 6] {
                let aperture = Aperture::new(blades, 17.0, None).unwrap();
                let vertices: Vec<_> = aperture.vertices().iter().map(|v| [r * v[0], r * v[1]]).collect();
                let polygon = area(|x, y| polygon_pixel_area(&vertices, x, y));
                let exact = PI * r * r * aperture.relative_area();
                assert!((polygon - exact).abs() < 1e-9, "{blades} blades, {r}: {polygon} against {exact}");
            }
        }
    }

    #[test]
    fn lens_points_have_the_moments_of_the_opening() {
        for (aperture, variance) in [
            (Aperture::DISC, 0.25),
            // Second moment per axis of a regular polygon of circumradius 1.
            (Aperture::new(6, 10.0, None).unwrap(), (2.0 + (TAU / 6.0).cos()) / 12.0),
            (Aperture::new(0, 0.0, Some(0.25)).unwrap(), 0.0625),
        ] {
            let points = aperture.lens_points(512);
            for axis in 0..2 {
                let mean = points.iter().map(|p| p[axis]).sum::<f64>() / 512.0;
                let second = points.iter().map(|p| p[axis] * p[axis]).sum::<f64>() / 512.0;
                assert!(mean.abs() < 3e-3, "{aperture:?}: mean {mean}");
                assert!((second - variance).abs() < 5e-3 * variance.max(0.2), "{aperture:?}: {second}");
            }
            assert!(points.iter().all(|&p| aperture.rim_fraction(p) <= 1.0 + 1e-9));
        }
    }

    #[test]
    fn kernels_sum_to_one_and_small_ones_are_the_identity() {
        for aperture in [Aperture::DISC, Aperture::new(5, 3.0, None).unwrap()] {
            for t in [-9.5, -0.3, 0.0, 0.3, 0.5, 1.0, 31.0] {
                let kernel = aperture.kernel(t);
                let sum: f64 = kernel.weights().map(|w| f64::from(w.2)).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{aperture:?} {t}: {sum}");
                if t.abs() <= 0.5 {
                    assert_eq!(kernel.weights().collect::<Vec<_>>(), [(0, 0, 1.0)]);
                }
            }
        }
    }

    #[test]
    fn a_kernel_in_front_is_the_one_behind_turned_round() {
        let aperture = Aperture::new(3, 20.0, None).unwrap();
        let sorted = |t: f64, sign: i32| {
            let mut w: Vec<_> =
                aperture.kernel(t).weights().map(|(x, y, w)| (sign * x, sign * y, w)).collect();
            w.sort_by_key(|w| (w.1, w.0));
            w
        };
        for (a, b) in sorted(6.2, 1).iter().zip(sorted(-6.2, -1)) {
            assert!((a.0, a.1) == (b.0, b.1) && (a.2 - b.2).abs() < 1e-9);
        }
    }
}
