//! Sheets laid out for the sweep: sharpened, with a mirrored margin as wide as the largest circle of confusion, so
//! that no ray ever leaves the arrays. Only blocks that some sweep reads are filled in.

use super::blocks::{BLOCK, Blocks, DepthBits};
use super::cells::{self, CHUNK, Cell, Codes, Depths, Rows};
use super::colors::Colors;
use super::footprint::{self, Footprint};
use super::patches::Patches;
use super::sheets::{Sheet, Sheets};
use super::unmix::area_below;
use crate::cpu::border::mirrored;
use crate::cpu::rows::bands;
use crate::cpu::simd::Simd;
use crate::memory::Buffer;
use crate::picture::Size;
use rayon::prelude::*;
use std::ops::Range;

/// Columns and rows of the tiles that the frame is swept in.
pub const TILE: (usize, usize) = (64, 32);

/// The padded frame.
#[derive(Debug, Clone, Copy)]
pub struct Padding {
    pub width: usize,
    pub height: usize,
    /// Mirrored pixels on every side, a multiple of [`BLOCK`].
    pub pad: usize,
    /// Cells from one padded row to the next, a multiple of [`BLOCK`].
    pub stride: usize,
    /// Padded rows.
    pub rows: usize,
}

impl Padding {
    pub fn new(width: usize, height: usize, reach_px: f64) -> Padding {
        let pad = (reach_px.ceil() as usize + 2).next_multiple_of(BLOCK);
        Padding {
            width,
            height,
            pad,
            stride: width.next_multiple_of(TILE.0) + 2 * pad,
            rows: height.next_multiple_of(TILE.1) + 2 * pad,
        }
    }

    /// Index of pixel `(x, y)` of the frame in the padded arrays.
    pub fn index(&self, x: usize, y: usize) -> usize {
        (y + self.pad) * self.stride + x + self.pad
    }

    /// The frame column that padded column `px` shows, and whether it is a mirror image.
    pub fn column(&self, px: usize) -> (usize, bool) {
        mirrored(px as i64 - self.pad as i64, self.width)
    }

    /// The frame row that padded row `py` shows, and whether it is a mirror image.
    pub fn row(&self, py: usize) -> (usize, bool) {
        mirrored(py as i64 - self.pad as i64, self.height)
    }

    /// Padded columns that show frame column `x`, and whether mirrored.
    fn columns_of(&self, x: usize) -> impl Iterator<Item = (usize, bool)> {
        images(x, self.width, self.pad, self.stride)
    }
}

/// The places that show `i` when `n` are extended by `pad` before and up to `extent` in all.
pub fn images(i: usize, n: usize, pad: usize, extent: usize) -> impl Iterator<Item = (usize, bool)> {
    // The extension repeats with period 2 n; each period holds the place and its mirror image.
    let (i, n, pad) = (i as i64, n as i64, pad as i64);
    let first = -(pad / (2 * n)) - 1;
    let last = (extent as i64 - pad) / (2 * n) + 1;
    (first..=last)
        .flat_map(move |period| [(2 * n * period + i, false), (2 * n * period - 1 - i, true)])
        .map(move |(at, flipped)| (at + pad, flipped))
        .filter(move |(at, _)| (0..extent as i64).contains(at))
        .map(|(at, flipped)| (at as usize, flipped))
}

/// Half-planes of the cells that cover their pixel in part, as padded planes.
pub struct PartialPlanes {
    /// One bit a cell, rows of `stride / 8` bytes.
    pub bits: Vec<u8>,
    /// These mean something only where there is a half-plane; they are empty where there is none at all.
    pub normal_x: Buffer<f32>,
    pub normal_y: Buffer<f32>,
    pub cut: Buffer<f32>,
}

impl PartialPlanes {
    fn new(sheet: &Sheet, padding: &Padding, present: &Present) -> PartialPlanes {
        let (stride, width) = (padding.stride, padding.width);
        let cells = stride * padding.rows;
        // The sweep reads eight bytes at a time.
        let bits = vec![0; cells / 8 + 8];
        let [normal_x, normal_y, cut] =
            std::array::from_fn(|_| Buffer::unset(if sheet.partial.is_empty() { 0 } else { cells }));
        let mut planes = PartialPlanes { bits, normal_x, normal_y, cut };
        let place = |index: usize| sheet.partial.partition_point(|(i, _)| *i < index);
        let rows = (planes.normal_x.par_chunks_mut(stride), planes.normal_y.par_chunks_mut(stride));
        let rows = rows.into_par_iter().zip(planes.cut.par_chunks_mut(stride));
        let rows = rows.zip(planes.bits.par_chunks_mut(stride / 8)).enumerate();
        rows.for_each(|(py, (((normal_x, normal_y), cut), bits))| {
            let (y, flip_y) = padding.row(py);
            for (index, plane) in &sheet.partial[place(y * width)..place((y + 1) * width)] {
                for (px, flip_x) in padding.columns_of(index % width).filter(|(px, _)| present.at(*px, py)) {
                    bits[px / 8] |= 1 << (px % 8);
                    normal_x[px] = if flip_x { -plane.normal[0] } else { plane.normal[0] };
                    normal_y[px] = if flip_y { -plane.normal[1] } else { plane.normal[1] };
                    cut[px] = plane.cut;
                }
            }
        });
        planes
    }

