//! The half-size target into which the sprites of one layer are drawn.

use super::light::Light;
use super::list::{Image, List};
use super::stamp::{QUAD, Stamp};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::mirror::mirrored;
use crate::picture::{Layer, Size};
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Number of rows of the target that one worker fills at a time.
const BAND: usize = 16;

/// Number of points that are summed up separately before they are added to the others. A small contribution loses
/// more precision when it is added to the sum of thousands than to the sum of a few.
const FEW: usize = 1024;

/// The light of one layer at half the size.
pub struct Target<const C: usize> {
    width: usize,
    height: usize,
    light: Vec<Light<C>>,
}

impl<const C: usize> Target<C> {
    /// Draws a whole list, and its mirror images beyond the border.
    pub fn new(list: &List, layer: &Layer, size: Size, simd: Simd, cancel: &Cancel) -> Result<Self> {
        let (width, height) = (size.width.div_ceil(2), size.height.div_ceil(2));
        let reach = list.reach as i64;
        let images = Image::all(size.width, list.reach);
        let mut light = vec![Light::NONE; width * height];
        let bands = light.par_chunks_mut(BAND * width).enumerate();
        bands.try_for_each_init(
            || Few::new(width, list.reach),
            |few, (i, out)| {
                let (first, rows) = (i * BAND, out.len() / width);
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
                                    let at = row * size.width + point.column as usize;
                                    let light = Light::of(layer, size, at, point.drawn);
                                    let stamp = list.stamp(point, (x, y));
                                    few.draw(stamp, (x >> 1, (y >> 1) - first as i64), &light, out);
                                }
                            }
                        },
                    );
                }
                few.add_to(out);
                Ok(())
            },
        )?;
        Ok(Target { width, height, light })
    }

    /// A row for [`Target::between`].
    pub fn new_row(&self) -> Vec<Light<C>> {
        vec![Light::NONE; self.width + 2]
    }

    /// Interpolates between two rows at the picture's row `y`, repeating the pixels at both ends. Returns whether
    /// there is any light.
    #[inline(always)]
    pub fn between(&self, y: usize, out: &mut [Light<C>]) -> bool {
        let (from, fraction) = around(y);
        let [above, below] = [0, 1].map(|i| {
            let row = mirrored((from + i) as i64 - 1, self.height).0;
            &self.light[row * self.width..][..self.width]
        });
        let mut most = 0.0;
        for ((out, above), below) in out[1..].iter_mut().zip(above).zip(below) {
            *out = above.mix(below, fraction);
            most = if out.coverage > most { out.coverage } else { most };
        }
        (out[0], out[self.width + 1]) = (out[1], out[self.width]);
        most > 0.0
    }
}

/// The light at column `x` of the picture, from a row of [`Target::between`].
#[inline(always)]
pub fn light_at<const C: usize>(row: &[Light<C>], x: usize) -> Light<C> {
    let (from, fraction) = around(x);
    row[from].mix(&row[from + 1], fraction)
}

/// The pixel of the target before a pixel of the picture, counted from the one before the first, and the distance of
/// the picture's pixel from its centre, in pixels of the target.
#[inline(always)]
fn around(at: usize) -> (usize, f32) {
    (at.div_ceil(2), if at.is_multiple_of(2) { 0.75 } else { 0.25 })
}

/// The light of a few points over a band of rows, with more columns on either side for sprites that extend past it.
struct Few<const C: usize> {
    width: usize,
    margin: usize,
    stride: usize,
    sums: Vec<Light<C>>,
    /// The number of these points, and the rows and columns that they touch.
    points: usize,
    rows: Range<usize>,
    columns: Range<usize>,
}

impl<const C: usize> Few<C> {
    fn new(width: usize, reach: usize) -> Self {
        // A sprite drawn outside begins and ends within its reach.
        let margin = reach + QUAD;
        let stride = width + 2 * margin;
        let sums = vec![Light::NONE; BAND * stride];
        Few { width, margin, stride, sums, points: 0, rows: 0..0, columns: 0..0 }
    }

    /// Draws at column `x` and row `y` of the band `out`.
    #[inline(always)]
    fn draw(&mut self, stamp: &Stamp, (x, y): (i64, i64), light: &Light<C>, out: &mut [Light<C>]) {
        let rows = stamp.touches(y, out.len() / self.width);
        if rows.is_empty() {
            return;
        }
        if self.points == FEW {
            self.add_to(out);
        }
        let x = x + self.margin as i64;
        let columns = stamp.columns(x);
        let columns = columns.start as usize..columns.end as usize;
        let both = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        (self.rows, self.columns) = match self.points {
            0 => (rows.clone(), columns),
            _ => (both(&self.rows, &rows), both(&self.columns, &columns)),
        };
        self.points += 1;
        stamp.draw((x, y), rows, light, self.stride, &mut self.sums);
    }

    /// Adds them to the band, and starts again from zero.
    #[inline(always)]
    fn add_to(&mut self, out: &mut [Light<C>]) {
        let inside = self.columns.start.max(self.margin)..self.columns.end.min(self.margin + self.width);
        for row in std::mem::take(&mut self.rows) {
            let sums = &mut self.sums[row * self.stride..][..self.stride];
            let out = &mut out[row * self.width..][..self.width];
            for x in inside.clone() {
                out[x - self.margin].add(1.0, &sums[x]);
            }
            sums[self.columns.clone()].fill(Light::NONE);
        }
        self.points = 0;
    }
}
