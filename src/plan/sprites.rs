//! Blurred pixels drawn as sprites in the shape of the opening.
//!
//! After "Geometry-Shader-Free Bokeh Depth of Field Rendering" (a blog article of 2012). Pixels whose circle of
//! confusion is above a threshold are put on a list with their position, colour and circle of confusion. They are
//! drawn as quads with the aperture's texture into two accumulation targets of half the size, one for pixels in front
//! of the focus and one for pixels behind it. The targets are then resolved over the sharp picture.
//!
//! The article names two weaknesses of its resolve, which are addressed here. The layer behind leaks over sharp
//! surfaces: here only the mean of its light is shown, as colour over coverage, and only on pixels that are behind
//! the focus themselves. The layer in front has hard edges: here it is composited over the rest by its coverage, and
//! the colour behind its silhouette is the mean of everything that is not in front, over a square as large as the
//! pixel's own circle of confusion. Sprites fade in over the threshold's width instead of appearing all at once.

use crate::aperture::{Aperture, Side};
use crate::error::{Result, value_error};
use std::ops::RangeInclusive;

/// Number of steps per pixel to which radii are quantised, below and above [`SMALL_PX`].
const FINE: f64 = 16.0;
const COARSE: f64 = 4.0;
const SMALL_PX: f64 = 4.0;

/// An image with which points are drawn; it fills the square around the circle of confusion.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    width: usize,
    values: Vec<f64>,
}

impl Texture {
    /// A texture of rows of `width` transmissions.
    pub fn new(width: usize, values: Vec<f64>) -> Result<Texture> {
        if values.is_empty() || width == 0 {
            return Err(value_error!("sprite must have at least one row and one column; got none"));
        }
        if let Some(v) = values.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return Err(value_error!("sprite must hold transmissions, finite and not negative; got {v}"));
        }
        if values.iter().all(|v| *v == 0.0) {
            return Err(value_error!("sprite must let light through somewhere; got only zeros"));
        }
        Ok(Texture { width, values })
    }

    /// The part of each pixel that the texture covers when it spans `radius` pixels to either side:
    /// `(dx, dy, weight)`.
    fn weights(&self, radius: f64) -> Vec<(i32, i32, f64)> {
        let reach = (radius + 0.5).ceil() as i32;
        let height = self.values.len() / self.width;
        // The overlap of texel `i` of `n` with the pixel at `d`, as a length.
        let shared = |d: i32, i: usize, n: usize| {
            let edge = |i: usize| radius * (2.0 * i as f64 / n as f64 - 1.0);
            let (from, to) = (edge(i).max(f64::from(d) - 0.5), edge(i + 1).min(f64::from(d) + 0.5));
            (to - from).max(0.0)
        };
        let mut weights = Vec::new();
        for dy in -reach..=reach {
            let mut row = vec![0.0; self.width];
            for (y, texels) in self.values.chunks(self.width).enumerate() {
                let down = shared(dy, y, height);
                row.iter_mut().zip(texels).for_each(|(sum, v)| *sum += down * v);
            }
            for dx in -reach..=reach {
                let weight = row.iter().enumerate().map(|(x, v)| v * shared(dx, x, self.width)).sum();
                weights.push((dx, dy, weight));
            }
        }
        weights
    }
}

/// The shape of a drawn point.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// The opening of the lens.
    Opening(Aperture),
    /// Any image.
    Texture(Texture),
}

/// The choices of the caller.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    shape: Shape,
    threshold_px: f64,
    max_coc_px: f64,
}

impl Settings {
    /// The default threshold.
    pub const THRESHOLD_PX: f64 = 1.0;
    /// The default limit of the radius of circles of confusion.
    pub const MAX_COC_PX: f64 = 64.0;

