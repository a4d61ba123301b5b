//! Sheets laid out for the sweep: quantised in depth, sharpened, with a mirrored margin as wide as the largest
//! circle of confusion, so that no ray ever leaves the arrays.

use super::footprint::{self, Footprint};
use super::sheets::{Sheet, Sheets};
use super::surfaces::{CONNECTED_PX, DOWN, EDGE, RIGHT};
use crate::cpu::border::mirrored;
use rayon::prelude::*;
use std::borrow::Cow;

/// Columns and rows of the tiles that the frame is swept in.
pub const TILE: (usize, usize) = (64, 32);
/// Side of the blocks whose depths are summed up for planning.
pub const BLOCK: usize = 16;

/// The padded frame.
#[derive(Debug, Clone, Copy)]
pub struct Padding {
    pub width: usize,
    pub height: usize,
    /// Mirrored pixels on every side, a multiple of [`BLOCK`].
    pub pad: usize,
    /// Cells from one padded row to the next.
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

    /// The frame column that each padded column mirrors.
    fn columns(&self) -> Vec<usize> {
        (0..self.stride).map(|px| self.column(px).0).collect()
    }

    /// The frame column that padded column `px` mirrors, and whether it is a mirror image.
    fn column(&self, px: usize) -> (usize, bool) {
        mirrored(px as i64 - self.pad as i64, self.width)
    }

    /// The frame row that padded row `py` mirrors, and whether it is a mirror image.
    fn row(&self, py: usize) -> (usize, bool) {
        mirrored(py as i64 - self.pad as i64, self.height)
    }
}

/// Shifts as 16-bit codes: `s = s_min + (code - 1) * step`. Code 0 is never a depth.
#[derive(Debug, Clone, Copy)]
pub struct Codes {
    s_min: f64,
    step: f64,
}

impl Codes {
    pub const MAX: u16 = u16::MAX - 1;

    fn new(s_min: f64, s_max: f64) -> Codes {
        Codes { s_min, step: ((s_max - s_min) / f64::from(Codes::MAX - 1)).max(1e-9) }
    }

    pub fn encode(&self, s: f32) -> u16 {
        // Single precision is enough: 24 bits for 16. The cast rounds down and saturates.
        ((s - self.s_min as f32) * (1.0 / self.step) as f32 + 0.5).min(f32::from(Codes::MAX - 1)) as u16 + 1
    }

    /// The shift that a code, or a place between codes, stands for.
    pub fn decode(&self, code: f64) -> f64 {
        self.s_min + (code - 1.0) * self.step
    }

    pub fn step(&self) -> f64 {
        self.step
    }
}

/// Half-planes of the cells that cover their pixel in part, as padded planes.
pub struct PartialPlanes {
    /// One bit a cell, rows of `stride / 8` bytes.
    pub bits: Vec<u8>,
    pub normal_x: Vec<f32>,
    pub normal_y: Vec<f32>,
    pub cut: Vec<f32>,
}

impl PartialPlanes {
    /// Whether a ray that passes cell `i` at `at`, from its centre, meets what the cell covers.
    pub fn covers(&self, i: usize, at: [f32; 2]) -> bool {
        self.bits[i / 8] >> (i % 8) & 1 == 0
            || self.normal_x[i] * at[0] + self.normal_y[i] * at[1] <= self.cut[i]
    }
}

/// One sheet, padded. A cell is the column of depths from `lo` to `hi`, in codes; an empty one has `lo > hi`.
pub struct PackedSheet {
    pub lo: Vec<u16>,
    pub hi: Vec<u16>,
    /// Colour planes.
    pub color: Vec<Vec<f32>>,
    pub partial: Option<PartialPlanes>,
}

/// Everything the sweep reads.
pub struct Packed {
    pub padding: Padding,
    pub codes: Codes,
    /// The largest shift, in front of the focus plane or behind.
    pub reach_px: f64,
    pub sheets: Vec<PackedSheet>,
    pub blocks: Blocks,
}

/// What the cells of each block of [`BLOCK`] x [`BLOCK`] padded pixels are, for planning.
pub struct Blocks {
    /// Blocks in a row.
    pub across: usize,
    /// For each block, then each sheet: the depths that occur, one bit for each high byte of their codes.
    pub occupied: Vec<[u64; 4]>,
    /// For each block: least and greatest code over all sheets.
    pub range: Vec<(u16, u16)>,
    /// For each block: the steepest cell, in codes, where all is one closed surface in the first sheet.
    pub smooth: Vec<Option<u16>>,
}

