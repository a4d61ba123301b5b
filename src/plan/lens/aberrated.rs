//! A lens with transverse aberrations: the rays of a tile, and how far they go.
//!
//! A tile shares its lens samples, but the aberrations change from pixel to pixel. They are evaluated at the corners of
//! blocks, or of whole tiles where much is blurred anyhow. For each sample, a pixel follows the ray of one corner of its
//! block, chosen by comparing two numbers of the sample with the pixel's place between the corners: so that over many
//! samples, it follows each as often as it counts in a bilinear interpolation. Blocks share their corners, so there is no
//! seam between them nor between tiles.

use super::lens_samples::LensSample;
use super::optical_vignetting::Seen;
use crate::aperture::{Aperture, Side};
use crate::optics::{Course, Deviation, Field, Transverse};
use crate::scene::grid::{BLOCK, TILE};

/// Up to this distance in pixels between where rays land and where those of a thin lens do, a tile is as through a thin
/// lens: an edge that moves so far changes the pixels on it by a twentieth of its contrast.
const THIN_PX: f64 = 0.05;
/// From this distance on, nothing of the thin lens is left.
const ABERRATED_PX: f64 = 2.0 * THIN_PX;

/// A lens with transverse aberrations and its opening.
#[derive(Debug, Clone)]
pub struct Aberrated {
    transverse: Transverse,
    aperture: Aperture,
}

/// How far rays of a place or a tile go at most.
#[derive(Debug, Clone, Copy, Default)]
pub struct Bounds {
    /// Where they pass what is in focus, in pixels from their pixel.
    pub offset_px: f64,
    /// How far their lens points are from those of a thin lens, and how far inside of the rim light is lost.
    lens: f64,
    lost: f64,
    /// The radius of a disc with the variance of what is drawn of a point in focus; of a tile only.
    pub spread_px: f64,
}

impl Bounds {
    fn max(self, other: Bounds) -> Bounds {
        Bounds {
            offset_px: self.offset_px.max(other.offset_px),
            lens: self.lens.max(other.lens),
            lost: self.lost.max(other.lost),
            spread_px: self.spread_px.max(other.spread_px),
        }
    }

    /// The share of a thin lens in what is drawn, where discs of up to this radius reach.
    pub fn thin(&self, reach_px: f64) -> f32 {
        let off = self.offset_px + (self.lens + self.lost) * reach_px;
        ((ABERRATED_PX - off) / (ABERRATED_PX - THIN_PX)).clamp(0.0, 1.0) as f32
    }
}

/// The lens at one place of the frame.
pub struct Place<'a> {
    field: Field<'a>,
    lens: &'a Aberrated,
    /// How far rays go.
    pub bounds: Bounds,
}

/// A vector, shortened to this length.
fn at_most(length: f64, v: [f64; 2]) -> [f64; 2] {
    let own = v[0].hypot(v[1]);
    if own > length { v.map(|v| v * (length / own)) } else { v }
}

impl Aberrated {
    /// The lens for an opening that leans. The strength of the lens has to be scaled up by [`Transverse::widest`].
    pub fn new(transverse: Transverse, aperture: &Aperture) -> Aberrated {
        Aberrated { transverse, aperture: aperture.clone() }
    }

    /// The lens at a pixel.
    pub fn at(&self, place: [f64; 2]) -> Place<'_> {
        let field = self.transverse.at(place);
        let bounds = self.bounds_of(&field.deviation());
        Place { field, lens: self, bounds }
    }

    /// The bounds of a lens that differs so far from a thin one, but for its spread.
    fn bounds_of(&self, deviation: &Deviation) -> Bounds {
        let (widest, steepness) = (self.transverse.widest(), self.steepness());
        // See `Place::adapted` for what a focus plane that leans adds.
        let leant = 1.0 + steepness / (1.0 - steepness);
        Bounds {
            offset_px: deviation.focused * self.transverse.half_diagonal_px * leant,
            // |B / w - l| <= |B - l| / w + |l| (1 - 1 / w)
            lens: deviation.lens / widest + 1.0 - 1.0 / widest,
            lost: deviation.lost,
            spread_px: 0.0,
        }
    }

    /// The opening.
    pub fn aperture(&self) -> &Aperture {
        &self.aperture
    }

    fn steepness(&self) -> f64 {
        let [x, y] = self.aperture.lean();
        x.hypot(y)
    }
}

