//! What the cells of each block of pixels are, for planning.

use super::cells::{Codes, Depths};
use super::pack::{Padding, TILE};
use super::surfaces::EDGE;
use crate::cpu::simd::Simd;
use crate::picture::Size;
use rayon::prelude::*;
use std::ops::Range;

/// Side of a block.
pub const BLOCK: usize = 16;

/// A set of depths, one bit for each high byte of their codes.
pub type DepthBits = [u64; 4];

/// Whether any of the bins `from ..= to` is set.
#[inline(always)]
pub fn any_bin(bits: &DepthBits, from: usize, to: usize) -> bool {
    let (first, last) = (from / 64, to / 64);
    let (above, below) = (u64::MAX << (from % 64), u64::MAX >> (63 - to % 64));
    if first == last {
        return bits[first] & above & below != 0;
    }
    bits[first] & above != 0 || bits[last] & below != 0 || bits[first + 1..last].iter().any(|&b| b != 0)
}

fn unite(into: &mut DepthBits, bits: &DepthBits) {
    into.iter_mut().zip(bits).for_each(|(into, bits)| *into |= bits);
}

/// The blocks of a frame, in rows of `across`.
pub struct Blocks {
    pub across: usize,
    pub down: usize,
    /// How many sheets there are.
    pub sheets: usize,
    /// For each block, then each sheet: the depths that occur.
    pub occupied: Vec<DepthBits>,
    /// For each block: least and greatest code over all sheets.
    pub range: Vec<(u16, u16)>,
    /// For each block: the steepest cell, in codes, where all is one closed surface in the first sheet.
    pub smooth: Vec<Option<u16>>,
}

/// What the cells of one sheet in one block are.
struct Summary {
    /// Least and greatest code.
    range: (u16, u16),
    steepest: u16,
    /// Whether every pixel has a cell.
    whole: bool,
}

/// One pass over a stretch of cells.
#[inline(always)]
fn summarize(lo: &[u16], hi: &[u16], summary: &mut Summary) {
    let (mut least, mut greatest, mut steepest, mut whole) =
        (summary.range.0, summary.range.1, summary.steepest, summary.whole);
    for (&lo, &hi) in lo.iter().zip(hi) {
        // An empty cell's code of 0 becomes the greatest of all, and does not count.
        least = least.min(lo.wrapping_sub(1));
        greatest = greatest.max(hi);
        steepest = steepest.max(hi - lo);
        whole &= hi > 0;
    }
    *summary = Summary { range: (least, greatest), steepest, whole };
}

