//! Planes of sums: those of a band of tiles, with the margin that its rays reach, and those of the whole frame.

use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::padding::Padding;
use rayon::prelude::*;
use std::ops::Range;

/// The padded rows around a band of tiles, to which the band adds. All planes are of the same size.
pub struct Window {
    padding: Padding,
    /// Planes of each target.
    each: usize,
    /// The first padded row.
    first_row: usize,
    kept: Kept,
    planes: Vec<Buffer<f32>>,
}

/// What is added to.
#[derive(Clone, Copy)]
pub enum Target {
    /// Pixels as they were given.
    Given,
    /// Cells of the first layer in exact discs.
    Level,
    /// Cells of a layer in a sweep.
    Swept(usize),
}

/// The targets that are kept.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// All of them.
    All,
    /// What is swept.
    Swept,
}

impl Kept {
    /// Number of targets, for so many layers.
    fn targets(self, layers: usize) -> usize {
        self.number(Target::Swept(layers))
    }

    fn number(self, target: Target) -> usize {
        let swept = match self {
            Kept::All => 2,
            Kept::Swept => 0,
        };
        match target {
            Target::Given => 0,
            Target::Level => 1,
            Target::Swept(layer) => swept + layer,
        }
    }
}

impl Window {
    /// Zeros around these rows of the frame, `each` planes for every target.
    pub fn new(padding: &Padding, kept: Kept, each: usize, layers: usize, rows: Range<usize>) -> Window {
        // A row of the frame is `pad` rows further down in the padded one, and rays reach as far up.
        let cells = (rows.len() + 2 * padding.pad) * padding.stride;
        let planes = (0..kept.targets(layers) * each).map(|_| Buffer::full(cells, 0.0)).collect();
        Window { padding: *padding, each, first_row: rows.start, kept, planes }
    }

    /// The planes of a target that is kept.
    pub fn planes(&mut self, target: Target) -> &mut [Buffer<f32>] {
        &mut self.planes[self.kept.number(target) * self.each..][..self.each]
    }

    /// Where a pixel of the frame is in the planes.
    pub fn index(&self, x: usize, y: usize) -> usize {
        self.padding.index(x, y) - self.first_cell()
    }

    /// The place of its first cell in the padded frame.
    pub fn first_cell(&self) -> usize {
        self.first_row * self.padding.stride
    }

    /// Cells from one row to the next.
    pub fn stride(&self) -> usize {
        self.padding.stride
    }
}

/// The sums of a whole frame: for each target that is kept, its planes one after another.
pub struct Sums {
    size: Size,
    pub given: Buffer<f32>,
    pub level: Buffer<f32>,
    pub swept: Vec<Buffer<f32>>,
}

impl Sums {
    /// Zeros; the channels of `size` are the planes of each target.
    pub fn new(size: Size, kept: Kept, layers: usize) -> Sums {
        let zeros = || Buffer::full(size.pixels() * size.channels, 0.0);
        let unless_swept = || if kept == Kept::All { zeros() } else { Buffer::unset(0) };
        Sums {
            size,
            given: unless_swept(),
            level: unless_swept(),
            swept: (0..layers).map(|_| zeros()).collect(),
        }
    }

    /// Adds a window. What lies beyond the border is the mirror image of what is added to.
    pub fn add(&mut self, window: &Window) {
        let (n, width) = (self.size.pixels(), self.size.width);
        let Window { padding, first_row, .. } = window;
        let inside = padding.pad..padding.pad + width;
        let outside: Vec<(usize, usize)> = (0..inside.start)
            .chain(inside.end..padding.stride)
            .map(|px| (px, padding.column(px).0))
            .collect();
        let targets = [&mut self.given, &mut self.level].into_iter().chain(&mut self.swept);
        let planes: Vec<&mut [f32]> = targets.flat_map(|target| target.chunks_exact_mut(n)).collect();
        planes.into_par_iter().zip(&window.planes).for_each(|(plane, from)| {
            for (py, row) in (*first_row..).zip(from.chunks_exact(padding.stride)) {
                let into = &mut plane[padding.row(py).0 * width..][..width];
                into.iter_mut().zip(&row[inside.clone()]).for_each(|(into, v)| *into += v);
                outside.iter().for_each(|&(px, x)| into[x] += row[px]);
            }
        });
    }
}