    /// The shape, the radius above which pixels are drawn as sprites, and the limit of the radius of circles of
    /// confusion.
    pub fn new(shape: Shape, threshold_px: f64, max_coc_px: f64) -> Result<Settings> {
        if !(threshold_px.is_finite() && threshold_px >= 0.5) {
            return Err(value_error!(
                "coc_threshold_px must be a radius in pixels of at least 0.5; got {threshold_px}"
            ));
        }
        if !(1.0..=256.0).contains(&max_coc_px) {
            return Err(value_error!(
                "max_coc_px must be a radius in pixels from 1 to 256; got {max_coc_px}"
            ));
        }
        Ok(Settings { shape, threshold_px, max_coc_px })
    }

    /// The radius above which pixels are drawn as sprites.
    pub fn threshold_px(&self) -> f64 {
        self.threshold_px
    }

    /// The limit of the radius of circles of confusion.
    pub fn max_coc_px(&self) -> f64 {
        self.max_coc_px
    }

    /// Signed radius of the circle of confusion after limiting.
    #[inline(always)]
    pub fn cut(&self, coc_px: f64) -> f32 {
        coc_px.clamp(-self.max_coc_px, self.max_coc_px) as f32
    }

    /// The part of a pixel that is drawn as a sprite: nothing at the threshold, all of it at twice the threshold.
    #[inline(always)]
    pub fn drawn(&self, coc_px: f32) -> f32 {
        (coc_px.abs() / self.threshold_px as f32 - 1.0).clamp(0.0, 1.0)
    }

    /// The sprites of a [step] for pixels in even and odd columns, first of even rows and then of odd ones.
    pub fn sprites(&self, step: i32) -> [Sprite; 4] {
        let coc = radius(step);
        // Points in front are rotated by 180 degrees.
        let weights: Vec<(i32, i32, f64)> = match &self.shape {
            Shape::Opening(aperture) => aperture
                .kernel_on(Side::of(-coc), coc)
                .weights()
                .map(|(dx, dy, w)| (dx, dy, f64::from(w)))
                .collect(),
            Shape::Texture(texture) => {
                let turn = if coc < 0.0 { -1 } else { 1 };
                texture.weights(coc.abs()).into_iter().map(|(dx, dy, w)| (turn * dx, turn * dy, w)).collect()
            }
        };
        let total: f64 = weights.iter().map(|w| w.2).sum();
        let mut quarters = weights;
        quarters.retain(|w| w.2 > 0.0);
        quarters.iter_mut().for_each(|w| w.2 *= 0.25 / total);
        let bounds = [|w: &(i32, i32, f64)| w.0, |w: &(i32, i32, f64)| w.1].map(|of| {
            let places = quarters.iter().map(of);
            let ends = places.fold((i32::MAX, i32::MIN), |(a, b), v| (a.min(v), b.max(v)));
            ends.0..=ends.1
        });
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|odd| Sprite::new(&quarters, &bounds, odd))
    }
}

/// The step to which a radius is rounded, with its sign.
pub fn step(coc_px: f32) -> i32 {
    let (coc, r) = (f64::from(coc_px), f64::from(coc_px.abs()));
    let steps = if r < SMALL_PX { r * FINE } else { SMALL_PX * FINE + (r - SMALL_PX) * COARSE };
    steps.round().copysign(coc) as i32
}

/// The signed radius of a step.
fn radius(step: i32) -> f64 {
    let steps = f64::from(step.abs());
    let small = SMALL_PX * FINE;
    let r = if steps < small { steps / FINE } else { SMALL_PX + (steps - small) / COARSE };
    r.copysign(f64::from(step))
}

/// The contribution of one pixel to the pixels of a target of half the size.
#[derive(Debug, Clone, PartialEq)]
pub struct Sprite {
    /// First column, relative to the pixel of the target that contains the drawn pixel.
    pub left: i32,
    /// First row, likewise.
    pub top: i32,
    /// Number of weights in a row.
    pub across: usize,
    /// Row by row; their sum is a quarter, the pixel's area in the target.
    pub weights: Vec<f32>,
}

