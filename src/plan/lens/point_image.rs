//! The image of a point through an aberrated lens: the part of its light that lands in each pixel.
//!
//! The opening is divided into square cells, of which each has the light that passes it. The lens maps a cell to a small
//! parallelogram, which is drawn as the upright box with the same middle and the same variance along each axis. So light
//! is kept exactly, and that of a thin lens is what the pixels cover of its disc: its cells are boxes side by side.

use super::aberrated::Place;
use super::optical_vignetting::PupilClip;
use crate::aperture::Aperture;

/// Cells along the radius of the opening: as many as pixels along two radii of the image, but for these bounds. The
/// rim of larger images is as soft as a cell, less than a hundredth of their radius.
const FEWEST: i32 = 32;
const MOST: i32 = 128;

/// The opening, divided into cells.
pub struct Cells {
    /// Cells along the radius.
    pub radius: i32,
    /// Column and row from the middle, and light.
    cells: Vec<([i32; 2], f64)>,
}

impl Cells {
    /// The number of cells along the radius for an image of this radius: a power of two.
    pub fn radius_for(radius_px: f64) -> i32 {
        let wanted = (2.0 * radius_px).ceil() as u32;
        (wanted.next_power_of_two() as i32).clamp(FEWEST, MOST)
    }

    pub fn new(aperture: &Aperture, radius: i32) -> Cells {
        let kernel = aperture.unaberrated().kernel(f64::from(radius));
        Cells { radius, cells: kernel.weights().map(|(x, y, light)| ([x, y], f64::from(light))).collect() }
    }
}

/// The light of a point in the pixels around it.
pub struct PointImage {
    /// The first column and row, from the point.
    pub first: [i32; 2],
    pub columns: usize,
    /// Row by row.
    pub light: Vec<f32>,
}

/// Landings of the corners of cells, with their lens points.
struct Lattice {
    /// Corners in a row.
    across: usize,
    corners: Vec<Option<([f64; 2], [f64; 2])>>,
}

impl Lattice {
    fn new(place: &Place, radius: i32, t: f64) -> Lattice {
        // Cells go from `-radius - 1` to `radius + 1`.
        let across = (2 * radius + 4) as usize;
        let at = |i: usize| (i as f64 - 0.5 * (across - 1) as f64) / f64::from(radius);
        let corner = |i: usize| place.landing([at(i % across), at(i / across)], t);
        Lattice { across, corners: (0..across * across).map(corner).collect() }
    }

    /// The four corners of a cell: upper left, upper right, lower left, lower right.
    fn of_cell(&self, [x, y]: [i32; 2]) -> [Option<([f64; 2], [f64; 2])>; 4] {
        let middle = self.across as i32 / 2 - 1;
        let at = |dx: i32, dy: i32| {
            self.corners[(y + middle + dy) as usize * self.across + (x + middle + dx) as usize]
        };
        [at(0, 0), at(1, 0), at(0, 1), at(1, 1)]
    }
}

/// What a cell of the opening draws.
struct Drawn {
    middle: [f64; 2],
    /// Width and height of its box.
    size: [f64; 2],
    light: f64,
    lens: [f64; 2],
}

impl PointImage {
    /// The image of a point of shift `t`. `visible` is the part of the light that passes what is in front of the point on
    /// its way from a lens point, and the second stop is that of the point's own place.
    pub fn new(
        place: &Place,
        cells: &Cells,
        t: f64,
        clip: Option<(&PupilClip, [f64; 2])>,
        visible: impl Fn([f64; 2]) -> f64,
    ) -> PointImage {
        let lattice = Lattice::new(place, cells.radius, t);
        let drawn: Vec<Drawn> = cells
            .cells
            .iter()
            .filter_map(|&(cell, light)| {
                let clipped = clip.map_or(1.0, |(clip, at)| {
                    let pupil = cell.map(|v| f64::from(v) / f64::from(cells.radius));
                    clip.share_of_pupil(at, pupil, f64::from(cells.radius))
                });
                draw(lattice.of_cell(cell), light * clipped)
            })
            .collect();
        let total: f64 = drawn.iter().map(|d| d.light).sum();
        let ends = [0, 1].map(|i| {
            let least = drawn.iter().map(|d| d.middle[i] - 0.5 * d.size[i]).fold(f64::INFINITY, f64::min);
            let most = drawn.iter().map(|d| d.middle[i] + 0.5 * d.size[i]).fold(f64::NEG_INFINITY, f64::max);
            if least <= most { [least.round() as i32, most.round() as i32] } else { [0, 0] }
        });
        let [columns, rows] = ends.map(|[first, last]| (last - first + 1) as usize);
        let first = ends.map(|[first, _]| first);
        let mut light = vec![0.0f64; columns * rows];
        for d in drawn.iter().filter(|d| d.light > 0.0) {
            let light_here = d.light / total * visible(d.lens);
            for (y, over) in shares(d.middle[1], d.size[1]) {
                let row = &mut light[(y - first[1]) as usize * columns..][..columns];
                for (x, across) in shares(d.middle[0], d.size[0]) {
                    row[(x - first[0]) as usize] += light_here * over * across;
                }
            }
        }
        PointImage { first, columns, light: light.into_iter().map(|v| v as f32).collect() }
    }

    /// The rows, from the point, with their light.
    pub fn rows(&self) -> impl Iterator<Item = (i32, &[f32])> {
        (self.first[1]..).zip(self.light.chunks_exact(self.columns))
    }
}

/// The box of a cell with these corners. Corners through which no light arrives take their part of it along.
fn draw(corners: [Option<([f64; 2], [f64; 2])>; 4], light: f64) -> Option<Drawn> {
    let arriving = corners.iter().flatten().count() as f64;
    let mean = |of: fn(&([f64; 2], [f64; 2])) -> [f64; 2]| {
        let sum = corners.iter().flatten().map(of).fold([0.0; 2], |[x, y], v| [x + v[0], y + v[1]]);
        sum.map(|v| v / arriving)
    };
    if arriving == 0.0 {
        return None;
    }
    // The sides of the parallelogram, from those pairs of corners that are known.
    let side = |pairs: [(usize, usize); 2]| {
        let ends = pairs.iter().filter_map(|&(a, b)| Some((corners[a]?.0, corners[b]?.0)));
        let sides: Vec<[f64; 2]> = ends.map(|(a, b)| [b[0] - a[0], b[1] - a[1]]).collect();
        [0, 1].map(|i| sides.iter().map(|s| s[i]).sum::<f64>() / sides.len().max(1) as f64)
    };
    let (along, down) = (side([(0, 1), (2, 3)]), side([(0, 2), (1, 3)]));
    Some(Drawn {
        middle: mean(|c| c.0),
        // A uniform parallelogram has a twelfth of the squares of its sides for a variance.
        size: [0, 1].map(|i| along[i].hypot(down[i])),
        light: 0.25 * arriving * light,
        lens: mean(|c| c.1),
    })
}

/// The pixels of one axis that an interval covers, and the part of it that each has.
fn shares(middle: f64, size: f64) -> impl Iterator<Item = (i32, f64)> {
    let (from, to) = (middle - 0.5 * size, middle + 0.5 * size);
    let (first, last) = (from.round() as i32, to.round() as i32);
    (first..=last).map(move |pixel| {
        if first == last {
            return (pixel, 1.0);
        }
        let (left, right) = (f64::from(pixel) - 0.5, f64::from(pixel) + 0.5);
        (pixel, (to.min(right) - from.max(left)).max(0.0) / size)
    })
}
