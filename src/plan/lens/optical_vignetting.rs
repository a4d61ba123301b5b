//! Optical vignetting (cat's eye): the barrel of a lens is a second stop, as large as the unit disc, whose position
//! depends on the pixel.
//!
//! A pixel's light is that of the lens points that it still sees, and is shared among them. So the second stop
//! changes the shape of discs but not the brightness of the picture; brightness is the falloff's.

use crate::aperture::Aperture;
use crate::optics::SecondStop;
use crate::scene::grid::TILE;
use std::f64::consts::TAU;

/// The open part is tabulated for this many distances between the two stops, up to the one at which nothing is open,
/// and directions.
const DISTANCES: usize = 128;
const DIRECTIONS: usize = 64;
/// Number of lens points with which the open part is counted.
const POINTS: usize = 4096;

/// A second stop in front of an opening.
#[derive(Clone)]
pub struct PupilClip {
    second_stop: SecondStop,
    aperture: Aperture,
    /// Open part of the opening, by the direction of the second stop and then by its distance, from 0 to 2.
    open: Vec<[f64; DISTANCES + 1]>,
}

/// Which pixels of a tile see a sample: for each row, one bit per pixel.
pub type Seen = [u64; TILE.1];

/// The part of the points that lies within a unit disc, as the disc moves along a direction from 0 to 2.
///
/// The disc covers point `l` while `|l - a u| <= 1`: between the roots of `a^2 - 2 a (l . u) + |l|^2 - 1`. So each
/// point is counted once where it enters and once where it leaves, and not for every distance.
fn open_parts(points: &[[f64; 2]], u: [f64; 2]) -> [f64; DISTANCES + 1] {
    const PER_UNIT: f64 = DISTANCES as f64 / 2.0;
    let mut changes = [0i32; DISTANCES + 2];
    for l in points {
        let along = l[0] * u[0] + l[1] * u[1];
        let root = (along * along - (l[0] * l[0] + l[1] * l[1] - 1.0)).sqrt();
        let first = ((along - root).max(0.0) * PER_UNIT).ceil();
        let last = ((along + root).min(2.0) * PER_UNIT).floor();
        // Without a real root, both are NaN and the comparison is false.
        if first <= last {
            changes[first as usize] += 1;
            changes[last as usize + 1] -= 1;
        }
    }
    let mut covered = 0;
    std::array::from_fn(|i| {
        covered += changes[i];
        f64::from(covered) / points.len() as f64
    })
}

impl PupilClip {
    /// The second stop of a lens in front of its opening.
    pub fn new(second_stop: SecondStop, aperture: &Aperture) -> PupilClip {
        let points = aperture.pupil_points(POINTS);
        let open = (0..DIRECTIONS).map(|direction| {
            let (sin, cos) = (TAU * direction as f64 / DIRECTIONS as f64).sin_cos();
            open_parts(&points, [cos, sin])
        });
        let open = open.collect();
        PupilClip { second_stop, aperture: aperture.clone(), open }
    }

    /// The fraction of the opening's light that a pixel still sees.
    pub fn open(&self, x: f64, y: f64) -> f64 {
        let [x, y] = self.second_stop.stop(x, y);
        let apart = (x.hypot(y) * 0.5 * DISTANCES as f64).min(DISTANCES as f64);
        let turn = (y.atan2(x) / TAU).rem_euclid(1.0) * DIRECTIONS as f64;
        let (i, direction) = ((apart as usize).min(DISTANCES - 1), turn as usize);
        let along = |direction: usize| {
            let row = &self.open[direction % DIRECTIONS];
            row[i] + (apart - i as f64) * (row[i + 1] - row[i])
        };
        along(direction) + turn.fract() * (along(direction + 1) - along(direction))
    }

    /// The weight of lens point `l` for a pixel, relative to a pixel that sees the whole opening. It is zero beyond
    /// the stop, whose rim is as soft as a pixel. The opening is drawn `t` pixels large. Where it is inside its own
    /// pixel, that pixel has all of its light.
    pub fn share(&self, place: [f64; 2], l: [f64; 2], t: f64) -> f64 {
        self.share_of_pupil(place, self.aperture.pupil(l), t)
    }

    /// The same for a point of the opening itself.
    pub fn share_of_pupil(&self, [x, y]: [f64; 2], pupil: [f64; 2], t: f64) -> f64 {
        let beyond_pixel = (t.abs() - 0.5).clamp(0.0, 1.0);
        if beyond_pixel == 0.0 {
            return 1.0;
        }
        let stop = self.second_stop.stop(x, y);
        // A pixel on the rim of the lens itself is evaluated half a pixel inside, where its light is: only the rim of
        // the second stop is to be softened, not both rims.
        let innermost = (1.0 - 0.5 / t.abs()).max(0.0) / pupil[0].hypot(pupil[1]).max(1e-9);
        let pupil = pupil.map(|v| v * innermost.min(1.0));
        let inside = 1.0 - (pupil[0] - stop[0]).hypot(pupil[1] - stop[1]);
        let open = self.open(x, y);
        let share = if open > 0.0 { (0.5 + t.abs() * inside).clamp(0.0, 1.0) / open } else { 0.0 };
        1.0 + beyond_pixel * (share - 1.0)
    }

