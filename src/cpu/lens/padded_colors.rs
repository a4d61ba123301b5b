//! The colours of one layer with a mirrored margin, widened or sharpened to their footprint.

use super::padded_layer::{PaddedLayer, parts};
use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::footprint::{self, Footprint};
use crate::plan::lens::padding::Padding;
use crate::rows::bands;
use crate::scene::colors::Colors;
use crate::scene::depth_spans::{self, CHUNK, Cell, Rows};
use crate::scene::grid::BLOCK;
use crate::scene::layer::SceneLayer;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// The colours of cells as they are drawn: widened or sharpened to their footprint.
pub struct Drawn<'a> {
    pub layers: &'a [SceneLayer],
    pub size: Size,
    pub colors: &'a [Colors],
    pub footprint: &'a Footprint,
    pub s_focus: f64,
    pub simd: Simd,
}

/// Ranges of some rows of a layer's colours, with the neighbours that they need.
#[derive(Default)]
struct ColorRows {
    first: usize,
    /// Rows of all channels, one after another; undefined outside the ranges.
    rows: Vec<f32>,
}

impl ColorRows {
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

    /// Row `y` of one channel with the rows above and below.
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
    /// Writes a range of row `y` of one layer into planes that begin with this range.
    fn stretch(
        &self,
        band: &ColorRows,
        layer: usize,
        y: usize,
        stretch: Range<usize>,
        planes: &mut [&mut [f32]],
    ) {
        let rows = Rows::new(&self.layers[layer].s, self.size, y);
        let start = stretch.start;
        for chunk in depth_spans::chunks(stretch) {
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
                let cell = Cell { layer, index: y * self.size.width + x };
                let color = self.color_of(band, cell, kappa[x - chunk.start]);
                planes.iter_mut().zip(color).for_each(|(out, c)| out[x - start] = c);
            }
        }
    }

    /// The colour of any cell of the layer of `band`, sharpened by `kappa`.
    fn color_of(&self, band: &ColorRows, cell: Cell, kappa: f32) -> [f32; 4] {
        let own = band.at(self.size, cell.index);
        if kappa == 0.0 {
            return own;
        }
        let mut flow = [0.0f32; 4];
        for q in depth_spans::neighbours(self.layers, self.size, cell) {
            let same_sheet = q.layer == cell.layer;
            let other =
                if same_sheet { band.at(self.size, q.index) } else { self.colors[q.layer].at(q.index) };
            for c in 0..4 {
                flow[c] += footprint::flow(kappa, own[c], other[c]);
            }
        }
        std::array::from_fn(|c| own[c] - flow[c])
    }
}

/// Sharpens the cells of a chunk, all of whose neighbours are on their surface.
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

impl PaddedLayer {
    /// Lays out the colours of this layer, number `layer`.
    pub fn set_colors(&mut self, drawn: &Drawn, layer: usize, padding: &Padding) {
        let (size, pad, stride) = (drawn.size, padding.pad, padding.stride);
        let cells = stride * padding.rows;
        self.color = (0..size.channels).map(|_| Buffer::unset(cells)).collect();
        let present = &self.present;
        let frame = pad * stride..(pad + size.height) * stride;
        let bands = bands(self.color.iter_mut().map(|plane| &mut plane[frame.clone()]), stride * BLOCK);
        bands.into_par_iter().enumerate().for_each_init(ColorRows::default, |band, (i, mut planes)| {
            let rows = i * BLOCK..(i * BLOCK + planes[0].len() / stride);
            // A band is one row of blocks.
            let stretches: Vec<_> = present.stretches(rows.start + pad).collect();
            let inside = stretches.iter().map(|stretch| {
                let (inside, _) = parts(padding, stretch);
                inside.start - pad..inside.end - pad
            });
            band.fill(&drawn.colors[layer], size, &rows, inside);
            for y in rows.clone() {
                let mut row: Vec<&mut [f32]> = planes
                    .iter_mut()
                    .map(|plane| &mut plane[(y - rows.start) * stride..][..stride])
                    .collect();
                for stretch in &stretches {
                    let (inside, _) = parts(padding, stretch);
                    let mut into: Vec<&mut [f32]> =
                        row.iter_mut().map(|row| &mut row[inside.clone()]).collect();
                    drawn.stretch(band, layer, y, inside.start - pad..inside.end - pad, &mut into);
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
