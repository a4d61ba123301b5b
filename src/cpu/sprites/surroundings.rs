//! What is seen around what lies in front.

use super::light::Light;
use super::list::List;
use crate::cancel::Cancel;
use crate::cpu::simd::Simd;
use crate::error::Result;
use crate::picture::Size;
use rayon::prelude::*;

/// Rows that sums run through before they begin anew.
const BAND: usize = 64;

/// Light of pixels, and how many these are. `f64`, so that a bright pixel does not drown what lies behind it.
#[derive(Clone, Copy)]
#[repr(C)]
struct Sum<const C: usize> {
    color: [f64; C],
    pixels: f64,
}

impl<const C: usize> Sum<C> {
    const NONE: Self = Sum { color: [0.0; C], pixels: 0.0 };

    /// Adds so many times other light.
    #[inline(always)]
    fn add(&mut self, weight: f64, other: &Sum<C>) {
        for c in 0..C {
            self.color[c] += weight * other.color[c];
        }
        self.pixels += weight * other.pixels;
    }
}

/// What is not in front, as sums over rectangles from the first pixel of a band of rows on.
pub struct Surroundings<const C: usize> {
    size: Size,
    /// Of each band: corners of pixels, one more than there are pixels along each axis; none where nothing asks.
    bands: Vec<Vec<Sum<C>>>,
}

/// Half the side of the square that is as large as a disc.
fn half_side(radius: f32) -> f64 {
    f64::from(radius) * std::f64::consts::PI.sqrt() / 2.0
}

/// From where to where the square around pixel `at` of `n` goes.
fn ends(at: usize, half: f64, n: usize) -> [f64; 2] {
    let centre = at as f64 + 0.5;
    [(centre - half).max(0.0), (centre + half).min(n as f64)]
}

impl<const C: usize> Surroundings<C> {
    /// Sums of an interleaved picture, but for what this list has in front.
    pub fn new(picture: &[f32], size: Size, list: &List, simd: Simd, cancel: &Cancel) -> Result<Self> {
        let mut asked = vec![false; size.height.div_ceil(BAND)];
        for (y, points) in list.rows.iter().enumerate() {
            if let Some(largest) = points.iter().map(|point| point.radius_px).reduce(f32::max) {
                let [top, bottom] = ends(y, half_side(largest), size.height);
                asked[top as usize / BAND..(bottom.ceil() as usize).div_ceil(BAND)].fill(true);
            }
        }
        let row = size.width * C;
        let bands = asked.into_par_iter().zip(picture.par_chunks(BAND * row)).enumerate().map_init(
            || vec![0.0; size.width],
            |rest, (band, (asked, picture))| {
                cancel.check()?;
                if !asked {
                    return Ok(Vec::new());
                }
                let across = size.width + 1;
                let mut sums = vec![Sum::NONE; across * (picture.len() / row + 1)];
                for (i, pixels) in picture.chunks_exact(row).enumerate() {
                    rest.fill(1.0);
                    let points = &list.rows[band * BAND + i];
                    points.iter().for_each(|p| rest[p.column as usize] = 1.0 - p.drawn);
                    let (above, own) = sums[i * across..][..2 * across].split_at_mut(across);
                    simd.run(
                        #[inline(always)]
                        || add_row::<C>(pixels, rest, above, own),
                    );
                }
                Ok(sums)
            },
        );
        Ok(Surroundings { size, bands: bands.collect::<Result<_>>()? })
    }

    /// The mean over the square around pixel `(x, y)` that is as large as a disc: what is seen, and how much of it.
    pub fn around(&self, x: usize, y: usize, radius: f32) -> Light<C> {
        let half = half_side(radius);
        let (xs, ys) = (ends(x, half, self.size.width), ends(y, half, self.size.height));
        let area = (xs[1] - xs[0]) * (ys[1] - ys[0]);
        let mut sum = Sum::NONE;
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
        let (sums, across) = (&self.bands[band], self.size.width + 1);
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        for (down, wy) in [(0, 1.0 - fy), (1, fy)] {
            for (right, wx) in [(0, 1.0 - fx), (1, fx)] {
                let w = weight * wx * wy;
                // At the last corner there is no next one, and its weight is 0.
                let corner = (row + down).min(sums.len() / across - 1) * across
                    + (column + right).min(self.size.width);
                sum.add(w, &sums[corner]);
            }
        }
    }
}

/// Sums up to the corners below a row of pixels, of which some part is the `rest`, from those `above` it.
#[inline(always)]
fn add_row<const C: usize>(pixels: &[f32], rest: &[f32], above: &[Sum<C>], out: &mut [Sum<C>]) {
    let mut sum = Sum::NONE;
    let pixels = pixels.as_chunks::<C>().0;
    for (((pixel, &rest), above), out) in pixels.iter().zip(rest).zip(&above[1..]).zip(&mut out[1..]) {
        for c in 0..C {
            sum.color[c] += f64::from(rest) * f64::from(pixel[c]);
        }
        sum.pixels += f64::from(rest);
        *out = sum;
        out.add(1.0, above);
    }
}