impl Place<'_> {
    /// The offset of a ray from its pixel in focus, and its lens points in front of the focus and behind it, within the
    /// unit disc; those of a thin lens are given.
    ///
    /// With a focus plane that leans by `b` of shift per pixel, `t = t' + b . (q - p)`: see
    /// [`FocusSurface`](crate::optics::FocusSurface). With `q - p = A + B t` that is `t = (t' + b . A) / (1 - b . B)`.
    fn adapted(&self, course: &Course, thin: [[f64; 2]; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let lean = self.lens.aperture.lean();
        let upright = 1.0 - self.lens.steepness();
        let leant = |[x, y]: [f64; 2]| lean[0] * x + lean[1] * y;
        let lens = course.lens.map_or(thin, |lens| {
            lens.map(|l| {
                let l = at_most(1.0, l.map(|v| v / self.lens.transverse.widest()));
                l.map(|v| v * upright / (1.0 - leant(l)))
            })
        });
        let start = course.start_px;
        let further = leant(start) / upright;
        let start = [0, 1].map(|i| start[i] + lens[1][i] * further);
        (at_most(self.bounds.offset_px, start), lens.map(|l| at_most(1.0, l)))
    }

    /// The ray of a sample, if it arrives.
    pub fn ray(&self, sample: &LensSample) -> Option<LensSample> {
        if !self.field.arrives(sample.pupil) {
            return None;
        }
        let course = self.field.course(sample.pupil);
        let (offset, [in_front, behind]) = self.adapted(&course, [sample.in_front, sample.behind]);
        let start = [0, 1].map(|i| sample.start[i] + offset[i]);
        Some(LensSample { in_front, behind, start, ..*sample })
    }

    /// Where the light of a point of shift `t` lands through a point of the opening, relative to the point, and the lens
    /// point from which it seems to come, if it arrives.
    pub fn landing(&self, pupil: [f64; 2], t: f64) -> ([f64; 2], [f64; 2]) {
        let course = self.field.course(pupil);
        let aperture = &self.lens.aperture;
        let thin = [Side::InFront, Side::Behind].map(|side| aperture.lens_point(pupil, side));
        let (offset, lens) = self.adapted(&course, thin);
        let l = lens[usize::from(t <= 0.0)];
        ([0, 1].map(|i| -offset[i] - l[i] * t), l)
    }

    /// Whether light arrives through a point of the opening.
    pub fn arrives(&self, pupil: [f64; 2]) -> bool {
        self.field.arrives(pupil)
    }
}

/// How far the rays of each tile of a frame go.
pub struct Reaches {
    /// Corners of tiles in a row.
    across: usize,
    /// [`Bounds::spread_px`] at each corner.
    spread_px: Vec<f64>,
    /// The bounds of each tile, one fewer in a row.
    tiles: Vec<Bounds>,
}

impl Reaches {
    pub fn new(lens: &Aberrated, (width, height): (usize, usize)) -> Reaches {
        let (columns, rows) = (width.div_ceil(TILE.0), height.div_ceil(TILE.1));
        let across = columns + 1;
        let corner = |i: usize| [(i % across * TILE.0) as f64, (i / across * TILE.1) as f64];
        let spread = |i: usize| lens.transverse.at(corner(i)).radius_in_focus_px();
        let spread_px: Vec<f64> = (0..across * (rows + 1)).map(spread).collect();
        let tile = |i: usize| {
            let first = i / columns * across + i % columns;
            let corners = [first, first + 1, first + across, first + across + 1];
            let deviation = lens.transverse.deviation_between(corner(first), corner(first + across + 1));
            let spread_px = corners.into_iter().map(|i| spread_px[i]).fold(0.0, f64::max);
            Bounds { spread_px, ..lens.bounds_of(&deviation) }
        };
        let tiles = (0..columns * rows).map(tile).collect();
        Reaches { across, spread_px, tiles }
    }

    /// The bounds of the whole frame.
    pub fn all(&self) -> Bounds {
        self.tiles.iter().fold(Bounds::default(), |all, own| all.max(*own))
    }

    /// The bounds of the tile at `origin`.
    pub fn of_tile(&self, origin: (usize, usize)) -> Bounds {
        self.tiles[origin.1 / TILE.1 * (self.across - 1) + origin.0 / TILE.0]
    }

    /// [`Bounds::spread_px`] of pixels `x ..` of row `y`, between those of the corners.
    pub fn spread_px(&self, y: usize, x: usize, out: &mut [f32]) {
        let (ty, fy) = (y / TILE.1, (y % TILE.1) as f64 / TILE.1 as f64);
        let between = |a: f64, b: f64, f: f64| a + f * (b - a);
        let column = |tx: usize| {
            let at = |ty: usize| self.spread_px[ty * self.across + tx];
            between(at(ty), at(ty + 1), fy)
        };
        for (i, out) in out.iter_mut().enumerate() {
            let x = x + i;
            let (tx, fx) = (x / TILE.0, (x % TILE.0) as f64 / TILE.0 as f64);
            *out = between(column(tx), column(tx + 1), fx) as f32;
        }
    }
}