    /// How much of a beam one pixel wide, passing cell `i` at `at` from its centre, meets what the cell covers.
    pub fn covered(&self, i: usize, at: [f32; 2]) -> f32 {
        if self.bits[i / 8] >> (i % 8) & 1 == 0 {
            return 1.0;
        }
        let normal = [self.normal_x[i], self.normal_y[i]];
        area_below(normal, self.cut[i] - (normal[0] * at[0] + normal[1] * at[1]))
    }
}

/// The blocks in which a sheet is laid out.
struct Present {
    across: usize,
    blocks: Vec<bool>,
}

impl Present {
    /// Those that are needed and have a cell.
    fn new(blocks: &Blocks, sheet: usize, needed: &[bool]) -> Present {
        let has_cells = |b: usize| blocks.occupied[b * blocks.sheets + sheet] != [0; 4];
        let blocks_present = needed.iter().enumerate().map(|(b, needed)| *needed && has_cells(b)).collect();
        Present { across: blocks.across, blocks: blocks_present }
    }

    fn at(&self, px: usize, py: usize) -> bool {
        self.blocks[py / BLOCK * self.across + px / BLOCK]
    }

    /// Padded row `py` in stretches that are laid out, or are not, altogether.
    fn parts(&self, py: usize) -> impl Iterator<Item = (bool, Range<usize>)> + '_ {
        let row = &self.blocks[py / BLOCK * self.across..][..self.across];
        let mut end = 0;
        row.chunk_by(|a, b| a == b).map(move |same| {
            let start = end;
            end += same.len();
            (same[0], start * BLOCK..end * BLOCK)
        })
    }

    /// The stretches of padded row `py` that are laid out.
    fn stretches(&self, py: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        self.parts(py).filter_map(|(laid_out, stretch)| laid_out.then_some(stretch))
    }
}

/// One sheet, padded. A cell is the column of depths from `lo` to `hi`, in codes; both are 0 where there is none.
pub struct PackedSheet {
    pub lo: Buffer<u16>,
    pub hi: Buffer<u16>,
    /// Colour planes, which mean something only where there is a cell.
    pub color: Vec<Buffer<f32>>,
    pub partial: PartialPlanes,
    present: Present,
}

/// Everything the sweep reads.
pub struct Packed {
    pub padding: Padding,
    pub codes: Codes,
    /// The largest shift, in front of the focus plane or behind.
    pub reach_px: f64,
    pub sheets: Vec<PackedSheet>,
    pub blocks: Blocks,
    /// See [`Blocks::windows`].
    pub windows: Vec<DepthBits>,
    /// Where which depths occur, more finely.
    pub patches: Patches,
}

/// The part of a padded stretch that lies inside the frame, and what is left of it on both sides.
fn parts(padding: &Padding, stretch: &Range<usize>) -> (Range<usize>, impl Iterator<Item = usize> + use<>) {
    let (first, end) = (padding.pad, padding.pad + padding.width);
    let inside = stretch.start.clamp(first, end)..stretch.end.clamp(first, end);
    let outside = (stretch.start..stretch.end.min(first)).chain(stretch.start.max(end)..stretch.end);
    (inside, outside)
}

/// Lays out the depths of a sheet.
fn depths(depths: &Depths, sheet: &Sheet, padding: &Padding, present: Present) -> PackedSheet {
    let cells = padding.stride * padding.rows;
    let (mut lo, mut hi) = (Buffer::unset(cells), Buffer::unset(cells));
    let rows = lo.par_chunks_mut(padding.stride).zip(hi.par_chunks_mut(padding.stride));
    rows.enumerate().for_each(|(py, (lo, hi))| {
        let at = padding.row(py).0 * padding.width;
        for (laid_out, stretch) in present.parts(py) {
            if !laid_out {
                lo[stretch.clone()].fill(0);
                hi[stretch].fill(0);
                continue;
            }
            let (inside, outside) = parts(padding, &stretch);
            let source = at + inside.start - padding.pad..at + inside.end - padding.pad;
            lo[inside.clone()].copy_from_slice(&depths.lo[source.clone()]);
            hi[inside].copy_from_slice(&depths.hi[source]);
            for px in outside {
                let source = at + padding.column(px).0;
                (lo[px], hi[px]) = (depths.lo[source], depths.hi[source]);
            }
        }
    });
    PackedSheet { lo, hi, color: Vec::new(), partial: PartialPlanes::new(sheet, padding, &present), present }
}