impl Sprite {
    /// The sprite of a pixel in an even (0) or odd (1) column and row. Every pixel of the target is the mean of four
    /// pixels, which is the sum of their `quarters`; these lie in the given `columns` and `rows`.
    fn new(
        quarters: &[(i32, i32, f64)],
        [columns, rows]: &[RangeInclusive<i32>; 2],
        odd: (i32, i32),
    ) -> Sprite {
        let (left, top) = ((columns.start() + odd.0) >> 1, (rows.start() + odd.1) >> 1);
        let across = (((columns.end() + odd.0) >> 1) - left + 1) as usize;
        let down = (((rows.end() + odd.1) >> 1) - top + 1) as usize;
        let mut sums = vec![0.0; across * down];
        for (dx, dy, quarter) in quarters {
            let (x, y) = (((dx + odd.0) >> 1) - left, ((dy + odd.1) >> 1) - top);
            sums[y as usize * across + x as usize] += quarter;
        }
        Sprite { left, top, across, weights: sums.into_iter().map(|w| w as f32).collect() }
    }

    /// Number of rows of the target that the sprite covers.
    pub fn down(&self) -> usize {
        self.weights.len() / self.across
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(shape: Shape) -> Settings {
        Settings::new(shape, 1.0, 64.0).unwrap()
    }

    #[test]
    fn steps_are_close_to_the_radius_they_stand_for() {
        for i in -4000..4000 {
            let coc = f64::from(i) * 0.0123;
            let error = (radius(step(coc as f32)) - coc).abs();
            assert!(error <= 0.5 / if coc.abs() < SMALL_PX { FINE } else { COARSE } + 1e-6, "{coc}: {error}");
        }
    }

    #[test]
    fn sprites_sum_to_the_area_of_their_pixel() {
        let texture = Texture::new(3, vec![0.0, 1.0, 0.5, 2.0, 0.0, 1.0]).unwrap();
        for shape in [Shape::Opening(Aperture::DISC), Shape::Texture(texture)] {
            for coc in [-20.0, -1.2, 1.0, 7.3] {
                for sprite in settings(shape.clone()).sprites(step(coc)) {
                    let sum: f32 = sprite.weights.iter().sum();
                    assert!((sum - 0.25).abs() < 1e-5, "{coc}: {sum}");
                }
            }
        }
    }

    #[test]
    fn a_texture_is_shared_among_pixels_by_area() {
        let texture = Texture::new(2, vec![1.0, 0.0]).unwrap();
        // Two pixels to either side, so that texels are two pixels wide and four high.
        let at = |dx: i32, dy: i32| {
            texture.weights(2.0).into_iter().find(|w| (w.0, w.1) == (dx, dy)).map_or(0.0, |w| w.2)
        };
        assert_eq!([at(-2, 0), at(-1, 0), at(0, 0), at(1, 0)], [0.5, 1.0, 0.5, 0.0]);
        assert_eq!([at(-1, -2), at(-1, 2), at(-1, 3)], [0.5, 0.5, 0.0]);
    }

    #[test]
    fn sprites_set_in_between_the_threshold_and_twice_that() {
        let settings = Settings::new(Shape::Opening(Aperture::DISC), 2.0, 64.0).unwrap();
        assert_eq!(
            [0.0, -2.0, 3.0, -3.0, 4.0, 90.0].map(|c| settings.drawn(c)),
            [0.0, 0.0, 0.5, 0.5, 1.0, 1.0]
        );
    }

    #[test]
    fn bad_values_are_named() {
        let disc = || Shape::Opening(Aperture::DISC);
        let text = |result: Result<Settings>| result.unwrap_err().to_string();
        assert!(text(Settings::new(disc(), 0.1, 8.0)).starts_with("coc_threshold_px"));
        assert!(text(Settings::new(disc(), 1.0, f64::NAN)).starts_with("max_coc_px"));
        for (width, values) in [(0, vec![]), (1, vec![0.0]), (1, vec![-1.0]), (2, vec![1.0, f64::NAN])] {
            assert!(Texture::new(width, values).unwrap_err().to_string().starts_with("sprite"));
        }
    }
}
