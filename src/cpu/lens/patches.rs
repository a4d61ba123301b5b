//! Which depths occur where, by small patches of cells, so that the sweep only looks where something is.

use super::lanes::LANES;
use super::pack::{PackedSheet, Padding};
use crate::cpu::simd::Simd;
use rayon::prelude::*;

/// Columns and rows of a patch.
const PATCH: (usize, usize) = (8, 4);
/// Columns and rows of the part of a tile that is swept with one choice of looks. Parts begin with a patch.
pub const PART: (usize, usize) = (LANES, 8);
/// Codes are told apart by their highest six bits.
const SHIFT: u32 = 10;

/// For each patch of the padded frame, then each sheet: the depths that occur in a part that begins anywhere in the
/// patch.
pub struct Patches {
    across: usize,
    sheets: usize,
    bits: Vec<u64>,
}

/// What a look needs of the part that it is for.
#[derive(Debug, Clone, Copy)]
pub struct Need {
    /// From the part's own entry to that of the patch and sheet that are looked at.
    entry: i32,
    /// The depths, one of which has to occur.
    depths: u64,
}

/// The bits of the codes `first ..= last`.
#[inline(always)]
fn bits(first: u16, last: u16) -> u64 {
    (u64::MAX << (first >> SHIFT)) & (u64::MAX >> (63 - (last >> SHIFT)))
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

/// The depths that occur in the patch at the beginning of `lo` and `hi`.
#[inline(always)]
fn depths(lo: &[u16], hi: &[u16], stride: usize) -> u64 {
    let (least, greatest) = range(lo, hi, stride);
    if greatest == 0 {
        return 0;
    }
    if (greatest >> SHIFT) - (least >> SHIFT) <= 1 {
        return bits(least, greatest);
    }
    let rows = (0..PATCH.1).flat_map(|row| row * stride..row * stride + PATCH.0);
    rows.filter(|&i| hi[i] > 0).fold(0, |all, i| all | bits(lo[i], hi[i]))
}

impl Patches {
    /// Those of all sheets.
    pub fn new(packed: &[PackedSheet], padding: &Padding, simd: Simd) -> Patches {
        let (stride, sheets) = (padding.stride, packed.len());
        let (across, down) = (stride / PATCH.0, padding.rows / PATCH.1);
        // A part that does not begin with a patch touches one more.
        let (wide, high) = (PART.0 / PATCH.0 + 1, PART.1 / PATCH.1 + 1);
        let row = across * sheets;

        let mut along = vec![0; row * down];
        along.par_chunks_mut(row).enumerate().for_each_init(
            || vec![0; row + wide * sheets],
            |own, (y, out)| {
                own.fill(0);
                for (k, sheet) in packed.iter().enumerate() {
                    for stretch in sheet.stretches(y * PATCH.1) {
                        let first = y * PATCH.1 * stride + stretch.start;
                        let (lo, hi) = (&sheet.lo[first..], &sheet.hi[first..]);
                        let own = &mut own[stretch.start / PATCH.0 * sheets + k..];
                        simd.run(
                            #[inline(always)]
                            || {
                                for i in 0..stretch.len() / PATCH.0 {
                                    let at = i * PATCH.0;
                                    own[i * sheets] = depths(&lo[at..], &hi[at..], stride);
                                }
                            },
                        );
                    }
                }
                for (i, out) in out.iter_mut().enumerate() {
                    *out = (0..wide).fold(0, |all, k| all | own[i + k * sheets]);
                }
            },
        );
        let mut bits = vec![0; row * down];
        bits.par_chunks_mut(row).enumerate().for_each(|(y, out)| {
            for y in y..(y + high).min(down) {
                out.iter_mut().zip(&along[y * row..]).for_each(|(out, along)| *out |= along);
            }
        });
        Patches { across, sheets, bits }
    }

    /// The entry of the part whose first cell is `(x, y)` of the padded frame.
    pub fn entry(&self, (x, y): (usize, usize)) -> usize {
        (y / PATCH.1 * self.across + x / PATCH.0) * self.sheets
    }

    /// What looking at the codes `from .. to` of a sheet needs, for the cells that lie `cell` away.
    pub fn need(&self, cell: [i32; 2], sheet: usize, from: u16, to: u16) -> Need {
        let [x, y] = [cell[0].div_euclid(PATCH.0 as i32), cell[1].div_euclid(PATCH.1 as i32)];
        let entry = (y * self.across as i32 + x) * self.sheets as i32 + sheet as i32;
        Need { entry, depths: bits(from, to - 1) }
    }

    /// Whether the part of an entry may have what is needed.
    #[inline(always)]
    pub fn may_have(&self, entry: usize, need: &Need) -> bool {
        self.bits[entry.wrapping_add_signed(need.entry as isize)] & need.depths != 0
    }
}
