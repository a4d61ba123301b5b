//! The light around pixels in front, which shows past them.

use super::light::Light;
use super::list::List;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::simd::Simd;
use rayon::prelude::*;

/// Number of rows after which the sums begin anew.
const BAND: usize = 64;

/// Everything that is not in front, as sums over rectangles that start at the first pixel of a band of rows (a
/// summed-area table).
pub struct Surroundings<const C: usize> {
    size: Size,
    /// Colours and a number of pixels for every corner of a band's pixels, one more than there are pixels along each
    /// axis. They are `f64`, so that a bright pixel does not drown the pixels after it. Empty if no pixel in front
    /// needs them.
    sums: Buffer<f64>,
}

/// Half the side of the square whose area is that of a disc.
fn half_side(radius: f32) -> f64 {
    f64::from(radius) * std::f64::consts::PI.sqrt() / 2.0
}

/// The interval that the square around pixel `at` of `n` covers.
fn ends(at: usize, half: f64, n: usize) -> [f64; 2] {
    let centre = at as f64 + 0.5;
    [(centre - half).max(0.0), (centre + half).min(n as f64)]
}

impl<const C: usize> Surroundings<C> {
    /// Sums of an interleaved picture without the light that this list has in front.
    pub fn new(picture: &[f32], size: Size, list: &List, simd: Simd, cancel: &Cancel) -> Result<Self> {
        let mut asked = vec![false; size.height.div_ceil(BAND)];
        for (y, points) in list.rows.iter().enumerate() {
            if let Some(largest) = points.iter().map(|point| point.radius_px).reduce(f32::max) {
                let [top, bottom] = ends(y, half_side(largest), size.height);
                asked[top as usize / BAND..(bottom.ceil() as usize).div_ceil(BAND)].fill(true);
            }
        }
        let (row, across) = (size.width * C, (size.width + 1) * (C + 1));
        let mut sums = Buffer::unset(asked.len() * (BAND + 1) * across);
        let bands = sums.par_chunks_mut((BAND + 1) * across).zip(picture.par_chunks(BAND * row)).zip(asked);
        bands.enumerate().filter(|(_, (_, asked))| *asked).try_for_each_init(
            || vec![0.0; size.width],
            |rest, (band, ((sums, picture), _))| {
                cancel.check()?;
                sums[..across].fill(0.0);
                for (i, pixels) in picture.chunks_exact(row).enumerate() {
                    rest.fill(1.0);
                    let points = &list.rows[band * BAND + i];
                    points.iter().for_each(|point| rest[point.column as usize] = 1.0 - point.drawn);
                    let (above, own) = sums[i * across..][..2 * across].split_at_mut(across);
                    simd.run(
                        #[inline(always)]
                        || add_row::<C>(pixels, rest, above, own),
                    );
                }
                Ok(())
            },
        )?;
        Ok(Surroundings { size, sums })
    }

    /// The mean over the square around pixel `(x, y)` with the area of a disc: the light, and how much of it is seen.
    pub fn around(&self, x: usize, y: usize, radius: f32) -> Light<C> {
        let half = half_side(radius);
        let (xs, ys) = (ends(x, half, self.size.width), ends(y, half, self.size.height));
        let area = (xs[1] - xs[0]) * (ys[1] - ys[0]);
        let mut sum = Sum { color: [0.0; C], pixels: 0.0 };
        for band in ys[0] as usize / BAND..(ys[1].ceil() as usize).div_ceil(BAND) {
            let [top, bottom] = ys.map(|y| (y - (band * BAND) as f64).clamp(0.0, BAND as f64));
            for (sign, x, y) in
                [(1.0, xs[1], bottom), (-1.0, xs[0], bottom), (-1.0, xs[1], top), (1.0, xs[0], top)]
            {
                self.add_up_to(band, x, y, sign / area, &mut sum);
            }
        }
        // Differences of sums leave a rounding error where nothing is seen.
        if sum.pixels > 1e-9 {
            Light { color: sum.color.map(|v| v as f32), coverage: sum.pixels as f32 }
        } else {
            Light::NONE
        }
    }

    /// Adds the sum up to a point between the corners of a band's pixels.
    #[inline(always)]
    fn add_up_to(&self, band: usize, x: f64, y: f64, weight: f64, sum: &mut Sum<C>) {
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        for (down, wy) in [(0, 1.0 - fy), (1, fy)] {
            for (right, wx) in [(0, 1.0 - fx), (1, fx)] {
                // There is no corner past the last one; its weight would be 0.
                let w = weight * wx * wy;
                if w != 0.0 {
                    let row = band * (BAND + 1) + row + down;
                    let corner = row * (self.size.width + 1) + column + right;
                    let corner = &self.sums[corner * (C + 1)..][..C + 1];
                    for c in 0..C {
                        sum.color[c] += w * corner[c];
                    }
                    sum.pixels += w * corner[C];
                }
            }
        }
    }
}

/// The light of some pixels, and their number.
struct Sum<const C: usize> {
    color: [f64; C],
    pixels: f64,
}

/// Computes the sums at the corners below a row of pixels from those `above` it; `rest` is the part of a pixel that
/// is not in front.
#[inline(always)]
fn add_row<const C: usize>(pixels: &[f32], rest: &[f32], above: &[f64], out: &mut [f64]) {
    out[..C + 1].fill(0.0);
    let mut sum = Sum { color: [0.0; C], pixels: 0.0 };
    let (above, out) = (above.chunks_exact(C + 1).skip(1), out.chunks_exact_mut(C + 1).skip(1));
    for (((pixel, &rest), above), out) in pixels.as_chunks::<C>().0.iter().zip(rest).zip(above).zip(out) {
        for c in 0..C {
            sum.color[c] += f64::from(rest) * f64::from(pixel[c]);
            out[c] = above[c] + sum.color[c];
        }
        sum.pixels += f64::from(rest);
        out[C] = above[C] + sum.pixels;
    }
}