/// A cell's place in the sheets: sheet and pixel.
#[derive(Clone, Copy)]
struct Cell {
    sheet: usize,
    index: usize,
}

/// The cells that continue the surface of `cell` at the four neighbours.
fn neighbours(sheets: &Sheets, cell: Cell) -> impl Iterator<Item = Cell> + '_ {
    let (width, height) = (sheets.size.width, sheets.size.height);
    let (x, y, p) = (cell.index % width, cell.index / width, cell.index);
    let own = &sheets.sheets[cell.sheet];
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
        let others = sheets.sheets.iter().enumerate().filter(|(i, _)| *i != cell.sheet);
        others.filter(|(_, sheet)| near(sheet)).map(|(i, _)| Cell { sheet: i, index: q }).next()
    })
}

/// Which cells of a row have all four neighbours in their own sheet and close by, as nearly all have.
fn plain_cells(sheets: &Sheets, sheet: usize, y: usize) -> Vec<bool> {
    let (w, h) = (sheets.size.width, sheets.size.height);
    let at = |y: usize| &sheets.sheets[sheet].s[y * w..][..w];
    let mut plain = vec![false; w];
    if y > 0 && y + 1 < h {
        let (above, s, below) = (at(y - 1), at(y), at(y + 1));
        for x in 1..w.saturating_sub(1) {
            let around = [s[x - 1], s[x + 1], above[x], below[x]];
            plain[x] = around.iter().fold(true, |all, q| all & ((q - s[x]).abs() < CONNECTED_PX));
        }
    }
    plain
}

/// The depths that each cell of a row spans, in codes: a surface stays closed when every cell reaches half-way to
/// its neighbours.
fn extents(sheets: &Sheets, sheet: usize, y: usize, codes: &Codes, lo: &mut [u16], hi: &mut [u16]) {
    let w = sheets.size.width;
    let at = |y: usize| &sheets.sheets[sheet].s[y * w..][..w];
    let s = at(y);
    let (above, below) = (at(y.saturating_sub(1)), at((y + 1).min(sheets.size.height - 1)));
    let plain = plain_cells(sheets, sheet, y);
    let (lo, hi) = (&mut lo[..w], &mut hi[..w]);
    for x in 1..w.saturating_sub(1) {
        let around = [s[x - 1], s[x + 1], above[x], below[x]];
        let min = around.iter().fold(s[x], |m, &q| if q < m { q } else { m });
        let max = around.iter().fold(s[x], |m, &q| if q > m { q } else { m });
        lo[x] = codes.encode(0.5 * (s[x] + min));
        hi[x] = codes.encode(0.5 * (s[x] + max));
    }
    for x in (0..w).filter(|&x| !plain[x]) {
        if s[x].is_nan() {
            (lo[x], hi[x]) = (u16::MAX, 0);
            continue;
        }
        let (mut nearest, mut farthest) = (s[x], s[x]);
        for q in neighbours(sheets, Cell { sheet, index: y * w + x }) {
            let half_way = 0.5 * (s[x] + sheets.sheets[q.sheet].s[q.index]);
            farthest = farthest.min(half_way);
            nearest = nearest.max(half_way);
        }
        (lo[x], hi[x]) = (codes.encode(farthest), codes.encode(nearest));
    }
}

/// Copies what lies inside the frame to its mirror images on both sides.
fn mirror_row<T: Copy>(padding: &Padding, columns: &[usize], row: &mut [T]) {
    for px in (0..padding.pad).chain(padding.pad + padding.width..padding.stride) {
        row[px] = row[columns[px] + padding.pad];
    }
}

/// The rows of a sheet that have any cell.
fn rows_with_cells(sheet: &Sheet, width: usize) -> Vec<bool> {
    sheet.s.par_chunks(width).map(|row| row.iter().any(|s| !s.is_nan())).collect()
}