    /// Which pixels `p` of the tile at `origin` see the opening at `pupil`, if any do: those with
    /// `|pupil - c(p)| <= 1`. As `c` is linear, they form one interval in every row.
    pub fn pixels_seeing(&self, pupil: [f64; 2], origin: (usize, usize)) -> Option<Seen> {
        let SecondStop { centre, per_px } = self.second_stop;
        // The pixel whose stop is centred on the point, relative to the tile's first pixel, and the radius around it.
        let middle = [0, 1].map(|i| {
            let origin = if i == 0 { origin.0 } else { origin.1 };
            pupil[i] / per_px + centre[i] - origin as f64
        });
        let reach = 1.0 / per_px;
        let last = [TILE.0, TILE.1].map(|n| (n - 1) as f64);
        let farthest = [0, 1].map(|i| middle[i].abs().max((last[i] - middle[i]).abs()));
        let nearest = [0, 1].map(|i| (-middle[i]).max(middle[i] - last[i]).max(0.0));
        if farthest[0].hypot(farthest[1]) <= reach {
            return Some([u64::MAX; TILE.1]);
        }
        if nearest[0].hypot(nearest[1]) > reach {
            return None;
        }
        Some(std::array::from_fn(|y| {
            let Some([first, end]) = self.columns(pupil, origin.1 + y) else { return 0 };
            let bits = |n: f64| {
                // The lowest n bits of the row.
                let n = (n - origin.0 as f64).clamp(0.0, TILE.0 as f64) as u32;
                u64::MAX.checked_shr(TILE.0 as u32 - n).unwrap_or(0)
            };
            bits(end) & !bits(first)
        }))
    }

    /// The first column of row `y` that sees the opening at `pupil`, and the column after the last one. They may lie
    /// outside the frame.
    pub fn columns(&self, pupil: [f64; 2], y: usize) -> Option<[f64; 2]> {
        let SecondStop { centre, per_px } = self.second_stop;
        let middle = [0, 1].map(|i| pupil[i] / per_px + centre[i]);
        let down = y as f64 - middle[1];
        let half = per_px.powi(-2) - down * down;
        (half >= 0.0).then(|| [(middle[0] - half.sqrt()).ceil(), (middle[0] + half.sqrt()).floor() + 1.0])
    }

    /// The open parts as one list for the shaders, and the numbers of directions and distances.
    pub fn table(&self) -> (Vec<f32>, [usize; 2]) {
        let values = self.open.iter().flatten().map(|v| *v as f32).collect();
        (values, [DIRECTIONS, DISTANCES])
    }

    /// The same for the part of the frame that begins with row `y`.
    pub fn rows_from(&self, y: usize) -> PupilClip {
        PupilClip { second_stop: self.second_stop.rows_from(y), ..self.clone() }
    }

    /// The second stop.
    pub fn second_stop(&self) -> &SecondStop {
        &self.second_stop
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aperture::Side;
    use std::f64::consts::PI;

    fn clip() -> PupilClip {
        let second_stop = SecondStop { centre: [149.5, 99.5], per_px: 0.9 / 180.0 };
        PupilClip::new(second_stop, &Aperture::DISC)
    }

    #[test]
    fn the_open_part_is_the_intersection_of_two_circles() {
        let clip = clip();
        for (x, y) in [(149.5, 99.5), (10.0, 20.0), (299.0, 199.0), (200.0, 3.0)] {
            let c = clip.second_stop.stop(x, y);
            let apart = c[0].hypot(c[1]);
            let exact = (2.0 * (0.5 * apart).acos() - 0.5 * apart * (4.0 - apart * apart).sqrt()) / PI;
            assert!((clip.open(x, y) - exact).abs() < 2e-3, "{} against {exact}", clip.open(x, y));
        }
    }

    #[test]
    fn the_open_part_counts_the_points_inside_the_second_stop() {
        let hexagon = Aperture::new(6, 10.0, None).unwrap();
        for points in
            [hexagon.pupil_points(500), Aperture::DISC.pupil_points(500), vec![[1.5, 0.0], [0.0, -1.2]]]
        {
            for turn in 0..7 {
                let (sin, cos) = f64::from(turn).sin_cos();
                let counted: [f64; DISTANCES + 1] = std::array::from_fn(|i| {
                    let apart = 2.0 * i as f64 / DISTANCES as f64;
                    let inside = |l: &&[f64; 2]| (l[0] - apart * cos).hypot(l[1] - apart * sin) <= 1.0;
                    points.iter().filter(inside).count() as f64 / points.len() as f64
                });
                // A point exactly on the rim may be rounded to either side.
                let apart =
                    open_parts(&points, [cos, sin]).into_iter().zip(counted).map(|(a, b)| (a - b).abs());
                assert!(apart.fold(0.0, f64::max) <= 1.01 / points.len() as f64);
            }
        }
    }

    #[test]
    fn pixels_of_a_tile_see_what_the_formula_says() {
        let clip = clip();
        for origin in [(0, 0), (128, 96), (256, 160)] {
            for pupil in Aperture::DISC.lens_points(256, Side::Behind) {
                let rows = clip.pixels_seeing(pupil, origin).unwrap_or([0; TILE.1]);
                for (x, y) in (0..TILE.1).flat_map(|y| (0..TILE.0).map(move |x| (x, y))) {
                    let c = clip.second_stop.stop((origin.0 + x) as f64, (origin.1 + y) as f64);
                    let apart = (pupil[0] - c[0]).hypot(pupil[1] - c[1]);
                    if (apart - 1.0).abs() > 1e-9 {
                        assert_eq!(rows[y] >> x & 1 != 0, apart < 1.0);
                    }
                }
            }
        }
    }
}
