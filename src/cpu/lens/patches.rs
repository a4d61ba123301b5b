//! Which depths occur where, by small patches of cells, so that the sweep only looks where something is.

use super::blocks::{DepthBits, any_bin, unite};
use super::cells::Codes;
use super::lanes::LANES;
use super::pack::{Padding, Present};
use crate::cpu::simd::Simd;
use rayon::prelude::*;

/// Columns and rows of a patch.
const PATCH: (usize, usize) = (8, 4);
/// Columns and rows of the part of a tile that is swept with one choice of looks.
pub const PART: (usize, usize) = (LANES, 8);

/// For each patch of a padded sheet, the depths that occur in a part that begins anywhere in it.
pub struct Patches {
    across: usize,
    bits: Vec<DepthBits>,
}

/// Least and greatest code of a patch's cells; the least is beyond all where it has none.
#[inline(always)]
fn range(lo: &[u16], hi: &[u16], stride: usize) -> (u16, u16) {
    let (mut least, mut greatest) = ([u16::MAX; PATCH.0], [0; PATCH.0]);
    for row in 0..PATCH.1 {
        let (lo, hi) = (&lo[row * stride..][..PATCH.0], &hi[row * stride..][..PATCH.0]);
        for x in 0..PATCH.0 {
            // An empty cell's code of 0 becomes the greatest of all.
            least[x] = least[x].min(lo[x].wrapping_sub(1));
            greatest[x] = greatest[x].max(hi[x]);
        }
    }
    let least = least.iter().fold(u16::MAX, |m, &v| m.min(v));
    (least.saturating_add(1), greatest.iter().fold(0, |m, &v| m.max(v)))
}

/// Sets the bins of the codes from `lo` to `hi`.
fn set(bits: &mut DepthBits, lo: u16, hi: u16) {
    for bin in lo >> 8..=hi >> 8 {
        bits[usize::from(bin >> 6)] |= 1 << (bin & 63);
    }
}

/// The depths that occur in the patch at the beginning of `lo` and `hi`.
fn depths(lo: &[u16], hi: &[u16], stride: usize, codes_per_px: u16, simd: Simd) -> DepthBits {
    let mut bits = [0; 4];
    let (least, greatest) = simd.run(
        #[inline(always)]
        || range(lo, hi, stride),
    );
    if greatest == 0 {
        return bits;
    }
    // Where all lies within a pixel, knowing the bins one by one would hardly save a look.
    if (greatest >> 8) - (least >> 8) <= 1 || greatest - least < codes_per_px {
        set(&mut bits, least, greatest);
        return bits;
    }
    for at in (0..PATCH.1).map(|row| row * stride) {
        for x in (at..at + PATCH.0).filter(|&x| hi[x] > 0) {
            set(&mut bits, lo[x], hi[x]);
        }
    }
    bits
}

impl Patches {
    /// Those of a sheet's padded depths.
    pub fn new(
        lo: &[u16],
        hi: &[u16],
        padding: &Padding,
        present: &Present,
        codes: &Codes,
        simd: Simd,
    ) -> Patches {
        let (stride, across) = (padding.stride, padding.stride / PATCH.0);
        let down = padding.rows / PATCH.1;
        let codes_per_px = (1.0 / codes.step()) as u16;
        // A part that does not begin with a patch touches one more.
        let (wide, high) = (PART.0 / PATCH.0 + 1, PART.1 / PATCH.1 + 1);

        let mut along = vec![[0; 4]; across * down];
        along.par_chunks_mut(across).enumerate().for_each_init(
            || vec![[0; 4]; across + wide],
            |own, (y, out)| {
                own.fill([0; 4]);
                for stretch in present.stretches(y * PATCH.1) {
                    for at in stretch.step_by(PATCH.0) {
                        let first = y * PATCH.1 * stride + at;
                        own[at / PATCH.0] = depths(&lo[first..], &hi[first..], stride, codes_per_px, simd);
                    }
                }
                for (x, out) in out.iter_mut().enumerate() {
                    own[x..x + wide].iter().for_each(|bits| unite(out, bits));
                }
            },
        );
        let mut bits = vec![[0; 4]; across * down];
        bits.par_chunks_mut(across).enumerate().for_each(|(y, out)| {
            for row in y..(y + high).min(down) {
                out.iter_mut().zip(&along[row * across..]).for_each(|(out, bits)| unite(out, bits));
            }
        });
        Patches { across, bits }
    }

    /// Whether a part whose first cell is `(x, y)` may hold a cell that reaches into the codes `from .. to`.
    #[inline(always)]
    pub fn may_hold(&self, (x, y): (usize, usize), from: u16, to: u16) -> bool {
        let bits = &self.bits[y / PATCH.1 * self.across + x / PATCH.0];
        any_bin(bits, usize::from(from >> 8), usize::from((to - 1) >> 8))
    }
}
