//! The depths that cells span, as 16-bit codes.
//!
//! A cell is a column of depths from `lo` to `hi`: a surface stays closed when every cell reaches half-way to its
//! neighbours.

use super::sheets::Sheet;
use super::surfaces::{CONNECTED_PX, DOWN, EDGE, RIGHT};
use crate::cpu::simd::Simd;
use crate::memory::Buffer;
use crate::picture::{Size, range};
use rayon::prelude::*;
use std::ops::Range;

/// Cells of a row that are looked at together.
pub const CHUNK: usize = 64;

/// Shifts as codes: `s = s_min + (code - 1) * step`. Code 0 is never a depth.
#[derive(Debug, Clone, Copy)]
pub struct Codes {
    pub s_min: f64,
    step: f64,
    /// Codes are made in single precision, which is enough: 24 bits for 16.
    least: f32,
    per_px: f32,
}

impl Codes {
    pub const MAX: u16 = u16::MAX - 1;

    pub fn new((s_min, s_max): (f64, f64)) -> Codes {
        let step = ((s_max - s_min) / f64::from(Codes::MAX - 1)).max(1e-9);
        Codes { s_min, step, least: s_min as f32, per_px: (1.0 / step) as f32 }
    }

    #[inline(always)]
    pub fn encode(&self, s: f32) -> u16 {
        // Adding 2^23 rounds to an integer, which is then what the lowest bits hold.
        const TWO_TO_23: f32 = 8_388_608.0;
        let code = (s - self.least) * self.per_px;
        let code = if code > 0.0 { code } else { 0.0 };
        let code = if code < f32::from(Codes::MAX - 1) { code } else { f32::from(Codes::MAX - 1) };
        (code + TWO_TO_23).to_bits() as u16 + 1
    }

    /// The shift that a code, or a place between codes, stands for.
    pub fn decode(&self, code: f64) -> f64 {
        self.s_min + (code - 1.0) * self.step
    }

    /// Where a shift lies between codes; undoes [`Codes::decode`].
    pub fn place(&self, s: f64) -> f64 {
        (s - self.s_min) / self.step + 1.0
    }

    pub fn step(&self) -> f64 {
        self.step
    }
}

/// Least and greatest shift of all cells.
pub fn shift_range(sheets: &[Sheet]) -> (f64, f64) {
    let ranges = sheets.iter().map(|sheet| range(&sheet.s));
    let [min, max] = ranges.fold(range(&[]), |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
    if min <= max { (f64::from(min), f64::from(max)) } else { (0.0, 0.0) }
}

/// A cell's place in the sheets: sheet and pixel.
#[derive(Clone, Copy)]
pub struct Cell {
    pub sheet: usize,
    pub index: usize,
}

/// The cells that continue the surface of `cell` at the four neighbours.
pub fn neighbours(sheets: &[Sheet], size: Size, cell: Cell) -> impl Iterator<Item = Cell> + '_ {
    let (width, height) = (size.width, size.height);
    let (x, y, p) = (cell.index % width, cell.index / width, cell.index);
    let own = &sheets[cell.sheet];
    let s = own.s[p];
    // The pixel that owns the link to the neighbour, and its bit.
    let sides = [
        (x > 0).then(|| (p - 1, p - 1, RIGHT)),
        (x + 1 < width).then(|| (p + 1, p, RIGHT)),
        (y > 0).then(|| (p - width, p - width, DOWN)),
        (y + 1 < height).then(|| (p + width, p, DOWN)),
    ];
    sides.into_iter().flatten().filter_map(move |(q, owner, bit)| {
        let near = |sheet: &Sheet| (sheet.s[q] - s).abs() < CONNECTED_PX;
        let linked = || {
            // Links speak of plain pixels, and only those away from edges are sure to be plain.
            !own.links.is_empty()
                && own.links[owner] & bit != 0
                && (own.links[p] | own.links[q]) & EDGE == 0
                && !own.s[q].is_nan()
        };
        if near(own) || linked() {
            return Some(Cell { sheet: cell.sheet, index: q });
        }
        let others = sheets.iter().enumerate().filter(|(i, _)| *i != cell.sheet);
        others.filter(|(_, sheet)| near(sheet)).map(|(i, _)| Cell { sheet: i, index: q }).next()
    })
}

/// A row of a plane between those above and below it, which at the border of the frame are the row itself.
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

    /// These cells and their neighbours to the left, to the right, above and below.
    #[inline(always)]
    pub fn cross(&self, inner: &Range<usize>) -> (&'a [f32], [&'a [f32]; 4]) {
        let (n, at) = (inner.len(), inner.start);
        if n == 0 {
            return (&[], [&[]; 4]);
        }
        let around = [&self.row[at - 1..], &self.row[at + 1..], &self.above[at..], &self.below[at..]];
        (&self.row[at..][..n], around.map(|row| &row[..n]))
    }

    /// Which cells of a chunk have all four neighbours in their own sheet and close by, as nearly all have.
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

/// The chunks of a stretch of a row.
pub fn chunks(stretch: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = stretch.end;
    stretch.step_by(CHUNK).map(move |x| x..(x + CHUNK).min(end))
}

/// The depths of one sheet's cells; both codes are 0 where there is none.
pub struct Depths {
    pub lo: Buffer<u16>,
    pub hi: Buffer<u16>,
}

impl Depths {
    pub fn new(sheets: &[Sheet], size: Size, sheet: usize, codes: &Codes, simd: Simd) -> Depths {
        let (mut lo, mut hi) = (Buffer::unset(size.pixels()), Buffer::unset(size.pixels()));
        let rows = lo.par_chunks_mut(size.width).zip(hi.par_chunks_mut(size.width));
        rows.enumerate().for_each(|(y, (lo, hi))| {
            let rows = Rows::new(&sheets[sheet].s, size, y);
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
                    let cell = Cell { sheet, index: y * size.width + x };
                    (lo[x], hi[x]) = depth_of(sheets, size, cell, codes);
                }
            }
        });
        Depths { lo, hi }
    }
}

/// The depths of the plain cells of a chunk, and which these are; `None` where the chunk is empty.
#[inline(always)]
fn plain_depths(
    rows: &Rows,
    chunk: &Range<usize>,
    codes: &Codes,
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

/// The depths of any cell.
fn depth_of(sheets: &[Sheet], size: Size, cell: Cell, codes: &Codes) -> (u16, u16) {
    let s = sheets[cell.sheet].s[cell.index];
    if s.is_nan() {
        return (0, 0);
    }
    let (mut nearest, mut farthest) = (s, s);
    for q in neighbours(sheets, size, cell) {
        let half_way = 0.5 * (s + sheets[q.sheet].s[q.index]);
        farthest = farthest.min(half_way);
        nearest = nearest.max(half_way);
    }
    (codes.encode(farthest), codes.encode(nearest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_keep_depth_to_a_thousandth_of_a_pixel() {
        let codes = Codes::new((-3.0, 57.0));
        for s in [-3.0f32, 0.0, 12.3456, 57.0] {
            assert!((codes.decode(f64::from(codes.encode(s))) - f64::from(s)).abs() < 1e-3);
        }
    }
}