/// Colours of cells as they are drawn: widened or sharpened to their footprint.
struct Drawn<'a> {
    sheets: &'a [Sheet],
    size: Size,
    colors: &'a [Colors],
    footprint: &'a Footprint,
    s_focus: f64,
    simd: Simd,
}

/// Stretches of some rows of a sheet's colours, and what is around them.
#[derive(Default)]
struct Band {
    first: usize,
    /// Rows of all channels, one after another; unknown but for the stretches.
    rows: Vec<f32>,
}

impl Band {
    fn fill(
        &mut self,
        colors: &Colors,
        size: Size,
        rows: &Range<usize>,
        stretches: impl Iterator<Item = Range<usize>> + Clone,
    ) {
        self.first = rows.start.saturating_sub(1);
        let end = (rows.end + 1).min(size.height);
        let row = size.width * size.channels;
        self.rows.resize((end - self.first) * row, 0.0);
        for (y, out) in (self.first..end).zip(self.rows.chunks_exact_mut(row)) {
            for stretch in stretches.clone() {
                let columns = stretch.start.saturating_sub(1)..(stretch.end + 1).min(size.width);
                let start = columns.start;
                colors.copy_row(y, columns, size.width, &mut out[start..]);
            }
        }
    }

    /// Row `y` of one channel between its neighbours.
    fn rows(&self, size: Size, y: usize, channel: usize) -> Rows<'_> {
        let at =
            |y: usize| &self.rows[((y - self.first) * size.channels + channel) * size.width..][..size.width];
        Rows { above: at(y.saturating_sub(1)), row: at(y), below: at((y + 1).min(size.height - 1)) }
    }

    /// The colour of a pixel in one of the rows.
    fn at(&self, size: Size, index: usize) -> [f32; 4] {
        let (x, y) = (index % size.width, index / size.width);
        let at = |c: usize| self.rows[((y - self.first) * size.channels + c) * size.width + x];
        std::array::from_fn(|c| if c < size.channels { at(c) } else { 0.0 })
    }
}

impl Drawn<'_> {
    /// A stretch of row `y` of one sheet, into planes that begin with the stretch.
    fn stretch(&self, band: &Band, sheet: usize, y: usize, stretch: Range<usize>, planes: &mut [&mut [f32]]) {
        let rows = Rows::new(&self.sheets[sheet].s, self.size, y);
        let start = stretch.start;
        for chunk in cells::chunks(stretch) {
            if self.simd.run(
                #[inline(always)]
                || rows.is_empty(&chunk),
            ) {
                continue;
            }
            let mut kappa = [0.0f32; CHUNK];
            self.simd.run(
                #[inline(always)]
                || self.footprint.sharpening(&rows.row[chunk.clone()], self.s_focus, &mut kappa),
            );
            for (c, out) in planes.iter_mut().enumerate() {
                let rows = band.rows(self.size, y, c);
                self.simd.run(
                    #[inline(always)]
                    || sharpen(&rows, &chunk, &kappa, &mut out[chunk.start - start..]),
                );
            }
            let plain = self.simd.run(
                #[inline(always)]
                || rows.plain(&chunk),
            );
            for x in chunk.clone().filter(|x| !plain[x - chunk.start]) {
                let cell = Cell { sheet, index: y * self.size.width + x };
                let color = self.color_of(band, cell, kappa[x - chunk.start]);
                planes.iter_mut().zip(color).for_each(|(out, c)| out[x - start] = c);
            }
        }
    }

    /// The colour of any cell of the sheet that `band` is of, sharpened by `kappa`.
    fn color_of(&self, band: &Band, cell: Cell, kappa: f32) -> [f32; 4] {
        let own = band.at(self.size, cell.index);
        if kappa == 0.0 {
            return own;
        }
        let mut flow = [0.0f32; 4];
        for q in cells::neighbours(self.sheets, self.size, cell) {
            let same_sheet = q.sheet == cell.sheet;
            let other =
                if same_sheet { band.at(self.size, q.index) } else { self.colors[q.sheet].at(q.index) };
            for c in 0..4 {
                flow[c] += footprint::flow(kappa, own[c], other[c]);
            }
        }
        std::array::from_fn(|c| own[c] - flow[c])
    }
}

