//! The two targets that sprites are drawn into.

use super::Light;
use super::list::{Image, List};
use crate::cancel::Cancel;
use crate::cpu::border::mirrored;
use crate::cpu::simd::Simd;
use crate::error::Result;
use crate::picture::{Layer, Size};
use crate::plan::sprites::{LANES, Sprite};
use rayon::prelude::*;
use std::ops::Range;

/// Rows of the targets that one worker fills at a time.
const BAND: usize = 16;

/// Points whose light is added up before it is added to that of others. A sum of very many shares loses some of
/// each to rounding, the more the larger it has become already.
const FEW: usize = 256;

/// The layers that sprites are drawn into, in the order of their planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    InFront,
    Behind,
}

/// The layers in front and behind at half the size.
pub struct Targets {
    /// Columns, and rows.
    pub width: usize,
    pub height: usize,
    /// Row by row: of the layer in front the planes of colour times coverage and that of coverage, then of the layer
    /// behind.
    values: Vec<f32>,
    /// Planes of one layer.
    of_layer: usize,
}

impl Targets {
    /// Draws the whole list, and its mirror image beyond the border.
    pub fn new<const C: usize>(
        list: &List,
        layer: &Layer,
        size: Size,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<Targets> {
        let (width, height) = (size.width.div_ceil(2), size.height.div_ceil(2));
        let (reach, of_layer) = (list.reach as i64, C + 1);
        let length = 2 * of_layer * width;
        let images = Image::all(size.width, list.reach);
        let mut values = vec![0.0f32; height * length];
        let bands = values.par_chunks_mut(BAND * length).enumerate();
        let scratch = || [Depth::InFront, Depth::Behind].map(|depth| Few::<C>::new(depth, width, list.reach));
        bands.try_for_each_init(scratch, |layers, (i, out)| {
            let (first, rows) = (i * BAND, out.len() / length);
            for y in 2 * first as i64 - reach..2 * (first + rows) as i64 + reach {
                cancel.check()?;
                let row = mirrored(y, size.height).0;
                let points = &list.rows[row];
                simd.run(
                    #[inline(always)]
                    || {
                        for image in &images {
                            for point in image.of(points) {
                                let x = image.column(point);
                                let sprite = list.sprite(point, (x, y));
                                let at = row * size.width + point.column as usize;
                                let light = Light::of(layer, size, at, point.drawn);
                                let few = &mut layers[usize::from(!point.is_in_front())];
                                few.draw(sprite, (x >> 1, (y >> 1) - first as i64), rows, &light);
                                if few.points == FEW {
                                    few.add_to(out, width);
                                }
                            }
                        }
                    },
                );
            }
            layers.iter_mut().for_each(|few| few.add_to(out, width));
            Ok(())
        })?;
        Ok(Targets { width, height, values, of_layer })
    }

    /// A row of one plane of a layer.
    pub fn row(&self, depth: Depth, plane: usize, row: usize) -> &[f32] {
        let plane = (2 * row + depth as usize) * self.of_layer + plane;
        &self.values[plane * self.width..][..self.width]
    }
}

/// The light of some points of one layer over a band of rows, with columns on either side for what hangs over.
struct Few<const C: usize> {
    depth: Depth,
    margin: usize,
    stride: usize,
    /// Row by row all planes.
    sums: Vec<f32>,
    /// How many points these are, and the rows and columns that they touch.
    points: usize,
    rows: Range<usize>,
    columns: Range<usize>,
}

impl<const C: usize> Few<C> {
    fn new(depth: Depth, width: usize, reach: usize) -> Self {
        // A sprite drawn outside begins and ends within its reach.
        let margin = reach + LANES;
        let stride = width + 2 * margin;
        let sums = vec![0.0; BAND * (C + 1) * stride];
        Few { depth, margin, stride, sums, points: 0, rows: 0..0, columns: 0..0 }
    }

    /// Adds a sprite at pixel `(x, y)`, counted from the first of the band's `rows` rows.
    #[inline(always)]
    fn draw(&mut self, sprite: &Sprite, (x, y): (i64, i64), rows: usize, light: &Light<C>) {
        let top = y + i64::from(sprite.top);
        let end = (top + sprite.down() as i64).min(rows as i64);
        let first = top.max(0);
        if first >= end {
            return;
        }
        let left = (x + i64::from(sprite.left) + self.margin as i64) as usize;
        self.touch(first as usize..end as usize, left..left + sprite.across);
        for row in first..end {
            let (from, weights) = sprite.row((row - top) as usize);
            let row = &mut self.sums[row as usize * (C + 1) * self.stride..][..(C + 1) * self.stride];
            add(row, self.stride, left + from, weights, light);
        }
    }

    #[inline(always)]
    fn touch(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let both = |a: &Range<usize>, b: Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        (self.rows, self.columns) = match self.points {
            0 => (rows, columns),
            _ => (both(&self.rows, rows), both(&self.columns, columns)),
        };
        self.points += 1;
    }

    /// Adds them to the rows of the targets, and begins anew.
    #[inline(always)]
    fn add_to(&mut self, out: &mut [f32], width: usize) {
        let of_layer = C + 1;
        let inside = self.columns.start.max(self.margin)..self.columns.end.min(self.margin + width);
        for row in std::mem::take(&mut self.rows) {
            for plane in 0..of_layer {
                let sums = &mut self.sums[(row * of_layer + plane) * self.stride..][..self.stride];
                if !inside.is_empty() {
                    let first = ((2 * row + self.depth as usize) * of_layer + plane) * width;
                    let out = &mut out[first + inside.start - self.margin..][..inside.len()];
                    for (out, sum) in out.iter_mut().zip(&sums[inside.clone()]) {
                        *out += sum;
                    }
                }
                sums[self.columns.clone()].fill(0.0);
            }
        }
        self.points = 0;
    }
}

/// Adds a row of weights from column `at` on to each plane of a row, times the light that it has there.
#[inline(always)]
fn add<const C: usize>(
    row: &mut [f32],
    stride: usize,
    at: usize,
    weights: &[[f32; LANES]],
    light: &Light<C>,
) {
    for (i, weights) in weights.iter().enumerate() {
        for c in 0..=C {
            let value = if c < C { light.color[c] } else { light.coverage };
            let sums = row[c * stride + at + i * LANES..].first_chunk_mut::<LANES>();
            let sums = sums.expect("rows have a margin as wide as a sprite");
            for i in 0..LANES {
                sums[i] += value * weights[i];
            }
        }
    }
}
