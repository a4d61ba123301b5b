//! Bounds of depth in small patches of cells: the fine level of the min/max depth hierarchy (Hi-Z). With them the
//! sweep skips segments of rays that meet no cell.

use super::padded_layer::PaddedLayer;
use crate::plan::lens::padding::Padding;
use crate::simd::Simd;
use rayon::prelude::*;

/// Columns and rows of a patch.
const PATCH: (usize, usize) = (8, 4);
/// Columns and rows of the part of a tile whose rays are culled together. Parts begin with a patch.
pub const PART: (usize, usize) = (32, 16);
/// Codes are distinguished by their highest six bits.
const SHIFT: u32 = 10;

/// Bounds for the cells of one layer in a region.
#[derive(Debug, Clone, Copy)]
struct Entry {
    /// The set of depths that occur, one bit for each value of the codes' highest bits.
    depths: u64,
    /// The least and the greatest code that occur.
    least_lo: u16,
    greatest_hi: u16,
    /// Every ray meets a cell in the codes above the greatest `lo` and up to the least `hi`. This range is empty if a
    /// cell is missing, or covers its pixel only partly.
    greatest_lo: u16,
    least_hi: u16,
}

impl Entry {
    /// A region without cells.
    const EMPTY: Entry =
        Entry { depths: 0, least_lo: u16::MAX, greatest_hi: 0, greatest_lo: u16::MAX, least_hi: 0 };
    /// An empty region: the neutral element of [`Entry::with`].
    const NOWHERE: Entry = Entry { greatest_lo: 0, least_hi: u16::MAX, ..Entry::EMPTY };

    #[inline(always)]
    fn with(self, other: &Entry) -> Entry {
        Entry {
            depths: self.depths | other.depths,
            least_lo: self.least_lo.min(other.least_lo),
            greatest_hi: self.greatest_hi.max(other.greatest_hi),
            greatest_lo: self.greatest_lo.max(other.greatest_lo),
            least_hi: self.least_hi.min(other.least_hi),
        }
    }
}

/// For each patch of the padded frame, then each layer: bounds for the cells of a part that begins anywhere in the
/// patch.
pub struct PatchBounds {
    across: usize,
    layers: usize,
    entries: Vec<Entry>,
}

/// A query to the bounds of a part: is there a cell in the codes `from .. to`?
#[derive(Debug, Clone, Copy)]
pub struct Query {
    /// Offset from the part's own entry to that of the patch and layer in question.
    entry: i32,
    from: u16,
    to: u16,
    /// The set of depths of which at least one must occur.
    depths: u64,
}

/// The answer to a [`Query`].
#[derive(Debug, Clone, Copy)]
pub struct Occupancy {
    /// Some rays may meet a cell.
    pub any: bool,
    /// Every ray meets a cell.
    pub all: bool,
}

/// The bits of the codes `first ..= last`.
#[inline(always)]
fn bits(first: u16, last: u16) -> u64 {
    (u64::MAX << (first >> SHIFT)) & (u64::MAX >> (63 - (last >> SHIFT)))
}

/// Least and greatest code of a patch's cells: of `lo`, then of `hi`. An empty cell raises the least `lo` above all
/// codes, and lowers the least `hi` to 0.
#[inline(always)]
fn ranges(lo: &[u16], hi: &[u16], stride: usize) -> [(u16, u16); 2] {
    let (mut least_lo, mut greatest_lo) = ([u16::MAX; PATCH.0], [0; PATCH.0]);
    let (mut least_hi, mut greatest_hi) = ([u16::MAX; PATCH.0], [0; PATCH.0]);
    for row in 0..PATCH.1 {
        let (lo, hi) = (&lo[row * stride..][..PATCH.0], &hi[row * stride..][..PATCH.0]);
        for x in 0..PATCH.0 {
            // The code of an empty cell is 0; subtracting 1 makes it the greatest of all.
            least_lo[x] = least_lo[x].min(lo[x].wrapping_sub(1));
            greatest_lo[x] = greatest_lo[x].max(lo[x]);
            least_hi[x] = least_hi[x].min(hi[x]);
            greatest_hi[x] = greatest_hi[x].max(hi[x]);
        }
    }
    let least = |of: [u16; PATCH.0]| of.iter().fold(u16::MAX, |m, &v| m.min(v));
    let greatest = |of: [u16; PATCH.0]| of.iter().fold(0, |m, &v| m.max(v));
    [(least(least_lo).saturating_add(1), greatest(greatest_lo)), (least(least_hi), greatest(greatest_hi))]
}

/// The entry of the patch at the beginning of `lo`, `hi` and `partial`; a row of `partial` is one byte.
#[inline(always)]
fn entry(lo: &[u16], hi: &[u16], partial: &[u8], stride: usize) -> Entry {
    let [(least_lo, greatest_lo), (least_hi, greatest_hi)] = ranges(lo, hi, stride);
    if greatest_hi == 0 {
        return Entry::EMPTY;
    }
    let depths = if (greatest_hi >> SHIFT) - (least_lo >> SHIFT) <= 1 {
        bits(least_lo, greatest_hi)
    } else {
        let rows = (0..PATCH.1).flat_map(|row| row * stride..row * stride + PATCH.0);
        rows.filter(|&i| hi[i] > 0).fold(0, |all, i| all | bits(lo[i], hi[i]))
    };
    let is_partial = (0..PATCH.1).fold(0, |any, row| any | partial[row * stride / PATCH.0]) != 0;
    let (greatest_lo, least_hi) = if is_partial { (u16::MAX, 0) } else { (greatest_lo, least_hi) };
    Entry { depths, least_lo, greatest_hi, greatest_lo, least_hi }
}