/// Sharpens the cells of a chunk, all neighbours being on their surface.
#[inline(always)]
fn sharpen(rows: &Rows, chunk: &Range<usize>, kappa: &[f32; CHUNK], out: &mut [f32]) {
    let inner = rows.inner(chunk);
    let (own, [left, right, above, below]) = rows.cross(&inner);
    let skipped = inner.start - chunk.start;
    let (kappa, out) = (&kappa[skipped..][..own.len()], &mut out[skipped..][..own.len()]);
    for x in 0..own.len() {
        let flow = |q: &[f32]| footprint::flow(kappa[x], own[x], q[x]);
        out[x] = own[x] - (flow(left) + flow(right) + flow(above) + flow(below));
    }
}

impl Packed {
    /// Lays out the depths of all sheets in the needed blocks; colours come with [`Packed::set_colors`].
    pub fn new(
        sheets: &Sheets,
        padding: Padding,
        blocks: Blocks,
        reach_px: f64,
        needed: &[bool],
        simd: Simd,
    ) -> Packed {
        let packed = sheets.sheets.iter().zip(sheets.depths.iter()).enumerate();
        let packed =
            packed.map(|(k, (sheet, d))| depths(d, sheet, &padding, Present::new(&blocks, k, needed)));
        let packed: Vec<_> = packed.collect();
        let (windows, patches) = (blocks.windows(), Patches::new(&packed, &padding, simd));
        Packed { padding, codes: sheets.codes, reach_px, sheets: packed, blocks, windows, patches }
    }

    /// Lays out the colours of all sheets, widened or sharpened to their footprint.
    pub fn set_colors(
        &mut self,
        sheets: &Sheets,
        colors: &[Colors],
        footprint: &Footprint,
        s_focus: f64,
        simd: Simd,
    ) {
        let drawn = Drawn { sheets: &sheets.sheets, size: sheets.size, colors, footprint, s_focus, simd };
        for (sheet, packed) in self.sheets.iter_mut().enumerate() {
            packed.set_colors(&drawn, sheet, &self.padding);
        }
    }
}

impl PackedSheet {
    /// The stretches of padded row `py` that are laid out.
    pub fn stretches(&self, py: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        self.present.stretches(py)
    }

    /// Lays out the colours of this sheet, number `sheet`.
    fn set_colors(&mut self, drawn: &Drawn, sheet: usize, padding: &Padding) {
        let (size, pad, stride) = (drawn.size, padding.pad, padding.stride);
        let cells = stride * padding.rows;
        self.color = (0..size.channels).map(|_| Buffer::unset(cells)).collect();
        let present = &self.present;
        let frame = pad * stride..(pad + size.height) * stride;
        let bands = bands(self.color.iter_mut().map(|plane| &mut plane[frame.clone()]), stride * BLOCK);
        bands.into_par_iter().enumerate().for_each_init(Band::default, |band, (i, mut planes)| {
            let rows = i * BLOCK..(i * BLOCK + planes[0].len() / stride);
            // A band is a row of blocks.
            let stretches: Vec<_> = present.stretches(rows.start + pad).collect();
            let inside = stretches.iter().map(|stretch| {
                let (inside, _) = parts(padding, stretch);
                inside.start - pad..inside.end - pad
            });
            band.fill(&drawn.colors[sheet], size, &rows, inside);
            for y in rows.clone() {
                let mut row: Vec<&mut [f32]> = planes
                    .iter_mut()
                    .map(|plane| &mut plane[(y - rows.start) * stride..][..stride])
                    .collect();
                for stretch in &stretches {
                    let (inside, _) = parts(padding, stretch);
                    let mut into: Vec<&mut [f32]> =
                        row.iter_mut().map(|row| &mut row[inside.clone()]).collect();
                    drawn.stretch(band, sheet, y, inside.start - pad..inside.end - pad, &mut into);
                }
                for px in stretches.iter().flat_map(|stretch| parts(padding, stretch).1) {
                    let source = padding.column(px).0 + pad;
                    row.iter_mut().for_each(|row| row[px] = row[source]);
                }
            }
        });
        self.color.par_iter_mut().for_each(|plane| {
            for py in (0..pad).chain(pad + size.height..padding.rows) {
                let (own, source) = (py * stride, (padding.row(py).0 + pad) * stride);
                for stretch in present.stretches(py) {
                    plane.copy_within(source + stretch.start..source + stretch.end, own + stretch.start);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_where_the_mirror_shows_them() {
        for (n, pad, extent) in [(3, 8, 20), (5, 2, 9), (1, 4, 9), (40, 16, 96)] {
            for i in 0..n {
                let mut found: Vec<_> = images(i, n, pad, extent).collect();
                found.sort_unstable();
                let shows = |at: usize| mirrored(at as i64 - pad as i64, n);
                let expected: Vec<_> =
                    (0..extent).filter(|&at| shows(at).0 == i).map(|at| (at, shows(at).1)).collect();
                assert_eq!(found, expected);
            }
        }
    }
}
