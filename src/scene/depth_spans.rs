//! The interval of depth that every cell spans, as 16-bit codes.
//!
//! A cell spans the depths from `lo` to `hi`. A surface stays closed because every cell reaches half-way to its
//! neighbours.

use super::depth_codes::DepthCodes;
use super::edges::{CONNECTED_PX, DOWN, EDGE, RIGHT};
use super::layer::SceneLayer;
use crate::memory::Buffer;
use crate::picture::{Size, range};
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Number of cells of a row that are processed together.
pub const CHUNK: usize = 64;

/// Least and greatest shift of all cells.
pub fn shift_range(layers: &[SceneLayer]) -> (f64, f64) {
    let ranges = layers.iter().map(|layer| range(&layer.s));
    let [min, max] = ranges.fold(range(&[]), |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
    if min <= max { (f64::from(min), f64::from(max)) } else { (0.0, 0.0) }
}

/// The position of a cell: its layer and its pixel.
#[derive(Clone, Copy)]
pub struct Cell {
    pub layer: usize,
    pub index: usize,
}

/// The neighbouring cells, at the four adjacent pixels, that continue the surface of `cell`. A holdout continues no
/// surface that is seen, nor that a holdout.
pub fn neighbours(layers: &[SceneLayer], size: Size, cell: Cell) -> impl Iterator<Item = Cell> + '_ {
    let (width, height) = (size.width, size.height);
    let (x, y, p) = (cell.index % width, cell.index / width, cell.index);
    let own = &layers[cell.layer];
    let s = own.s[p];
    // For each neighbour: its pixel, the pixel that stores the connection to it, and the bit of that connection.
    let sides = [
        (x > 0).then(|| (p - 1, p - 1, RIGHT)),
        (x + 1 < width).then(|| (p + 1, p, RIGHT)),
        (y > 0).then(|| (p - width, p - width, DOWN)),
        (y + 1 < height).then(|| (p + width, p, DOWN)),
    ];
    sides.into_iter().flatten().filter_map(move |(q, owner, bit)| {
        let near = |layer: &SceneLayer| (layer.s[q] - s).abs() < CONNECTED_PX;
        let connected_steeply = || {
            // Connectivity describes unmixed pixels, and only pixels away from edges are certain to be unmixed.
            !own.connectivity.is_empty()
                && own.connectivity[owner] & bit != 0
                && (own.connectivity[p] | own.connectivity[q]) & EDGE == 0
                && !own.s[q].is_nan()
        };
        if near(own) || connected_steeply() {
            return Some(Cell { layer: cell.layer, index: q });
        }
        let others = layers.iter().enumerate().filter(|(i, _)| *i != cell.layer);
        others
            .filter(|(_, layer)| layer.role == own.role && near(layer))
            .map(|(i, _)| Cell { layer: i, index: q })
            .next()
    })
}

/// A row of a plane with the rows above and below it. At the border of the frame, the row itself stands in for them.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    pub above: &'a [f32],
    pub row: &'a [f32],
    pub below: &'a [f32],
}

impl<'a> Rows<'a> {
    /// Row `y` of a plane.
    pub fn new(plane: &'a [f32], size: Size, y: usize) -> Rows<'a> {
        let at = |y: usize| &plane[y * size.width..][..size.width];
        Rows { above: at(y.saturating_sub(1)), row: at(y), below: at((y + 1).min(size.height - 1)) }
    }

    /// The cells of a chunk that have a left and a right neighbour.
    #[inline(always)]
    pub fn inner(&self, chunk: &Range<usize>) -> Range<usize> {
        let first = chunk.start.max(1);
        first..chunk.end.min(self.row.len() - 1).max(first)
    }

    /// These cells, and their neighbours to the left, to the right, above and below.
    #[inline(always)]
    pub fn cross(&self, inner: &Range<usize>) -> (&'a [f32], [&'a [f32]; 4]) {
        let (n, at) = (inner.len(), inner.start);
        if n == 0 {
            return (&[], [&[]; 4]);
        }
        let around = [&self.row[at - 1..], &self.row[at + 1..], &self.above[at..], &self.below[at..]];
        (&self.row[at..][..n], around.map(|row| &row[..n]))
    }

