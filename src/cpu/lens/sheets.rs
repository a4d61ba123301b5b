//! The scene as sheets of cells: at every pixel, what a ray finds in front and what it finds behind.
//!
//! A cell has a place in depth, a pure colour and, where it covers its pixel in part, a half-plane. Sheets
//! depend on the strength of the lens (`s = k d`) but not on its focus, so a focal stack shares them.

use super::blocks::Blocks;
use super::cells::{self, Codes, Depths};
use super::colors::{Colors, Own};
use super::fill;
use super::highlights::{self, Bright};
use super::surfaces;
use super::unmix::{Frame, HalfPlane, Mixed, unmix};
use crate::cancel::Cancel;
use crate::cpu::simd::Simd;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::{Layer, Picture, Size};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// One cell a pixel at most. Sheets of single channels share all but the colours.
pub struct Sheet {
    /// Shift of every cell relative to infinity, in pixels; NaN where there is none.
    pub s: Arc<Buffer<f32>>,
    /// Colour of every cell; zero where there is none.
    pub colors: Colors,
    /// The cells that cover their pixel in part, by rising index.
    pub partial: Arc<Vec<(usize, HalfPlane)>>,
    /// Steeper neighbours than [`surfaces::CONNECTED_PX`] that are one surface all the same; see
    /// [`surfaces::links`]. Empty for a sheet whose cells are no plain pixels.
    pub links: Arc<Vec<u8>>,
}

/// All sheets of a scene, front to back.
pub struct Sheets {
    /// The frame.
    pub size: Size,
    /// The sheets themselves.
    pub sheets: Vec<Sheet>,
    /// Whether a ray that meets no cell has met something unknown (then the others speak for it) rather than
    /// nothing at all.
    pub opaque: bool,
    /// Least and greatest shift of all cells, relative to infinity.
    pub shifts: (f64, f64),
    /// How depths are coded.
    pub codes: Codes,
    /// The depths of each sheet.
    pub depths: Arc<Vec<Depths>>,
    /// What the blocks of the frame hold.
    pub blocks: Arc<Blocks>,
    /// The cells that stand out, once they have been asked for.
    bright: OnceLock<Arc<Vec<Vec<Bright>>>>,
}

impl Sheets {
    fn new(size: Size, sheets: Vec<Sheet>, opaque: bool, simd: Simd) -> Sheets {
        let shifts = cells::shift_range(&sheets);
        let codes = Codes::new(shifts);
        let depths: Vec<_> =
            (0..sheets.len()).map(|sheet| Depths::new(&sheets, size, sheet, &codes, simd)).collect();
        let blocks = Blocks::new(size, &depths, &codes, &sheets[0].links, simd);
        let (depths, blocks) = (Arc::new(depths), Arc::new(blocks));
        Sheets { size, sheets, opaque, shifts, codes, depths, blocks, bright: OnceLock::new() }
    }

    /// The cells of each sheet that stand out.
    pub fn bright(&self, simd: Simd) -> Arc<Vec<Vec<Bright>>> {
        // Not found inside the lock: workers that wait for one another there could wait for themselves.
        let found = self.bright.get().map(Arc::clone);
        found.unwrap_or_else(|| {
            let found = Arc::new(highlights::find(self, simd));
            Arc::clone(self.bright.get_or_init(|| found))
        })
    }

    /// The same cells with these channels of their colours.
    pub fn of_channels(&self, channels: &[usize]) -> Sheets {
        let of = |sheet: &Sheet| Sheet {
            s: Arc::clone(&sheet.s),
            colors: sheet.colors.of_channels(channels),
            partial: Arc::clone(&sheet.partial),
            links: Arc::clone(&sheet.links),
        };
        Sheets {
            size: Size { channels: channels.len(), ..self.size },
            sheets: self.sheets.iter().map(of).collect(),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::clone(&self.depths),
            blocks: Arc::clone(&self.blocks),
            bright: OnceLock::new(),
        }
    }
}

