//! The colours of one layer with a mirrored margin, widened or sharpened to their footprint.

use super::padded_layer::{PaddedLayer, parts};
use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::footprint::{self, Footprint, Sharpening};
use crate::plan::lens::padding::Padding;
use crate::rows::{bands, with_channels};
use crate::scene::colors::Colors;
use crate::scene::contrast::light_channels;
use crate::scene::depth_spans::{self, CHUNK, Cell, Rows};
use crate::scene::grid::BLOCK;
use crate::scene::layer::SceneLayer;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// The colours of cells as they are drawn: widened or sharpened to their footprint.
pub struct Drawn<'a> {
    pub layers: &'a [SceneLayer],
    /// The frame.
    pub size: Size,
    pub groups: &'a [DrawnGroup],
    /// The colours of the picture that carries the groups, in each layer.
    pub guide: Option<&'a [Colors]>,
    pub footprint: &'a Footprint,
    pub s_focus: f64,
    pub simd: Simd,
}

/// Channels that are drawn together.
pub struct DrawnGroup {
    /// The frame with these channels.
    pub size: Size,
    /// Their colours in each layer.
    pub colors: Vec<Colors>,
    pub sharpening: Sharpening,
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

/// The rows of every group of channels, and of the picture that carries them.
#[derive(Default)]
struct Band {
    groups: Vec<ColorRows>,
    guide: ColorRows,
}

/// The weights of a chunk's neighbours to the left, to the right, above and below.
type Weights = [[f32; CHUNK]; 4];

impl Drawn<'_> {
    /// Reads some ranges of rows of one layer.
    fn fill(
        &self,
        band: &mut Band,
        layer: usize,
        rows: &Range<usize>,
        stretches: impl Iterator<Item = Range<usize>> + Clone,
    ) {
        band.groups.resize_with(self.groups.len(), ColorRows::default);
        for (group, into) in self.groups.iter().zip(&mut band.groups) {
            into.fill(&group.colors[layer], group.size, rows, stretches.clone());
        }
        if let Some(guide) = self.guide {
            band.guide.fill(&guide[layer], self.size, rows, stretches);
        }
    }

    /// Writes a range of row `y` of one layer into planes that begin with this range.
    fn stretch(&self, band: &Band, layer: usize, y: usize, stretch: Range<usize>, planes: &mut [&mut [f32]]) {
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
            let mut spread = [0.0f32; CHUNK];
            let spread = self.footprint.spread(y, chunk.start, &mut spread[..chunk.len()]);
            self.simd.run(
                #[inline(always)]
                || match (&rows.row[chunk.clone()], spread) {
                    (s, None) => self.footprint.sharpening(s, self.s_focus, &mut kappa),
                    (s, Some(spread)) => {
                        self.footprint.sharpening_of_spread(s, spread, self.s_focus, &mut kappa);
                    }
                },
            );
            let guided = self.guide.map(|_| self.guided(&band.guide, y, &chunk, &kappa));
            let plain = self.simd.run(
                #[inline(always)]
                || rows.plain(&chunk),
            );
            let mut rest = &mut *planes;
            for (group, color) in self.groups.iter().zip(&band.groups) {
                let (own, others) = rest.split_at_mut(group.size.channels);
                rest = others;
                let widening = kappa.map(|kappa| kappa.min(0.0));
                for (c, out) in own.iter_mut().enumerate() {
                    let rows = color.rows(group.size, y, c);
                    let out = &mut out[chunk.start - start..];
                    self.simd.run(
                        #[inline(always)]
                        || match (group.sharpening, &guided) {
                            (Sharpening::Guided, Some(weights)) => sharpen_by(&rows, &chunk, weights, out),
                            (Sharpening::Never, _) => sharpen(&rows, &chunk, &widening, out),
                            (Sharpening::Own | Sharpening::Guided, _) => sharpen(&rows, &chunk, &kappa, out),
                        },
                    );
                }
            }
            for x in chunk.clone().filter(|x| !plain[x - chunk.start]) {
                let cell = Cell { layer, index: y * self.size.width + x };
                let mut first = 0;
                for g in 0..self.groups.len() {
                    let color = self.color_of(band, g, cell, kappa[x - chunk.start]);
                    planes[first..]
                        .iter_mut()
                        .zip(color)
                        .take(self.groups[g].size.channels)
                        .for_each(|(out, c)| out[x - start] = c);
                    first += self.groups[g].size.channels;
                }
            }
        }
    }

    /// The weights of neighbours for the carried channels of a chunk, all of whose neighbours are on their surface.
    fn guided(&self, guide: &ColorRows, y: usize, chunk: &Range<usize>, kappa: &[f32; CHUNK]) -> Weights {
        let mut weights = [[0.0; CHUNK]; 4];
        with_channels!(light_channels(self.size), L => {
            let rows: [Rows; L] = std::array::from_fn(|c| guide.rows(self.size, y, c));
            self.simd.run(
                #[inline(always)]
                || guided_weights(&rows, chunk, kappa, &mut weights),
            );
        });
        weights
    }

    /// The colour, in group number `g`, of any cell of the layer of `band`, sharpened by `kappa`.
    fn color_of(&self, band: &Band, g: usize, cell: Cell, kappa: f32) -> [f32; 4] {
        let (group, rows) = (&self.groups[g], &band.groups[g]);
        let own = rows.at(group.size, cell.index);
        let kappa = if group.sharpening == Sharpening::Never { kappa.min(0.0) } else { kappa };
        if kappa == 0.0 {
            return own;
        }
        let mut flow = [0.0f32; 4];
        for q in depth_spans::neighbours(self.layers, self.size, cell) {
            let same_sheet = q.layer == cell.layer;
            let of = |rows: &ColorRows, size: Size, colors: &[Colors]| {
                if same_sheet { rows.at(size, q.index) } else { colors[q.layer].at(q.index) }
            };
            let other = of(rows, group.size, &group.colors);
            match self.guide.filter(|_| group.sharpening == Sharpening::Guided) {
                None => (0..4).for_each(|c| flow[c] += footprint::flow(kappa, own[c], other[c])),
                Some(guide) => {
                    let (mut own_light, mut light) =
                        (band.guide.at(self.size, cell.index), of(&band.guide, self.size, guide));
                    let lights = light_channels(self.size);
                    own_light[lights..].fill(0.0);
                    light[lights..].fill(0.0);
                    let weight = footprint::guided(kappa, own_light, light);
                    (0..4).for_each(|c| flow[c] += weight * (other[c] - own[c]));
                }
            }
        }
        std::array::from_fn(|c| own[c] - flow[c])
    }
}