impl Blocks {
    /// The blocks of the unpadded frame. `links` are those of the first sheet, if it has any.
    pub fn new(size: Size, depths: &[Depths], codes: &Codes, links: &[u8], simd: Simd) -> Blocks {
        let codes_per_px = (1.0 / codes.step()) as u16;
        let (across, down) = (size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
        let block = |b: usize| {
            let (x0, y0) = (b % across * BLOCK, b / across * BLOCK);
            let n = BLOCK.min(size.width - x0);
            let rows = || (y0..(y0 + BLOCK).min(size.height)).map(|y| y * size.width + x0);
            let (mut range, mut smooth) = ((u16::MAX, 0u16), !links.is_empty());
            let mut occupied = vec![[0u64; 4]; depths.len()];
            let mut steepest = 0;
            for (k, depths) in depths.iter().enumerate() {
                let mut own = Summary { range: (u16::MAX, 0), steepest: 0, whole: true };
                simd.run(
                    #[inline(always)]
                    || {
                        for at in rows() {
                            summarize(&depths.lo[at..at + n], &depths.hi[at..at + n], &mut own);
                        }
                    },
                );
                // The first sheet has to be whole for a smooth block, the others empty.
                smooth &= if k == 0 { own.whole } else { own.range.1 == 0 };
                if own.range.1 == 0 {
                    continue;
                }
                steepest = steepest.max(own.steepest);
                let (lo, hi) = (own.range.0 + 1, own.range.1);
                range = (range.0.min(lo), range.1.max(hi));
                let mut set = |lo: u16, hi: u16| {
                    for bin in lo >> 8..=hi >> 8 {
                        occupied[k][usize::from(bin >> 6)] |= 1 << (bin & 63);
                    }
                };
                // Two neighbouring bins are both in use when the extremes lie in them; and where all bins span less
                // than a pixel, knowing them one by one would not save a single look.
                if (hi >> 8) - (lo >> 8) <= 1 || hi - lo < codes_per_px {
                    set(lo, hi);
                } else {
                    for i in rows().flat_map(|at| at..at + n).filter(|&i| depths.hi[i] > 0) {
                        set(depths.lo[i], depths.hi[i]);
                    }
                }
            }
            smooth =
                smooth && rows().all(|at| links[at..at + n].iter().fold(0, |all, l| all | l) & EDGE == 0);
            (occupied, range, smooth.then_some(steepest))
        };
        let all: Vec<_> = (0..across * down).into_par_iter().map(block).collect();
        Blocks {
            across,
            down,
            sheets: depths.len(),
            occupied: all.iter().flat_map(|b| b.0.iter().copied()).collect(),
            range: all.iter().map(|b| b.1).collect(),
            smooth: all.iter().map(|b| b.2).collect(),
        }
    }

    /// The blocks of some rows of the frame, which begin with a block.
    pub fn rows(&self, rows: Range<usize>) -> Blocks {
        let (first, end) = (rows.start / BLOCK, rows.end.div_ceil(BLOCK));
        let blocks = first * self.across..end * self.across;
        Blocks {
            across: self.across,
            down: end - first,
            sheets: self.sheets,
            occupied: self.occupied[blocks.start * self.sheets..blocks.end * self.sheets].to_vec(),
            range: self.range[blocks.clone()].to_vec(),
            smooth: self.smooth[blocks].to_vec(),
        }
    }

    /// The blocks of the padded frame, each the union of those that it shows something of.
    pub fn padded(&self, padding: &Padding) -> Blocks {
        let shown = |n: usize, place: &dyn Fn(usize) -> usize| -> Vec<(usize, usize)> {
            let block = |b: usize| {
                let at = (b * BLOCK..(b + 1) * BLOCK).map(|i| place(i) / BLOCK);
                at.fold((usize::MAX, 0), |(lo, hi), b| (lo.min(b), hi.max(b)))
            };
            (0..n / BLOCK).map(block).collect()
        };
        let columns = shown(padding.stride, &|px| padding.column(px).0);
        let rows = shown(padding.rows, &|py| padding.row(py).0);
        let (across, down) = (columns.len(), rows.len());
        let mut padded = Blocks {
            across,
            down,
            sheets: self.sheets,
            occupied: vec![[0; 4]; across * down * self.sheets],
            range: vec![(u16::MAX, 0); across * down],
            smooth: vec![Some(0); across * down],
        };
        for (i, (rows, columns)) in
            rows.iter().flat_map(|rows| columns.iter().map(move |columns| (rows, columns))).enumerate()
        {
            for b in (rows.0..=rows.1).flat_map(|y| (columns.0..=columns.1).map(move |x| y * self.across + x))
            {
                for k in 0..self.sheets {
                    unite(&mut padded.occupied[i * self.sheets + k], &self.occupied[b * self.sheets + k]);
                }
                padded.range[i] =
                    (padded.range[i].0.min(self.range[b].0), padded.range[i].1.max(self.range[b].1));
                padded.smooth[i] = padded.smooth[i].zip(self.smooth[b]).map(|(a, b)| a.max(b));
            }
        }
        padded
    }

    /// For each block, then each sheet: the depths that occur in a tile anywhere within whose first pixel lies in
    /// the block.
    pub fn windows(&self) -> Vec<DepthBits> {
        // A tile that does not begin with a block touches one more.
        let (wide, high) = (TILE.0 / BLOCK + 1, TILE.1 / BLOCK + 1);
        let row = self.across * self.sheets;
        let along = |source: &[DepthBits], at: usize, step: usize, n: usize| {
            let mut bits = [0; 4];
            (0..n).for_each(|i| unite(&mut bits, &source[at + i * step]));
            bits
        };
        let wide = |at: usize| {
            let x = at % row / self.sheets;
            along(&self.occupied, at, self.sheets, wide.min(self.across - x))
        };
        let across: Vec<DepthBits> = (0..self.occupied.len()).map(wide).collect();
        (0..across.len()).map(|at| along(&across, at, row, high.min(self.down - at / row))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_are_found_in_their_range_only() {
        let mut bits = [0u64; 4];
        bits[1] |= 1 << 3;
        assert!(any_bin(&bits, 67, 67) && any_bin(&bits, 0, 255) && any_bin(&bits, 60, 70));
        assert!(!any_bin(&bits, 0, 66) && !any_bin(&bits, 68, 255));
    }
}
