//! Transverse aberrations: where the rays of one point land on the sensor, other than those of a thin lens.
//!
//! The ray through lens point `l` of a pixel `p` passes what has the shift `t` at
//!
//! ```text
//! q = p + A(l) + B(l) t          A = 0 and B = l for a thin lens
//! ```
//!
//! So the light of a point at `q` lands at `q - A - B t`. Coma and astigmatism of third order are an `A`. With `h` the
//! distance of the field from the axis in half diagonals `H`, and the lens point in the frame of the field, `(u, v)`
//! with `u` along it, away from the axis:
//!
//! ```text
//! coma c            -A = H c h / 3 (3 u^2 + v^2, 2 u v)     (= c h rho^2 / 3 (2 + cos 2 theta, sin 2 theta))
//! astigmatism a      A = H a h^2 / 2 (-u, v)
//! ```
//!
//! The ray through the upper rim of the lens then lands `H c` farther out in a corner of the picture, and the comet is as
//! long. Under astigmatism, rays that differ in `u` meet again at the shift `H a h^2 / 2`, those that differ in `v` at
//! the negative of it: there a point is a line.

use super::fields::{Direction, Place};
use super::lens_map::{Deviation, Landing, LensMap};
use std::f64::consts::TAU;
use std::sync::Arc;

/// A rectangular stop in front of the lens, in radii of the opening.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BarnDoors {
    /// Half of the distance of the doors to the left and to the right, and of those above and below.
    pub half: [f64; 2],
    /// How far the stop seems to move across the opening from the middle of the picture to its corners. It is in front
    /// of the lens, so it moves against the field: of a point on the right, the left door is looked past.
    pub moves: f64,
}

/// The transverse aberrations of a lens over a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Transverse {
    /// The pixel on the axis.
    pub centre: [f64; 2],
    /// Half the diagonal of the frame.
    pub half_diagonal_px: f64,
    /// See the module.
    pub coma: f64,
    /// See the module.
    pub astigmatism: f64,
    /// A rectangular stop, if there is one.
    pub barn_doors: Option<BarnDoors>,
    /// The lens as it was measured or traced.
    pub map: Option<Arc<LensMap>>,
}

/// The aberrations at one place of the frame.
#[derive(Debug, Clone, Copy)]
pub struct Field<'a> {
    lens: &'a Transverse,
    place: Place,
}

/// How a ray goes on from its pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    /// Where it passes what is in focus, in pixels.
    pub start_px: [f64; 2],
    /// Lens points through which it seems to come in front of the focus and behind it, if not those of a thin lens.
    pub lens: Option<[[f64; 2]; 2]>,
}

impl Transverse {
    /// The same for the part of the frame that begins with row `y`.
    pub fn rows_from(&self, y: usize) -> Transverse {
        Transverse { centre: [self.centre[0], self.centre[1] - y as f64], ..self.clone() }
    }

    /// The aberrations at a pixel.
    pub fn at(&self, [x, y]: [f64; 2]) -> Field<'_> {
        let off = [x - self.centre[0], y - self.centre[1]];
        let distance = off[0].hypot(off[1]);
        let away = if distance > 0.0 { Direction(off.map(|v| v / distance)) } else { Direction::RIGHT };
        Field { lens: self, place: Place { height: distance / self.half_diagonal_px, away } }
    }

    /// How far the lens differs at most from a thin one in the rectangle between two corners.
    pub fn deviation_between(&self, first: [f64; 2], last: [f64; 2]) -> Deviation {
        let corners = [first, [last[0], first[1]], [first[0], last[1]], last].map(|at| self.at(at));
        // All but a map grows with the distance from the axis, along each direction.
        let all = corners.iter().fold(Deviation::default(), |all, corner| all.max(corner.deviation()));
        let Some(map) = &self.map else { return all };
        let nearest = self.at([0, 1].map(|i| self.centre[i].clamp(first[i], last[i]))).place;
        let places = corners.map(|corner| corner.place);
        let farthest = places.into_iter().fold(nearest, |a, b| if b.height > a.height { b } else { a });
        all.max(map.deviation_between([places[0], places[3]], [nearest, farthest]))
    }

    /// How many times as large as that of a thin lens the largest disc is; at least 1.
    pub fn widest(&self) -> f64 {
        self.map.as_ref().map_or(1.0, |map| map.widest())
    }
}