/// Computes [`Weights`] from the light of the picture that carries the channels.
#[inline(always)]
fn guided_weights<const L: usize>(
    rows: &[Rows; L],
    chunk: &Range<usize>,
    kappa: &[f32; CHUNK],
    weights: &mut Weights,
) {
    let inner = rows[0].inner(chunk);
    let skipped = inner.start - chunk.start;
    let crosses = rows.map(|rows| rows.cross(&inner));
    for (side, weights) in weights.iter_mut().enumerate() {
        let n = crosses[0].0.len();
        let (kappa, weights) = (&kappa[skipped..][..n], &mut weights[skipped..][..n]);
        for x in 0..n {
            let own = crosses.map(|(own, _)| own[x]);
            let other = crosses.map(|(_, around)| around[side][x]);
            weights[x] = footprint::guided(kappa[x], own, other);
        }
    }
}

/// Sharpens the cells of a chunk, all of whose neighbours are on their surface, by given weights.
#[inline(always)]
fn sharpen_by(rows: &Rows, chunk: &Range<usize>, weights: &Weights, out: &mut [f32]) {
    let inner = rows.inner(chunk);
    let (own, around) = rows.cross(&inner);
    let skipped = inner.start - chunk.start;
    let out = &mut out[skipped..][..own.len()];
    let weights = weights.each_ref().map(|weights| &weights[skipped..][..own.len()]);
    for x in 0..own.len() {
        let flow = |side: usize| weights[side][x] * (around[side][x] - own[x]);
        out[x] = own[x] - (flow(0) + flow(1) + flow(2) + flow(3));
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
        let (size, [left, above], stride) = (drawn.size, padding.pad, padding.stride);
        let cells = stride * padding.rows;
        let channels = drawn.groups.iter().map(|group| group.size.channels).sum();
        self.color = (0..channels).map(|_| Buffer::unset(cells)).collect();
        let present = &self.present;
        let frame = above * stride..(above + size.height) * stride;
        let bands = bands(self.color.iter_mut().map(|plane| &mut plane[frame.clone()]), stride * BLOCK);
        bands.into_par_iter().enumerate().for_each_init(Band::default, |band, (i, mut planes)| {
            let rows = i * BLOCK..(i * BLOCK + planes[0].len() / stride);
            // A band is one row of blocks.
            let stretches: Vec<_> = present.stretches(rows.start + above).collect();
            let inside = stretches.iter().map(|stretch| {
                let (inside, _) = parts(padding, stretch);
                inside.start - left..inside.end - left
            });
            drawn.fill(band, layer, &rows, inside);
            for y in rows.clone() {
                let mut row: Vec<&mut [f32]> = planes
                    .iter_mut()
                    .map(|plane| &mut plane[(y - rows.start) * stride..][..stride])
                    .collect();
                for stretch in &stretches {
                    let (inside, _) = parts(padding, stretch);
                    let mut into: Vec<&mut [f32]> =
                        row.iter_mut().map(|row| &mut row[inside.clone()]).collect();
                    drawn.stretch(band, layer, y, inside.start - left..inside.end - left, &mut into);
                }
                for px in stretches.iter().flat_map(|stretch| parts(padding, stretch).1) {
                    let source = padding.column(px).0 + left;
                    row.iter_mut().for_each(|row| row[px] = row[source]);
                }
            }
        });
        self.color.par_iter_mut().for_each(|plane| {
            for py in (0..above).chain(above + size.height..padding.rows) {
                let (own, source) = (py * stride, (padding.row(py).0 + above) * stride);
                for stretch in present.stretches(py) {
                    plane.copy_within(source + stretch.start..source + stretch.end, own + stretch.start);
                }
            }
        });
    }
}