impl Sheets {
    /// The same cells in some rows, which begin with a block and end with one or with the frame. All that was found of the
    /// whole frame stays as it is.
    pub fn rows(&self, rows: Range<usize>) -> Sheets {
        let width = self.size.width;
        let pixels = rows.start * width..rows.end * width;
        let size = Size { height: rows.len(), ..self.size };
        let of = |sheet: &Sheet| {
            let partial = sheet.partial.iter().filter(|(index, _)| pixels.contains(index));
            let partial = partial.map(|(index, plane)| (index - pixels.start, *plane)).collect();
            let links =
                if sheet.links.is_empty() { Vec::new() } else { sheet.links[pixels.clone()].to_vec() };
            Sheet {
                s: Arc::new(Buffer::from(&sheet.s[pixels.clone()])),
                colors: sheet.colors.rows(pixels.clone(), size),
                partial: Arc::new(partial),
                links: Arc::new(links),
            }
        };
        let depths = self.depths.iter().map(|depths| Depths {
            lo: Buffer::from(&depths.lo[pixels.clone()]),
            hi: Buffer::from(&depths.hi[pixels.clone()]),
        });
        Sheets {
            size,
            sheets: self.sheets.iter().map(of).collect(),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::new(depths.collect()),
            blocks: Arc::new(self.blocks.rows(rows)),
            bright: OnceLock::new(),
        }
    }
}

/// The sheets of a picture under a lens of strength `k` pixels per unit of disparity.
pub fn build(picture: &Picture, k: f64, simd: Simd, cancel: &Cancel) -> Result<Sheets> {
    match picture.layers.as_slice() {
        [layer] => from_one_layer(picture.size, layer, k, simd, cancel),
        layers => from_layers(picture.size, layers, k, simd, cancel),
    }
}

fn scaled(disparity: &[f32], k: f64) -> Buffer<f32> {
    Buffer::of_each(disparity, |d| (k * f64::from(*d)) as f32)
}

/// One layer: edges are unmixed, and what lies hidden behind them is filled in.
///
/// Coverage, if the picture has it, is one more channel: what is transparent is a surface at infinity that
/// happens to have no colour.
fn from_one_layer(size: Size, layer: &Layer, k: f64, simd: Simd, cancel: &Cancel) -> Result<Sheets> {
    let mut s = scaled(&layer.disparity, k);
    let links = surfaces::links(&s, size.width, size.height);
    let colors = Colors::new(size, Arc::clone(&layer.color));
    let frame = Frame { size, color: &layer.color, s: &s, links: &links };
    let mixed = unmix(&frame, cancel)?;
    if mixed.is_empty() {
        let front = Sheet { s: Arc::new(s), colors, partial: Arc::default(), links: Arc::new(links) };
        return Ok(Sheets::new(size, vec![front], true, simd));
    }
    let partial = half_planes(&frame, &mixed);
    let hidden = fill::hidden(&frame, &mixed, cancel)?;

    // A mixed pixel has both surfaces; if it turns out to show the one behind alone, it is that one's.
    let (both, behind): (Vec<Mixed>, Vec<Mixed>) = mixed.iter().partition(|m| m.coverage > 0.0);
    let own = |index: usize, color: [f32; 4]| Own { index, color };
    let front_colors = both.iter().map(|m| own(m.index, m.front));
    let front_colors = front_colors.chain(behind.iter().map(|m| own(m.index, m.back))).collect();
    let back_colors = both.iter().map(|m| own(m.index, m.back));
    let back_colors = back_colors.chain(hidden.iter().map(|h| own(h.index, h.color))).collect();

    both.iter().for_each(|m| s[m.index] = m.s_front);
    behind.iter().for_each(|m| s[m.index] = m.s_back);
    let mut back_s = Buffer::full(size.pixels(), f32::NAN);
    both.iter().for_each(|m| back_s[m.index] = m.s_back);
    hidden.iter().for_each(|h| back_s[h.index] = h.s);

    let front = Sheet {
        s: Arc::new(s),
        colors: colors.with(front_colors),
        partial: Arc::new(partial),
        links: Arc::new(links),
    };
    let colors = Colors::of_cells(size, back_colors);
    let back = Sheet { s: Arc::new(back_s), colors, partial: Arc::default(), links: Arc::default() };
    Ok(Sheets::new(size, vec![front, back], true, simd))
}

