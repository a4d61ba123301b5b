//! The image of a point through an aberrated lens: the part of its light that lands in each pixel.
//!
//! The opening is divided into square cells, of which each has the light that passes it. The lens maps a cell to a small
//! parallelogram, which is drawn as the upright box with the same middle and the same variance along each axis. So light
//! is kept exactly, and that of a thin lens is what the pixels cover of its disc: its cells are boxes side by side.

use super::aberrated::Place;
use super::optical_vignetting::PupilClip;
use crate::aperture::Aperture;

/// Cells along the radius of the opening: as many as pixels along that of the image or more, but for these bounds. The
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
        let wanted = radius_px.ceil() as u32;
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

/// What the lens makes of the corners of all cells.
struct Lattice<'a> {
    place: &'a Place<'a>,
    /// Cells along the radius, and corners in a row.
    radius: f64,
    across: usize,
    corners: Vec<Corner>,
}

/// A corner of cells: where its light lands, its lens point, and whether light arrives.
#[derive(Clone, Copy)]
struct Corner {
    landing: [f64; 2],
    lens: [f64; 2],
    arrives: bool,
}

/// What a cell of the opening draws.
struct Drawn {
    middle: [f64; 2],
    /// Width and height of its box.
    size: [f64; 2],
    light: f64,
    lens: [f64; 2],
}

/// Into so many parts along each axis a cell is divided of which a part of the light arrives.
const PARTS: usize = 4;

impl<'a> Lattice<'a> {
    fn new(place: &'a Place<'a>, radius: i32, t: f64) -> Lattice<'a> {
        // Cells go from `-radius - 1` to `radius + 1`.
        let across = (2 * radius + 4) as usize;
        let radius = f64::from(radius);
        let at = |i: usize| (i as f64 - 0.5 * (across - 1) as f64) / radius;
        let corner = |i: usize| {
            let pupil = [at(i % across), at(i / across)];
            let (landing, lens) = place.landing(pupil, t);
            Corner { landing, lens, arrives: place.arrives(pupil) }
        };
        Lattice { place, radius, across, corners: (0..across * across).map(corner).collect() }
    }

    /// Adds what a cell draws.
    fn draw(&self, cell: [i32; 2], light: f64, drawn: &mut Vec<Drawn>) {
        let middle = self.across as i32 / 2 - 1;
        let at = |dx: i32, dy: i32| {
            &self.corners[(cell[1] + middle + dy) as usize * self.across + (cell[0] + middle + dx) as usize]
        };
        let corners = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
        let parts = match corners.iter().filter(|corner| corner.arrives).count() {
            0 => return,
            4 => 1,
            _ => PARTS,
        };
        let between = |[x, y]: [f64; 2], of: fn(&Corner) -> [f64; 2]| {
            let weights = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y];
            [0, 1].map(|i| corners.iter().zip(weights).map(|(corner, w)| w * of(corner)[i]).sum::<f64>())
        };
        let side = |ends: [usize; 4]| {
            let [a, b, c, d] = ends.map(|i| corners[i].landing);
            [0, 1].map(|i| 0.5 * (b[i] - a[i] + d[i] - c[i]))
        };
        let (along, down) = (side([0, 1, 2, 3]), side([0, 2, 1, 3]));
        // A uniform parallelogram has a twelfth of the squares of its sides for a variance.
        let size = [0, 1].map(|i| along[i].hypot(down[i]) / parts as f64);
        let part = |i: usize| (i as f64 + 0.5) / parts as f64;
        for place in (0..parts).flat_map(|y| (0..parts).map(move |x| [part(x), part(y)])) {
            let pupil = [0, 1].map(|i| (f64::from(cell[i]) - 0.5 + place[i]) / self.radius);
            if parts == 1 || self.place.arrives(pupil) {
                drawn.push(Drawn {
                    middle: between(place, |corner| corner.landing),
                    size,
                    light: light / (parts * parts) as f64,
                    lens: between(place, |corner| corner.lens),
                });
            }
        }
    }
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
        let mut drawn = Vec::with_capacity(cells.cells.len());
        for &(cell, light) in &cells.cells {
            let clipped = clip.map_or(1.0, |(clip, at)| {
                let pupil = cell.map(|v| f64::from(v) / f64::from(cells.radius));
                clip.share_of_pupil(at, pupil, f64::from(cells.radius))
            });
            lattice.draw(cell, light * clipped, &mut drawn);
        }
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