/// Aberrations are evaluated at the corners of a tile, and not of its blocks, if rays start so many times nearer to one
/// another there than they reach: the mean of four images then adds a hundredth to the variance of the blur at most, and
/// every corner has its own rays to trace.
const NEARER: f64 = 8.0;
/// Of about so many samples it is found how far apart their rays start.
const LOOKED_AT: usize = 16;

/// Which columns or rows of a tile, as bits, choose each of its corners, `side` pixels apart, for a number from 0 to 1.
fn choosing(pick: f64, side: usize, extent: usize) -> Vec<u64> {
    let first_bits = |n: usize| u64::MAX.checked_shr(64 - n as u32).unwrap_or(0);
    // From this one on, pixels are nearer to the farther corner of their block than the number.
    let nearer = first_bits((pick * side as f64) as usize + 1);
    let farther = first_bits(side) & !nearer;
    let last = extent / side;
    let choosing = |i: usize| {
        let own = if i < last { nearer << (i * side) } else { 0 };
        let before = if i > 0 { farther << ((i - 1) * side) } else { 0 };
        own | before
    };
    (0..=last).map(choosing).collect()
}

/// The corners, by row and column, `sides` pixels apart along each axis, of the tile at `origin`.
fn corners_of_tile(lens: &Aberrated, origin: (usize, usize), sides: [usize; 2]) -> Vec<Vec<Place<'_>>> {
    let corner = |column: usize, row: usize| {
        lens.at([(origin.0 + column * sides[0]) as f64, (origin.1 + row * sides[1]) as f64])
    };
    let row = |row: usize| (0..=TILE.0 / sides[0]).map(|column| corner(column, row)).collect();
    (0..=TILE.1 / sides[1]).map(row).collect()
}

/// How far apart in pixels rays of one sample start at some corners, at most.
fn change_px(corners: &[Vec<Place>], samples: &[LensSample]) -> f64 {
    let of_sample = |sample: &LensSample| {
        let mut starts = corners.iter().flatten().map(|place| place.field.course(sample.pupil).start_px);
        let first = starts.next().unwrap_or_default();
        starts.map(|start| (start[0] - first[0]).hypot(start[1] - first[1])).fold(0.0, f64::max)
    };
    let some = samples.iter().step_by(samples.len().div_ceil(LOOKED_AT).max(1));
    some.map(of_sample).fold(0.0, f64::max)
}

/// The rays of the tile at `origin`, which reach so far, and which of its pixels follow each: every pixel follows one for
/// each sample, but for those that do not arrive.
pub fn rays(
    lens: &Aberrated,
    (origin, reach_px): ((usize, usize), f64),
    samples: &[LensSample],
) -> Vec<(LensSample, Seen)> {
    let mut sides = [TILE.0, TILE.1];
    let mut corners = corners_of_tile(lens, origin, sides);
    if NEARER * change_px(&corners, samples) > reach_px {
        sides = [BLOCK; 2];
        corners = corners_of_tile(lens, origin, sides);
    }
    let mut rays = Vec::with_capacity(corners.len() * corners[0].len() * samples.len());
    for sample in samples {
        let columns = choosing(sample.pick[0], sides[0], TILE.0);
        let rows = choosing(sample.pick[1], sides[1], TILE.1);
        for (places, &rows) in corners.iter().zip(&rows) {
            for (place, &columns) in
                places.iter().zip(&columns).filter(|(_, columns)| rows != 0 && **columns != 0)
            {
                if let Some(ray) = place.ray(sample) {
                    let seen = std::array::from_fn(|y| if rows >> y & 1 != 0 { columns } else { 0 });
                    rays.push((ray, seen));
                }
            }
        }
    }
    rays
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_chooses_one_corner_of_its_block_as_often_as_it_is_near() {
        for (side, extent) in [(BLOCK, TILE.0), (BLOCK, TILE.1), (TILE.0, TILE.0), (TILE.1, TILE.1)] {
            let n = 100 * side;
            let mut chosen = vec![vec![0; extent / side + 1]; extent];
            for i in 0..n {
                let bits = choosing((i as f64 + 0.5) / n as f64, side, extent);
                let all = u64::MAX >> (64 - extent);
                assert_eq!(bits.iter().fold(0, |all, own| all ^ own), all);
                for (x, chosen) in chosen.iter_mut().enumerate() {
                    (0..bits.len()).filter(|c| bits[*c] >> x & 1 != 0).for_each(|c| chosen[c] += 1);
                }
            }
            for (x, chosen) in chosen.iter().enumerate() {
                let farther = (x % side) as f64 / side as f64;
                let share = |corner: usize| f64::from(chosen[corner]) / n as f64;
                assert!((share(x / side + 1) - farther).abs() < 1e-9, "pixel {x}");
                assert!((share(x / side) + farther - 1.0).abs() < 1e-9, "pixel {x}");
            }
        }
    }
}
