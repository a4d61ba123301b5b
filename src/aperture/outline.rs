//! The outline of the opening: a disc, or straight or curved blades.

use std::f64::consts::{PI, TAU};

/// Number of chords that approximate the arc of one curved blade, or its share of a whole circle.
const CHORDS_OF_CIRCLE: usize = 128;

/// The boundary of the opening, inside the unit circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outline {
    Disc,
    /// A regular polygon with its corners on the unit circle, the first one at `first_angle` (radians,
    /// counter-clockwise on screen from the x axis). Its sides are curved outwards by the fraction `roundness` of the
    /// distance from the chord to the unit circle.
    Blades {
        blades: u32,
        first_angle: f64,
        roundness: f64,
    },
}

/// The position on screen at `radius` and `angle`; y points down.
fn polar(radius: f64, angle: f64) -> [f64; 2] {
    [radius * angle.cos(), -(radius * angle.sin())]
}

/// The arc of one blade, relative to the centre of the opening.
#[derive(Clone, Copy)]
struct Arc {
    /// Half the angle that the blade spans.
    half: f64,
    /// Distance of its middle from the centre.
    apex: f64,
}

impl Arc {
    fn new(blades: u32, roundness: f64) -> Arc {
        let half = PI / f64::from(blades);
        Arc { half, apex: half.cos() + roundness * (1.0 - half.cos()) }
    }

    /// The circle of which the blade is an arc: its centre, on the line to the middle of the blade, and its radius.
    /// `None` if the blade is straight.
    ///
    /// The circle passes through the apex, `centre + radius = apex`, and through the corners, which are 1 away at the
    /// angle `half`: `(cos half - centre)^2 + sin^2 half = radius^2`.
    fn circle(&self) -> Option<(f64, f64)> {
        let bulge = self.apex - self.half.cos();
        (bulge > 1e-9).then(|| {
            let centre = (self.apex * self.apex - 1.0) / (2.0 * bulge);
            (centre, self.apex - centre)
        })
    }

    /// Distance from the centre at the angle `phi` from the middle of the blade.
    fn radius(&self, phi: f64) -> f64 {
        match self.circle() {
            None => self.half.cos() / phi.cos(),
            Some((centre, radius)) => {
                centre * phi.cos() + (radius * radius - (centre * phi.sin()).powi(2)).max(0.0).sqrt()
            }
        }
    }

    /// Area of the sector between the centre of the opening and the blade: a triangle and, beyond the chord, a
    /// segment of the blade's circle.
    fn sector(&self) -> f64 {
        let triangle = 0.5 * (2.0 * self.half).sin();
        triangle
            + self.circle().map_or(0.0, |(_, radius)| {
                let angle = 2.0 * (self.half.sin() / radius).min(1.0).asin();
                0.5 * radius * radius * (angle - angle.sin())
            })
    }
}

impl Outline {
    /// The number of blades and the angle of the first corner, if the blades are straight.
    pub fn polygon(&self) -> Option<(u32, f64)> {
        match *self {
            Outline::Blades { blades, first_angle, roundness: 0.0 } => Some((blades, first_angle)),
            _ => None,
        }
    }

    fn corner(blades: u32, first_angle: f64, i: u32) -> [f64; 2] {
        polar(1.0, first_angle + TAU * f64::from(i % blades) / f64::from(blades))
    }

    /// Points along blade number `i`, including both its corners.
    fn blade(blades: u32, first_angle: f64, roundness: f64, i: u32) -> Vec<[f64; 2]> {
        let corners = [i, i + 1].map(|i| Outline::corner(blades, first_angle, i));
        if roundness == 0.0 {
            return corners.to_vec();
        }
        let (arc, chords) =
            (Arc::new(blades, roundness), CHORDS_OF_CIRCLE.div_ceil(blades as usize).max(8) as u32);
        let inner = (1..chords).map(|j| {
            let phi = arc.half * (2.0 * f64::from(j) / f64::from(chords) - 1.0);
            let middle = first_angle + arc.half * (2.0 * f64::from(i) + 1.0);
            polar(arc.radius(phi), middle + phi)
        });
        std::iter::once(corners[0]).chain(inner).chain([corners[1]]).collect()
    }

    /// A polygon with the outline's area: the outline itself if its sides are straight, otherwise a polygon whose
    /// chords are as far inside as outside, to a few ten-thousandths of the radius.
    pub fn contour(&self) -> Vec<[f64; 2]> {
        let places: Vec<[f64; 2]> = match *self {
            Outline::Disc => {
                (0..CHORDS_OF_CIRCLE).map(|i| polar(1.0, TAU * i as f64 / CHORDS_OF_CIRCLE as f64)).collect()
            }
            Outline::Blades { blades, first_angle, roundness } => (0..blades)
                .flat_map(|i| {
                    let mut blade = Outline::blade(blades, first_angle, roundness, i);
                    blade.pop();
                    blade
                })
                .collect(),
        };
        if self.polygon().is_some() {
            return places;
        }
        let larger = (PI * self.relative_area() / polygon_area(&places)).sqrt();
        places.into_iter().map(|p| p.map(|v| larger * v)).collect()
    }