/// Lays out the depths of a sheet.
fn depths(sheets: &Sheets, sheet: usize, padding: &Padding, codes: &Codes) -> PackedSheet {
    let cells = padding.stride * padding.rows;
    let (mut lo, mut hi) = (vec![0u16; cells], vec![0u16; cells]);
    let inside = padding.pad..padding.pad + padding.width;
    let columns = padding.columns();
    let occupied = rows_with_cells(&sheets.sheets[sheet], sheets.size.width);
    let rows = lo.par_chunks_mut(padding.stride).zip(hi.par_chunks_mut(padding.stride));
    rows.enumerate().for_each(|(py, (lo, hi))| {
        let y = padding.row(py).0;
        if !occupied[y] {
            lo.fill(u16::MAX);
            return;
        }
        extents(sheets, sheet, y, codes, &mut lo[inside.clone()], &mut hi[inside.clone()]);
        mirror_row(padding, &columns, lo);
        mirror_row(padding, &columns, hi);
    });
    PackedSheet { lo, hi, color: Vec::new(), partial: partial_planes(&sheets.sheets[sheet], padding) }
}

/// Lays out the colours of a sheet, widened or sharpened to their footprint.
fn colors(
    sheets: &Sheets,
    sheet: usize,
    color: &[Cow<[f32]>],
    footprint: &Footprint,
    s_focus: f64,
    padding: &Padding,
) -> Vec<Vec<f32>> {
    let size = sheets.size;
    let (w, n) = (size.width, size.pixels());
    let s = &sheets.sheets[sheet].s;
    let columns = padding.columns();
    let occupied = rows_with_cells(&sheets.sheets[sheet], w);
    let mut planes = vec![vec![0.0f32; padding.stride * padding.rows]; size.channels];
    let mut rows: Vec<Vec<&mut [f32]>> =
        (0..padding.rows).map(|_| Vec::with_capacity(size.channels)).collect();
    for plane in &mut planes {
        plane.chunks_mut(padding.stride).zip(&mut rows).for_each(|(row, rows)| rows.push(row));
    }
    rows.par_iter_mut().enumerate().for_each(|(py, planes)| {
        let y = padding.row(py).0;
        if !occupied[y] {
            return;
        }
        let start = y * w;
        let kappa: Vec<f32> = s[start..start + w]
            .iter()
            .map(|&s| footprint.sharpening((f64::from(s) - s_focus) as f32))
            .collect();
        let plain = plain_cells(sheets, sheet, y);
        let kappa = &kappa[..w];
        for (c, out) in planes.iter_mut().enumerate() {
            let at = |y: usize| &color[sheet][c * n + y * w..][..w];
            let (above, row, below) = (at(y.saturating_sub(1)), at(y), at((y + 1).min(size.height - 1)));
            let inside = &mut out[padding.pad..padding.pad + w];
            for x in 1..w.saturating_sub(1) {
                let flow = |q: f32| footprint::flow(kappa[x], row[x], q);
                inside[x] = row[x] - (flow(row[x - 1]) + flow(row[x + 1]) + flow(above[x]) + flow(below[x]));
            }
        }
        for x in (0..w).filter(|&x| !plain[x]) {
            let index = start + x;
            let mut flow = [0.0f32; 4];
            // An empty cell has no colour, and no shift to be sharpened for.
            if !s[index].is_nan() {
                for q in neighbours(sheets, Cell { sheet, index }) {
                    for c in 0..size.channels {
                        let (own, other) = (color[sheet][c * n + index], color[q.sheet][c * n + q.index]);
                        flow[c] += footprint::flow(kappa[x], own, other);
                    }
                }
            }
            for (c, out) in planes.iter_mut().enumerate() {
                out[padding.pad + x] = color[sheet][c * n + index] - flow[c];
            }
        }
        planes.iter_mut().for_each(|out| mirror_row(padding, &columns, out));
    });
    planes
}

fn partial_planes(sheet: &Sheet, padding: &Padding) -> Option<PartialPlanes> {
    if sheet.partial.is_empty() {
        return None;
    }
    let cells = padding.stride * padding.rows;
    let mut planes = PartialPlanes {
        // The sweep reads eight bytes at a time.
        bits: vec![0; cells / 8 + 8],
        normal_x: vec![0.0; cells],
        normal_y: vec![0.0; cells],
        cut: vec![0.0; cells],
    };
    for py in 0..padding.rows {
        let (y, flip_y) = padding.row(py);
        let row_start = y * padding.width;
        let first = sheet.partial.partition_point(|p| p.0 < row_start);
        let last = sheet.partial.partition_point(|p| p.0 < row_start + padding.width);
        if first == last {
            continue;
        }
        let mut in_row = vec![None; padding.width];
        for (index, plane) in &sheet.partial[first..last] {
            in_row[index - row_start] = Some(*plane);
        }
        for px in 0..padding.stride {
            let (x, flip_x) = padding.column(px);
            let Some(plane) = in_row[x] else { continue };
            let i = py * padding.stride + px;
            planes.bits[i / 8] |= 1 << (i % 8);
            planes.normal_x[i] = if flip_x { -plane.normal[0] } else { plane.normal[0] };
            planes.normal_y[i] = if flip_y { -plane.normal[1] } else { plane.normal[1] };
            planes.cut[i] = plane.cut;
        }
    }
    Some(planes)
}