    /// Which cells of a chunk have all four neighbours in their own layer and at nearly their own depth. Nearly all
    /// cells do.
    #[inline(always)]
    pub fn plain(&self, chunk: &Range<usize>) -> [bool; CHUNK] {
        let mut plain = [false; CHUNK];
        let inner = self.inner(chunk);
        let (own, around) = self.cross(&inner);
        let plain_inner = &mut plain[inner.start - chunk.start..][..own.len()];
        for x in 0..own.len() {
            plain_inner[x] = around.iter().fold(true, |all, q| all & ((q[x] - own[x]).abs() < CONNECTED_PX));
        }
        plain
    }

    /// Whether a chunk has no cell at all.
    #[inline(always)]
    pub fn is_empty(&self, chunk: &Range<usize>) -> bool {
        self.row[chunk.clone()].iter().fold(true, |empty, s| empty & s.is_nan())
    }
}

/// The chunks of a range of columns.
pub fn chunks(stretch: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = stretch.end;
    stretch.step_by(CHUNK).map(move |x| x..(x + CHUNK).min(end))
}

/// The depth spans of one layer's cells. Both codes are 0 where there is no cell.
pub struct DepthSpans {
    pub lo: Buffer<u16>,
    pub hi: Buffer<u16>,
}

impl DepthSpans {
    pub fn new(
        layers: &[SceneLayer],
        size: Size,
        layer: usize,
        codes: &DepthCodes,
        simd: Simd,
    ) -> DepthSpans {
        let (mut lo, mut hi) = (Buffer::unset(size.pixels()), Buffer::unset(size.pixels()));
        let rows = lo.par_chunks_mut(size.width).zip(hi.par_chunks_mut(size.width));
        rows.enumerate().for_each(|(y, (lo, hi))| {
            let rows = Rows::new(&layers[layer].s, size, y);
            for chunk in chunks(0..size.width) {
                let Some(plain) = simd.run(
                    #[inline(always)]
                    || plain_depths(&rows, &chunk, codes, lo, hi),
                ) else {
                    lo[chunk.clone()].fill(0);
                    hi[chunk].fill(0);
                    continue;
                };
                for x in chunk.clone().filter(|x| !plain[x - chunk.start]) {
                    let cell = Cell { layer, index: y * size.width + x };
                    (lo[x], hi[x]) = depth_of(layers, size, cell, codes);
                }
            }
        });
        DepthSpans { lo, hi }
    }
}

/// Writes the depth spans of the plain cells of a chunk and returns which cells these are; `None` if the chunk is
/// empty.
#[inline(always)]
fn plain_depths(
    rows: &Rows,
    chunk: &Range<usize>,
    codes: &DepthCodes,
    lo: &mut [u16],
    hi: &mut [u16],
) -> Option<[bool; CHUNK]> {
    if rows.is_empty(chunk) {
        return None;
    }
    let inner = rows.inner(chunk);
    let (own, around) = rows.cross(&inner);
    let (lo, hi) = (&mut lo[inner.clone()][..own.len()], &mut hi[inner][..own.len()]);
    for x in 0..own.len() {
        let s = own[x];
        let min = around.iter().fold(s, |m, q| if q[x] < m { q[x] } else { m });
        let max = around.iter().fold(s, |m, q| if q[x] > m { q[x] } else { m });
        lo[x] = codes.encode(0.5 * (s + min));
        hi[x] = codes.encode(0.5 * (s + max));
    }
    Some(rows.plain(chunk))
}

/// The depth span of any cell.
fn depth_of(layers: &[SceneLayer], size: Size, cell: Cell, codes: &DepthCodes) -> (u16, u16) {
    let s = layers[cell.layer].s[cell.index];
    if s.is_nan() {
        return (0, 0);
    }
    let (mut nearest, mut farthest) = (s, s);
    for q in neighbours(layers, size, cell) {
        let half_way = 0.5 * (s + layers[q.layer].s[q.index]);
        farthest = farthest.min(half_way);
        nearest = nearest.max(half_way);
    }
    (codes.encode(farthest), codes.encode(nearest))
}