impl Field<'_> {
    /// Whether the ray through a point of the opening arrives.
    pub fn arrives(&self, pupil: [f64; 2]) -> bool {
        let map = self.lens.map.as_ref();
        self.passes_doors(pupil)
            && map.is_none_or(|map| map.arrives(self.place, map.axis(self.place).turned(pupil)))
    }

    /// The course of the ray through a point of the opening, if it arrives.
    pub fn course(&self, pupil: [f64; 2]) -> Course {
        let (size, h) = (self.lens.half_diagonal_px, self.place.height);
        match &self.lens.map {
            Some(map) => {
                let axis = map.axis(self.place);
                let Landing { focused, out_of_focus } = map.at(self.place, axis.turned(pupil));
                let start_px = axis.turned_back(focused.map(|v| -size * v));
                Course { start_px, lens: Some(out_of_focus.map(|v| axis.turned_back(v))) }
            }
            None => {
                let [u, v] = self.place.away.turned(pupil);
                let coma = size * self.lens.coma * h / 3.0;
                let astigmatism = 0.5 * size * self.lens.astigmatism * h * h;
                let start = [
                    -coma * (3.0 * u * u + v * v) - astigmatism * u,
                    -coma * (2.0 * u * v) + astigmatism * v,
                ];
                Course { start_px: self.place.away.turned_back(start), lens: None }
            }
        }
    }

    /// Where the rectangular stop is, as seen from here, relative to the opening.
    fn doors_at(&self, moves: f64) -> [f64; 2] {
        self.place.away.0.map(|v| -moves * self.place.height * v)
    }

    fn passes_doors(&self, pupil: [f64; 2]) -> bool {
        self.lens.barn_doors.is_none_or(|BarnDoors { half, moves }| {
            let at = self.doors_at(moves);
            (0..2).all(|i| (pupil[i] - at[i]).abs() <= half[i])
        })
    }

    /// How far the lens differs here from a thin one, at most: the offset of what is in focus is in half diagonals.
    pub fn deviation(&self) -> Deviation {
        let h = self.place.height;
        let own = match &self.lens.map {
            Some(map) => map.deviation(self.place),
            None => Deviation {
                focused: self.lens.coma.abs() * h + 0.5 * self.lens.astigmatism.abs() * h * h,
                ..Deviation::default()
            },
        };
        let doors = self.lens.barn_doors.map_or(0.0, |BarnDoors { half, moves }| {
            let at = self.doors_at(moves);
            let inside = (0..2).map(|i| 1.0 - (half[i] - at[i].abs()));
            inside.fold(0.0, f64::max)
        });
        Deviation { lost: own.lost.max(doors), ..own }
    }

    /// The radius in pixels of a disc with the variance of the light of a point in focus.
    pub fn radius_in_focus_px(&self) -> f64 {
        const RINGS: usize = 4;
        const DIRECTIONS: usize = 12;
        let points = (0..RINGS).flat_map(|ring| {
            // Rings of equal area.
            let rho = ((ring as f64 + 0.5) / RINGS as f64).sqrt();
            (0..DIRECTIONS).map(move |turn| {
                let (sin, cos) = (TAU * turn as f64 / DIRECTIONS as f64).sin_cos();
                [rho * cos, rho * sin]
            })
        });
        let starts: Vec<[f64; 2]> =
            points.filter(|l| self.arrives(*l)).map(|l| self.course(l).start_px).collect();
        let mean =
            |of: &dyn Fn(&[f64; 2]) -> f64| starts.iter().map(of).sum::<f64>() / starts.len().max(1) as f64;
        let middle = [mean(&|p| p[0]), mean(&|p| p[1])];
        let variance = mean(&|p| (p[0] - middle[0]).powi(2) + (p[1] - middle[1]).powi(2));
        // That of a disc is half of its squared radius.
        (2.0 * variance).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(coma: f64, astigmatism: f64) -> Transverse {
        Transverse {
            centre: [100.0, 80.0],
            half_diagonal_px: 1000.0,
            coma,
            astigmatism,
            barn_doors: None,
            map: None,
        }
    }

    fn rim(n: usize) -> impl Iterator<Item = [f64; 2]> {
        (0..n).map(move |i| {
            let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
            [cos, sin]
        })
    }

    #[test]
    fn coma_is_the_image_of_third_order() {
        // A field straight below the axis, half way to a corner.
        let lens = lens(0.03, 0.0);
        let field = lens.at([100.0, 580.0]);
        for rho in [1.0, 0.6] {
            for (i, l) in rim(16).enumerate() {
                // The angle of the lens point from the direction of the field, down, on towards the left.
                let theta = TAU * (i as f64 / 16.0 - 0.25);
                let landed = field.course(l.map(|v| rho * v)).start_px.map(|v| -v);
                let size = 1000.0 * 0.03 * 0.5 / 3.0 * rho * rho;
                let (along, across) = (2.0 + (2.0 * theta).cos(), (2.0 * theta).sin());
                assert!((landed[1] - size * along).abs() < 1e-9, "{landed:?}");
                assert!((landed[0] + size * across).abs() < 1e-9, "{landed:?}");
            }
        }
        let farthest = rim(360).map(|l| field.course(l).start_px.map(|v| v * v).iter().sum::<f64>());
        assert!((farthest.fold(0.0, f64::max).sqrt() - 15.0).abs() < 1e-9);
        assert!((field.deviation().focused - 0.015).abs() < 1e-12);
    }

    #[test]
    fn astigmatism_has_two_lines() {
        let lens = lens(0.0, 0.02);
        let field = lens.at([100.0 + 800.0, 80.0]);
        let focus = 0.5 * 0.02 * 0.64 * 1000.0;
        for l in rim(32) {
            let start = field.course(l).start_px;
            let at = |t: f64| [0, 1].map(|i| start[i] + l[i] * t);
            assert!(at(focus)[0].abs() < 1e-9, "no extent away from the axis");
            assert!((at(focus)[1] - 2.0 * focus * l[1]).abs() < 1e-9);
            assert!(at(-focus)[1].abs() < 1e-9, "no extent across");
        }
        assert!((field.radius_in_focus_px() - focus).abs() < 1e-9, "a disc in between");
    }

    #[test]
    fn doors_move_against_the_field() {
        let barn_doors = Some(BarnDoors { half: [0.8, 1.5], moves: 0.5 });
        let lens = Transverse { barn_doors, ..lens(0.0, 0.0) };
        let field = lens.at([1100.0, 80.0]);
        let arrives = |x: f64| field.arrives([x, 0.0]);
        assert!(arrives(-1.0) && arrives(0.29) && !arrives(0.31));
        assert!((field.deviation().lost - 0.7).abs() < 1e-12);
    }
}