    /// Area relative to that of the unit disc.
    pub fn relative_area(&self) -> f64 {
        match *self {
            Outline::Disc => 1.0,
            Outline::Blades { blades, roundness: 0.0, .. } => {
                let n = f64::from(blades);
                0.5 * n * (TAU / n).sin() / PI
            }
            Outline::Blades { blades, roundness, .. } => {
                f64::from(blades) * Arc::new(blades, roundness).sector() / PI
            }
        }
    }

    /// The rim point before which the fraction `v` of the area lies, going round.
    pub fn rim(&self, v: f64) -> [f64; 2] {
        match *self {
            Outline::Disc => [(TAU * v).cos(), -(TAU * v).sin()],
            Outline::Blades { blades, first_angle, roundness } => {
                let along = v * f64::from(blades);
                let i = (along as u32).min(blades - 1);
                // Triangles from the centre to equal lengths of a chord have equal areas.
                let between =
                    |a: [f64; 2], b: [f64; 2], f: f64| [a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1])];
                let blade = Outline::blade(blades, first_angle, roundness, i);
                let mut left = along - f64::from(i);
                if blade.len() > 2 {
                    left *= fan_areas(&blade).sum::<f64>();
                    for (area, ends) in fan_areas(&blade).zip(blade.windows(2)) {
                        if left <= area {
                            return between(ends[0], ends[1], left / area);
                        }
                        left -= area;
                    }
                    return blade[blade.len() - 1];
                }
                between(blade[0], blade[1], left)
            }
        }
    }

    /// The position of a point between the centre (0) and the rim (1).
    pub fn rim_fraction(&self, l: [f64; 2]) -> f64 {
        let r = l[0].hypot(l[1]);
        match *self {
            Outline::Disc => r,
            Outline::Blades { blades, first_angle, roundness } => {
                let half = PI / f64::from(blades);
                let angle = ((-l[1]).atan2(l[0]) - first_angle).rem_euclid(2.0 * half) - half;
                if roundness == 0.0 {
                    r * angle.cos() / half.cos()
                } else {
                    r / Arc::new(blades, roundness).radius(angle)
                }
            }
        }
    }
}

/// Twice the areas of the triangles between the centre and the segments of a line.
fn fan_areas(line: &[[f64; 2]]) -> impl Iterator<Item = f64> + '_ {
    line.windows(2).map(|ends| (ends[0][0] * ends[1][1] - ends[0][1] * ends[1][0]).abs())
}

/// Area of a closed polygon around the centre.
fn polygon_area(places: &[[f64; 2]]) -> f64 {
    let closing = [places[places.len() - 1], places[0]];
    0.5 * (fan_areas(places).sum::<f64>() + fan_areas(&closing).sum::<f64>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curved(blades: u32, roundness: f64) -> Outline {
        Outline::Blades { blades, first_angle: 0.3, roundness }
    }

    #[test]
    fn roundness_leads_from_the_polygon_to_the_disc() {
        assert!((curved(5, 1.0).relative_area() - 1.0).abs() < 1e-12);
        assert!((curved(5, 1e-7).relative_area() - curved(5, 0.0).relative_area()).abs() < 1e-7);
        assert!((curved(6, 1.0).rim_fraction([0.3, 0.4]) - 0.5).abs() < 1e-12);
        let areas = [0.0, 0.2, 0.5, 0.8, 1.0].map(|r| curved(7, r).relative_area());
        assert!(areas.is_sorted_by(|a, b| a < b), "{areas:?}");
    }

    #[test]
    fn contours_have_the_area_of_their_outline_and_lie_on_it() {
        for outline in [Outline::Disc, curved(5, 0.0), curved(5, 0.3), curved(9, 0.9)] {
            let contour = outline.contour();
            let area = polygon_area(&contour) / PI;
            assert!((area - outline.relative_area()).abs() < 1e-9, "{outline:?}: {area}");
            for place in contour {
                assert!((outline.rim_fraction(place) - 1.0).abs() < 5e-4, "{outline:?}: {place:?}");
            }
        }
    }

    #[test]
    fn equal_fractions_of_the_rim_span_equal_areas() {
        let outline = curved(5, 0.6);
        let n = 20_000;
        let rim: Vec<_> = (0..=n).map(|i| outline.rim(f64::from(i) / f64::from(n))).collect();
        let areas: Vec<f64> = fan_areas(&rim).collect();
        let mean = areas.iter().sum::<f64>() / f64::from(n);
        assert!(areas.iter().all(|a| (a / mean - 1.0).abs() < 0.02));
    }
}
