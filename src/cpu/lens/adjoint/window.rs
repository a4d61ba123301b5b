//! Planes of sums: those of the cells around a tile, and those of the whole frame.

use super::plane_set::PlaneSet;
use crate::cpu::lens::lanes::FLOATS;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::padding::Padding;
use crate::scene::grid::TILE;
use rayon::prelude::*;

/// What is added to.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Pixels as they were given.
    Given,
    /// Cells of the first layer in exact discs.
    Level,
    /// Cells of a layer in a sweep.
    Swept(usize),
    /// The shifts of the cells of a layer.
    Shifts(usize),
}

impl Target {
    /// The planes of a picture of so many channels.
    fn planes(self, channels: usize) -> usize {
        match self {
            Target::Given | Target::Level | Target::Swept(_) => channels,
            Target::Shifts(_) => 1,
        }
    }
}

/// The cells around a tile.
#[derive(Debug, Clone, Copy)]
pub struct Region {
    /// Cells from one row to the next, and in front of the tile's first column and row.
    pub stride: usize,
    margin: usize,
    pub rows: usize,
    /// The column and the row of the first cell in the padded frame.
    first: (usize, usize),
}

impl Region {
    /// The cells that are at most `reach` columns or rows away from the tile at `origin`, as far as the frame is padded.
    pub fn new(padding: &Padding, origin: (usize, usize), reach: usize) -> Region {
        let margin = reach.min(padding.pad[0]).min(padding.pad[1]);
        let first = (origin.0 + padding.pad[0] - margin, origin.1 + padding.pad[1] - margin);
        Region { stride: TILE.0 + 2 * margin, margin, rows: TILE.1 + 2 * margin, first }
    }

    /// The number of values of a plane: a group of numbers may begin at any cell.
    pub fn len(&self) -> usize {
        self.stride * self.rows + FLOATS
    }

    /// Where a pixel of the tile is in the planes.
    #[inline(always)]
    pub fn index(&self, x: usize, y: usize) -> usize {
        (y + self.margin) * self.stride + x + self.margin
    }

    /// The columns and the rows of the padded frame.
    pub fn padded_columns(&self) -> std::ops::Range<usize> {
        self.first.0..self.first.0 + self.stride
    }

    pub fn padded_rows(&self) -> std::ops::Range<usize> {
        self.first.1..self.first.1 + self.rows
    }

    /// The place of a row in the padded frame.
    pub fn padded_row(&self, padding: &Padding, y: usize) -> usize {
        (self.first.1 + y) * padding.stride + self.first.0
    }
}

/// What a tile adds to the cells around it.
pub struct Window {
    pub target: Target,
    pub region: Region,
    pub planes: PlaneSet,
}

impl Window {
    /// So many planes of zeros.
    pub fn new(target: Target, region: Region, planes: usize) -> Window {
        Window { target, region, planes: PlaneSet::zeros(planes, region.len()) }
    }
}

/// The sums of a whole frame: planes of each target.
pub struct Sums {
    size: Size,
    targets: Vec<(Target, Buffer<f32>)>,
}

impl Sums {
    /// Zeros.
    pub fn new(size: Size, targets: impl IntoIterator<Item = Target>) -> Sums {
        let zeros = |target: Target| Buffer::full(size.pixels() * target.planes(size.channels), 0.0);
        Sums { size, targets: targets.into_iter().map(|target| (target, zeros(target))).collect() }
    }

    /// Takes the sums of a target out, which must be there.
    pub fn take(&mut self, target: Target) -> Buffer<f32> {
        let at = self.targets.iter().position(|(own, _)| *own == target).expect("the target is summed up");
        self.targets.swap_remove(at).1
    }

    /// Adds windows, in their order. What lies beyond the border is the mirror image of what is added to.
    pub fn add(&mut self, padding: &Padding, windows: &[Window]) {
        let (n, width) = (self.size.pixels(), self.size.width);
        let planes: Vec<(Target, usize, &mut [f32])> = self
            .targets
            .iter_mut()
            .flat_map(|(target, planes)| {
                let target = *target;
                planes.chunks_exact_mut(n).enumerate().map(move |(c, plane)| (target, c, plane))
            })
            .collect();
        planes.into_par_iter().for_each(|(target, c, plane)| {
            for Window { region, planes, .. } in windows.iter().filter(|window| window.target == target) {
                let columns = region.first.0..region.first.0 + region.stride;
                let frame = padding.pad[0]..padding.pad[0] + width;
                let inside =
                    columns.start.clamp(frame.start, frame.end)..columns.end.clamp(frame.start, frame.end);
                let rows = planes.plane(c).chunks_exact(region.stride).take(region.rows);
                for (py, row) in (region.first.1..).zip(rows) {
                    let into = &mut plane[padding.row(py).0 * width..][..width];
                    let of = |px: usize| row[px - columns.start];
                    let own = &row[inside.start - columns.start..inside.end - columns.start];
                    let within = &mut into[inside.start - frame.start..inside.end - frame.start];
                    within.iter_mut().zip(own).for_each(|(into, v)| *into += v);
                    let outside = (columns.start..inside.start).chain(inside.end..columns.end);
                    outside.for_each(|px| into[padding.column(px).0] += of(px));
                }
            }
        });
    }
}