impl PatchBounds {
    /// The bounds of all layers.
    pub fn new(padded: &[PaddedLayer], padding: &Padding, simd: Simd) -> PatchBounds {
        let (stride, layers) = (padding.stride, padded.len());
        let (across, down) = (stride / PATCH.0, padding.rows / PATCH.1);
        // A part that does not begin with a patch overlaps one more patch.
        let (wide, high) = (PART.0 / PATCH.0 + 1, PART.1 / PATCH.1 + 1);
        let row = across * layers;

        let mut along = vec![Entry::EMPTY; row * down];
        along.par_chunks_mut(row).enumerate().for_each_init(
            || vec![Entry::EMPTY; row + wide * layers],
            |own, (y, out)| {
                own.fill(Entry::EMPTY);
                for (k, layer) in padded.iter().enumerate() {
                    for stretch in layer.stretches(y * PATCH.1) {
                        let first = y * PATCH.1 * stride + stretch.start;
                        let (lo, hi) = (&layer.lo[first..], &layer.hi[first..]);
                        let partial = &layer.partial.bits[first / PATCH.0..];
                        let own = &mut own[stretch.start / PATCH.0 * layers + k..];
                        simd.run(
                            #[inline(always)]
                            || {
                                for i in 0..stretch.len() / PATCH.0 {
                                    let at = i * PATCH.0;
                                    own[i * layers] = entry(&lo[at..], &hi[at..], &partial[i..], stride);
                                }
                            },
                        );
                    }
                }
                for (i, out) in out.iter_mut().enumerate() {
                    *out = (0..wide).fold(Entry::NOWHERE, |all, k| all.with(&own[i + k * layers]));
                }
            },
        );
        let mut entries = vec![Entry::NOWHERE; row * down];
        entries.par_chunks_mut(row).enumerate().for_each(|(y, out)| {
            for y in y..(y + high).min(down) {
                out.iter_mut().zip(&along[y * row..]).for_each(|(out, along)| *out = out.with(along));
            }
        });
        PatchBounds { across, layers, entries }
    }

    /// The entry of the part whose first cell is `(x, y)` of the padded frame.
    pub fn entry(&self, (x, y): (usize, usize)) -> usize {
        (y / PATCH.1 * self.across + x / PATCH.0) * self.layers
    }

    /// A query for the codes `from .. to` of a layer, in the cells at the offset `cell`.
    #[inline(always)]
    pub fn query(&self, cell: [i32; 2], layer: usize, from: u16, to: u16) -> Query {
        let [x, y] = [cell[0].div_euclid(PATCH.0 as i32), cell[1].div_euclid(PATCH.1 as i32)];
        let entry = (y * self.across as i32 + x) * self.layers as i32 + layer as i32;
        Query { entry, from, to, depths: bits(from, to - 1) }
    }

    /// The answer for the part whose entry is `entry`.
    #[inline(always)]
    pub fn occupancy(&self, entry: usize, query: &Query) -> Occupancy {
        let there = &self.entries[entry.wrapping_add_signed(query.entry as isize)];
        // No branches, because it cannot be predicted which of these tests fails.
        let any = (there.depths & query.depths != 0)
            & (there.greatest_hi >= query.from)
            & (there.least_lo < query.to);
        Occupancy { any, all: any & (there.least_hi >= query.from) & (there.greatest_lo < query.to) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLS: usize = PATCH.0 * PATCH.1;

    /// The answers of a single patch for all codes, for few codes, and for other codes.
    fn finds(lo: [u16; CELLS], hi: [u16; CELLS], partial: u8) -> [(bool, bool); 3] {
        let entry = entry(&lo, &hi, &[0, partial, 0, 0], PATCH.0);
        let patches = PatchBounds { across: 1, layers: 1, entries: vec![entry] };
        [(1, u16::MAX), (5000, 5001), (6000, 7000)].map(|(from, to)| {
            let found = patches.occupancy(0, &patches.query([0, 0], 0, from, to));
            (found.any, found.all)
        })
    }

    #[test]
    fn all_is_found_where_every_cell_is_met_and_covers_its_pixel() {
        let (lo, hi) = ([5000; CELLS], [5002; CELLS]);
        assert_eq!(finds(lo, hi, 0), [(true, true), (true, true), (false, false)]);
        // A cell that covers its pixel partly.
        assert_eq!(finds(lo, hi, 1 << 3), [(true, false), (true, false), (false, false)]);
        // A missing cell.
        let without = |mut codes: [u16; CELLS]| {
            codes[9] = 0;
            codes
        };
        assert_eq!(finds(without(lo), without(hi), 0), [(true, false), (true, false), (false, false)]);
        // A cell at another depth.
        let with = |mut codes: [u16; CELLS]| {
            codes[30] = 6500;
            codes
        };
        assert_eq!(finds(with(lo), with(hi), 0), [(true, true), (true, false), (true, false)]);
        // No cell at all.
        assert_eq!(finds([0; CELLS], [0; CELLS], 0), [(false, false); 3]);
    }
}
