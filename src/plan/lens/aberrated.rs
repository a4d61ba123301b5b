//! A lens with transverse aberrations: the rays of a tile, and how far they go.
//!
//! A tile shares its lens samples, but the aberrations change from pixel to pixel. They are evaluated at the four
//! corners of the tile. For each sample, a pixel follows the ray of one of them, chosen by comparing two numbers of the
//! sample with the pixel's place between the corners: so that over many samples, it follows each as often as it counts
//! in a bilinear interpolation. Tiles share their corners, so there is no seam between them.

use super::lens_samples::LensSample;
use super::optical_vignetting::Seen;
use crate::aperture::{Aperture, Side};
use crate::optics::{Course, Field, Transverse};
use crate::scene::grid::TILE;

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
    /// The radius of a disc with the variance of what is drawn of a point in focus.
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
    farthest_px: f64,
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
        let steepness = self.steepness();
        let farthest_px = field.farthest_px() * (1.0 + steepness / (1.0 - steepness));
        Place { field, lens: self, farthest_px }
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
    /// How far rays go.
    pub fn bounds(&self) -> Bounds {
        let deviation = self.field.deviation();
        let widest = self.lens.transverse.widest();
        Bounds {
            offset_px: self.farthest_px,
            // |B / w - l| <= |B - l| / w + |l| (1 - 1 / w)
            lens: deviation.lens / widest + 1.0 - 1.0 / widest,
            lost: deviation.lost,
            spread_px: self.field.radius_in_focus_px(),
        }
    }

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
        (at_most(self.farthest_px, start), lens.map(|l| at_most(1.0, l)))
    }

    /// The ray of a sample, if it arrives.
    pub fn ray(&self, sample: &LensSample) -> Option<LensSample> {
        let course = self.field.course(sample.pupil)?;
        let (offset, [in_front, behind]) = self.adapted(&course, [sample.in_front, sample.behind]);
        let start = [0, 1].map(|i| sample.start[i] + offset[i]);
        Some(LensSample { in_front, behind, start, ..*sample })
    }

    /// Where the light of a point of shift `t` lands through a point of the opening, relative to the point, and the lens
    /// point from which it seems to come; and whether it arrives.
    pub fn landing(&self, pupil: [f64; 2], t: f64) -> Option<([f64; 2], [f64; 2])> {
        let course = self.field.course(pupil)?;
        let aperture = &self.lens.aperture;
        let thin = [Side::InFront, Side::Behind].map(|side| aperture.lens_point(pupil, side));
        let (offset, lens) = self.adapted(&course, thin);
        let l = lens[usize::from(t <= 0.0)];
        Some(([0, 1].map(|i| -offset[i] - l[i] * t), l))
    }
}

/// The corners of all tiles of a frame.
pub struct Corners {
    /// Corners in a row.
    across: usize,
    bounds: Vec<Bounds>,
}

impl Corners {
    pub fn new(lens: &Aberrated, (width, height): (usize, usize)) -> Corners {
        let (across, down) = (width.div_ceil(TILE.0) + 1, height.div_ceil(TILE.1) + 1);
        let corner = |i: usize| [(i % across * TILE.0) as f64, (i / across * TILE.1) as f64];
        let bounds = (0..across * down).map(|i| lens.at(corner(i)).bounds()).collect();
        Corners { across, bounds }
    }

    /// The bounds of the whole frame.
    pub fn all(&self) -> Bounds {
        self.bounds.iter().fold(Bounds::default(), |all, own| all.max(*own))
    }

    /// The bounds of the tile at `origin`.
    pub fn of_tile(&self, origin: (usize, usize)) -> Bounds {
        let first = origin.1 / TILE.1 * self.across + origin.0 / TILE.0;
        let corners = [first, first + 1, first + self.across, first + self.across + 1];
        corners.into_iter().fold(Bounds::default(), |all, i| all.max(self.bounds[i]))
    }

    /// [`Bounds::spread_px`] of pixels `x ..` of row `y`, between those of the corners.
    pub fn spread_px(&self, y: usize, x: usize, out: &mut [f32]) {
        let (ty, fy) = (y / TILE.1, (y % TILE.1) as f64 / TILE.1 as f64);
        let between = |a: f64, b: f64, f: f64| a + f * (b - a);
        let column = |tx: usize| {
            let at = |ty: usize| self.bounds[ty * self.across + tx].spread_px;
            between(at(ty), at(ty + 1), fy)
        };
        for (i, out) in out.iter_mut().enumerate() {
            let x = x + i;
            let (tx, fx) = (x / TILE.0, (x % TILE.0) as f64 / TILE.0 as f64);
            *out = between(column(tx), column(tx + 1), fx) as f32;
        }
    }
}

/// The rays of the tile at `origin`, and which of its pixels follow each: every pixel follows one for each sample, but
/// for those that do not arrive.
pub fn rays(lens: &Aberrated, origin: (usize, usize), samples: &[LensSample]) -> Vec<(LensSample, Seen)> {
    let mut rays = Vec::with_capacity(2 * samples.len());
    let corner = |i: usize| {
        let [right, below] = [i & 1, i >> 1];
        lens.at([(origin.0 + right * TILE.0) as f64, (origin.1 + below * TILE.1) as f64])
    };
    let corners: [Place; 4] = std::array::from_fn(corner);
    for sample in samples {
        // From this column and this row on, pixels are nearer to the farther corners than the sample's numbers.
        let [column, row] = [0, 1].map(|i| {
            let side = if i == 0 { TILE.0 } else { TILE.1 };
            (sample.pick[i] * side as f64) as usize + 1
        });
        let columns = u64::MAX.checked_shl(column as u32).unwrap_or(0);
        for (i, place) in corners.iter().enumerate() {
            let [right, below] = [i & 1 != 0, i >> 1 != 0];
            let columns = if right { columns } else { !columns };
            let rows = if below { row..TILE.1 } else { 0..row };
            if columns == 0 || rows.is_empty() {
                continue;
            }
            if let Some(ray) = place.ray(sample) {
                rays.push((ray, std::array::from_fn(|y| if rows.contains(&y) { columns } else { 0 })));
            }
        }
    }
    rays
}
