//! Bounds of depth in blocks of pixels: the coarse level of the min/max depth hierarchy (Hi-Z) with which rays are
//! culled. The fine level is in `cpu/lens/culling.rs`.

use super::depth_codes::DepthCodes;
use super::depth_spans::DepthSpans;
use super::edges::EDGE;
use super::grid::BLOCK;
use super::layer::SceneLayer;
use crate::picture::Size;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// A set of depths: one bit for each value of a code's high byte.
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

/// Adds the depths of `bits`.
pub fn unite(into: &mut DepthBits, bits: &DepthBits) {
    into.iter_mut().zip(bits).for_each(|(into, bits)| *into |= bits);
}

/// The blocks of a frame; a row has `across` of them.
pub struct DepthBounds {
    pub across: usize,
    pub down: usize,
    /// Number of layers.
    pub layers: usize,
    /// For each block, then each layer: the set of depths that occur.
    pub occupied: Vec<DepthBits>,
    /// For each block: least and greatest code over all layers.
    pub range: Vec<(u16, u16)>,
    /// For each block: how steep it is, in codes a pixel, if the block is one closed surface in the picture's first layer.
    pub smooth: Vec<Option<u16>>,
}

/// The depths of the cells of one layer in one block.
struct Summary {
    /// Least and greatest code.
    range: (u16, u16),
    /// Whether every pixel has a cell.
    whole: bool,
}

/// Adds a run of cells to a summary.
#[inline(always)]
fn summarize(lo: &[u16], hi: &[u16], summary: &mut Summary) {
    let (mut least, mut greatest, mut whole) = (summary.range.0, summary.range.1, summary.whole);
    for (&lo, &hi) in lo.iter().zip(hi) {
        // The code of an empty cell is 0. Subtracting 1 makes it the greatest of all, so that it does not count.
        least = least.min(lo.wrapping_sub(1));
        greatest = greatest.max(hi);
        whole &= hi > 0;
    }
    *summary = Summary { range: (least, greatest), whole };
}

/// How steep a whole block is that begins at `first` of a frame with rows of `stride`: the greatest slope of its quarters,
/// in codes a pixel.
///
/// A slope is what the means of the two halves of a quarter differ by. The noise of one pixel hardly changes it: noise is
/// not geometry.
#[inline(always)]
fn steepness(spans: &DepthSpans, first: usize, stride: usize, (columns, rows): (usize, usize)) -> u16 {
    const QUARTER: usize = BLOCK / 2;
    let mut steepest = 0.0f32;
    for top in (0..rows).step_by(QUARTER) {
        for left in (0..columns).step_by(QUARTER) {
            let (wide, high) = (QUARTER.min(columns - left), QUARTER.min(rows - top));
            let sum = |x: usize, y: usize, (wide, high): (usize, usize)| -> u32 {
                let rows = (top + y..top + y + high).map(|y| first + y * stride + left + x);
                let row = |at: usize| spans.lo[at..at + wide].iter().chain(&spans.hi[at..at + wide]);
                rows.flat_map(row).map(|&code| u32::from(code)).sum()
            };
            // Sums of two codes a pixel, over halves whose middles are as far apart as the greater part of the quarter.
            let slope = |first: u32, last: u32, pixels: usize, apart: usize| {
                last.abs_diff(first) as f32 / (2 * pixels.max(1) * apart) as f32
            };
            let half = (wide / 2, high);
            let across = slope(sum(0, 0, half), sum(wide - half.0, 0, half), half.0 * high, wide - half.0);
            let half = (wide, high / 2);
            let down = slope(sum(0, 0, half), sum(0, high - half.1, half), wide * half.1, high - half.1);
            steepest = steepest.max(across).max(down);
        }
    }
    steepest.ceil() as u16
}

impl DepthBounds {
    /// The blocks of the unpadded frame; `front` is the number of the picture's first layer, and that layer.
    pub fn new(
        size: Size,
        depths: &[DepthSpans],
        codes: &DepthCodes,
        (first_layer, front): (usize, &SceneLayer),
        simd: Simd,
    ) -> DepthBounds {
        let codes_per_px = (1.0 / codes.step()) as u16;
        let (across, down) = (size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
        let block = |b: usize| {
            let (x0, y0) = (b % across * BLOCK, b / across * BLOCK);
            let n = BLOCK.min(size.width - x0);
            let rows = || (y0..(y0 + BLOCK).min(size.height)).map(|y| y * size.width + x0);
            let (mut range, mut smooth) = ((u16::MAX, 0u16), !front.connectivity.is_empty());
            let mut occupied = vec![[0u64; 4]; depths.len()];
            for (k, depths) in depths.iter().enumerate() {
                let mut own = Summary { range: (u16::MAX, 0), whole: true };
                simd.run(
                    #[inline(always)]
                    || {
                        for at in rows() {
                            summarize(&depths.lo[at..at + n], &depths.hi[at..at + n], &mut own);
                        }
                    },
                );
                // A smooth block has a cell at every pixel of the first layer and no cell in the others.
                smooth &= if k == first_layer { own.whole } else { own.range.1 == 0 };
                if own.range.1 == 0 {
                    continue;
                }
                let (lo, hi) = (own.range.0 + 1, own.range.1);
                range = (range.0.min(lo), range.1.max(hi));
                let mut set = |lo: u16, hi: u16| {
                    for bin in lo >> 8..=hi >> 8 {
                        occupied[k][usize::from(bin >> 6)] |= 1 << (bin & 63);
                    }
                };
                // If the extremes lie in two neighbouring bins, both bins are in use. If all bins together span less
                // than a pixel, telling them apart would not avoid a single look-up.
                if (hi >> 8) - (lo >> 8) <= 1 || hi - lo < codes_per_px {
                    set(lo, hi);
                } else {
                    for i in rows().flat_map(|at| at..at + n).filter(|&i| depths.hi[i] > 0) {
                        set(depths.lo[i], depths.hi[i]);
                    }
                }
            }
            // All of it is opaque, and one surface.
            let has_edge =
                |at: usize| front.connectivity[at..at + n].iter().fold(0, |all, l| all | l) & EDGE != 0;
            smooth = smooth && rows().all(|at| !has_edge(at) && !front.covers_partly_any(at..at + n));
            let (first, extent) = (y0 * size.width + x0, (n, rows().len()));
            let smooth = smooth.then(|| {
                simd.run(
                    #[inline(always)]
                    || steepness(&depths[first_layer], first, size.width, extent),
                )
            });
            (occupied, range, smooth)
        };
        let all: Vec<_> = (0..across * down).into_par_iter().map(block).collect();
        DepthBounds {
            across,
            down,
            layers: depths.len(),
            occupied: all.iter().flat_map(|b| b.0.iter().copied()).collect(),
            range: all.iter().map(|b| b.1).collect(),
            smooth: all.iter().map(|b| b.2).collect(),
        }
    }

    /// The blocks of some rows of the frame, which begin with a block.
    pub fn rows(&self, rows: Range<usize>) -> DepthBounds {
        let (first, end) = (rows.start / BLOCK, rows.end.div_ceil(BLOCK));
        let blocks = first * self.across..end * self.across;
        DepthBounds {
            across: self.across,
            down: end - first,
            layers: self.layers,
            occupied: self.occupied[blocks.start * self.layers..blocks.end * self.layers].to_vec(),
            range: self.range[blocks.clone()].to_vec(),
            smooth: self.smooth[blocks].to_vec(),
        }
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