/// Half-planes of the pixels that are mixed in earnest.
fn half_planes(frame: &Frame, mixed: &[Mixed]) -> Vec<(usize, HalfPlane)> {
    let (width, height) = (frame.size.width, frame.size.height);
    let first_from = |index: usize| mixed.partition_point(|m| m.index < index);
    let starts: Vec<usize> = (0..=height).into_par_iter().map(|y| first_from(y * width)).collect();
    let row = |y: usize| {
        let row_of = |y: usize| &mixed[starts[y]..starts[y + 1]];
        // The rows above, here and below, each without what lies too far left to be a neighbour any more.
        let mut rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(row_of);
        let mut planes = Vec::new();
        for m in row_of(y) {
            let x = m.index % width;
            for row in &mut rows {
                let left = row.iter().take_while(|q| q.index % width + 1 < x).count();
                *row = &row[left..];
            }
            if m.coverage <= 0.0 || m.coverage >= 1.0 {
                continue;
            }
            let middle = 0.5 * (m.s_front + m.s_back);
            let coverage_of = |j: usize, q: usize| {
                let own = rows[j].iter().take(3).find(|other| other.index == q);
                own.map_or_else(|| f32::from(frame.s[q] > middle), |own| own.coverage)
            };
            let around = std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    let q = frame.offset(x, y, i as i32 - 1, j as i32 - 1);
                    q.map_or(m.coverage, |q| coverage_of(j, q))
                })
            });
            planes.push((m.index, HalfPlane::from_coverage(around, m.index)));
        }
        planes
    };
    (0..height).into_par_iter().flat_map_iter(row).collect()
}

/// Real layers: coverage is alpha, colours are each surface's own, nothing is invented.
fn from_layers(size: Size, layers: &[Layer], k: f64, simd: Simd, cancel: &Cancel) -> Result<Sheets> {
    let n = size.pixels();
    let alpha = size.channels - 1;
    let sheets = layers
        .iter()
        .map(|layer| {
            cancel.check()?;
            let coverage = &layer.color[alpha * n..];
            let mut s = scaled(&layer.disparity, k);
            let links = surfaces::links(&s, size.width, size.height);
            s.iter_mut().zip(coverage).filter(|(_, a)| **a <= 0.0).for_each(|(s, _)| *s = f32::NAN);
            let mut color = Buffer::clone(&layer.color);
            color.par_chunks_mut(n).for_each(|plane| {
                for (c, &a) in plane.iter_mut().zip(coverage) {
                    *c = if a > 0.0 { *c / a } else { 0.0 };
                }
            });
            let partial = layer_half_planes(size, coverage);
            let colors = Colors::new(size, Arc::new(color));
            Ok(Sheet { s: Arc::new(s), colors, partial: Arc::new(partial), links: Arc::new(links) })
        })
        .collect::<Result<Vec<_>>>()?;
    let covered = |i: usize| layers.iter().any(|l| l.color[alpha * n + i] >= 1.0);
    let opaque = (0..n).into_par_iter().all(covered);
    Ok(Sheets::new(size, sheets, opaque, simd))
}

fn layer_half_planes(size: Size, coverage: &[f32]) -> Vec<(usize, HalfPlane)> {
    (0..size.pixels())
        .into_par_iter()
        .filter(|&i| coverage[i] > 0.0 && coverage[i] < 1.0)
        .map(|index| {
            let (x, y) = (index % size.width, index / size.width);
            let clamped = |v: usize, d: usize, n: usize| (v + d).saturating_sub(1).min(n - 1);
            let around = std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    coverage[clamped(y, j, size.height) * size.width + clamped(x, i, size.width)]
                })
            });
            (index, HalfPlane::from_coverage(around, index))
        })
        .collect()
}