fn blocks(sheets: &Sheets, packed: &[PackedSheet], padding: &Padding) -> Blocks {
    let (across, down) = (padding.stride / BLOCK, padding.rows / BLOCK);
    let links = &sheets.sheets[0].links;
    let columns = padding.columns();
    let block = |b: usize| {
        let (x0, y0) = (b % across * BLOCK, b / across * BLOCK);
        let mut occupied = vec![[0u64; 4]; packed.len()];
        let (mut range, mut steepest, mut smooth) = ((u16::MAX, 0u16), 0u16, !links.is_empty());
        for py in y0..y0 + BLOCK {
            for (k, sheet) in packed.iter().enumerate() {
                let start = py * padding.stride + x0;
                for (&lo, &hi) in sheet.lo[start..start + BLOCK].iter().zip(&sheet.hi[start..start + BLOCK]) {
                    // The first sheet has to be whole for a smooth block, the others empty.
                    smooth &= (lo <= hi) == (k == 0);
                    if lo <= hi {
                        range = (range.0.min(lo), range.1.max(hi));
                        for bin in lo >> 8..=hi >> 8 {
                            occupied[k][usize::from(bin >> 6)] |= 1 << (bin & 63);
                        }
                        steepest = steepest.max(hi - lo);
                    }
                }
            }
            if smooth {
                let row = &links[padding.row(py).0 * padding.width..][..padding.width];
                smooth = columns[x0..x0 + BLOCK].iter().all(|&x| row[x] & EDGE == 0);
            }
        }
        (occupied, range, smooth.then_some(steepest))
    };
    let all: Vec<_> = (0..across * down).into_par_iter().map(block).collect();
    Blocks {
        across,
        occupied: all.iter().flat_map(|b| b.0.iter().copied()).collect(),
        range: all.iter().map(|b| b.1).collect(),
        smooth: all.iter().map(|b| b.2).collect(),
    }
}

/// Least and greatest shift of all cells.
pub fn shift_range(sheets: &Sheets) -> (f64, f64) {
    let all = sheets.sheets.par_iter().flat_map(|sheet| sheet.s.par_iter()).filter(|s| !s.is_nan());
    let (min, max) = all
        .map(|&s| (s, s))
        .reduce(|| (f32::INFINITY, f32::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    if min <= max { (f64::from(min), f64::from(max)) } else { (0.0, 0.0) }
}

impl Packed {
    /// Lays out the depths of all sheets for a lens focused at shift `s_focus`; colours come with
    /// [`Packed::set_colors`].
    pub fn new(sheets: &Sheets, s_focus: f64) -> Packed {
        let (s_min, s_max) = shift_range(sheets);
        let reach = (s_min - s_focus).abs().max((s_max - s_focus).abs());
        let padding = Padding::new(sheets.size.width, sheets.size.height, reach);
        let codes = Codes::new(s_min, s_max);
        let packed: Vec<PackedSheet> =
            (0..sheets.sheets.len()).map(|sheet| depths(sheets, sheet, &padding, &codes)).collect();
        let blocks = blocks(sheets, &packed, &padding);
        Packed { padding, codes, reach_px: reach, sheets: packed, blocks }
    }

    /// Lays out the colours of all sheets, widened or sharpened to their footprint.
    pub fn set_colors(&mut self, sheets: &Sheets, color: &[Cow<[f32]>], footprint: &Footprint, s_focus: f64) {
        for (sheet, packed) in self.sheets.iter_mut().enumerate() {
            packed.color = colors(sheets, sheet, color, footprint, s_focus, &self.padding);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_keep_depth_to_a_thousandth_of_a_pixel() {
        let codes = Codes::new(-3.0, 57.0);
        for s in [-3.0f32, 0.0, 12.3456, 57.0] {
            assert!((codes.decode(f64::from(codes.encode(s))) - f64::from(s)).abs() < 1e-3);
        }
    }
}
