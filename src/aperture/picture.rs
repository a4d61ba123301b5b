//! An opening given by a picture of its transmission.

use crate::error::{Result, value_error};
use std::f64::consts::PI;

/// The least number of texels along each side: enough that the texels on the rim hardly matter.
const TEXELS: usize = 256;
/// Number of positions along each side of a texel that are tested for lying inside the lens.
const FINE: usize = 4;

/// Transmission over the square around the unit circle, constant over each texel. A lens is round, so the part of the
/// picture outside the circle is cut off.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    columns: usize,
    rows: usize,
    /// Light through each texel.
    light: Vec<f64>,
    /// Light above and to the left of each texel's corner (a summed-area table); one more row and column than texels.
    sums: Vec<f64>,
}

impl Picture {
    /// Rows of `columns` transmissions, finite and not negative; only their ratios matter.
    pub fn new(columns: usize, values: &[f64]) -> Result<Picture> {
        if columns == 0 || values.is_empty() {
            return Err(value_error!("image must have at least one row and one column; got none"));
        }
        if let Some(v) = values.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return Err(value_error!("image must hold transmissions, finite and not negative; got {v}"));
        }
        let given = [columns, values.len() / columns];
        // Number of texels that replace each given one, along each axis.
        let finer = given.map(|n| TEXELS.div_ceil(n));
        let [columns, rows] = [given[0] * finer[0], given[1] * finer[1]];
        let greatest = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let mut light = vec![0.0; columns * rows];
        for (i, light) in light.iter_mut().enumerate() {
            let (x, y) = (i % columns, i / columns);
            let v = values[y / finer[1] * given[0] + x / finer[0]];
            *light = v / greatest * share_in_lens([columns, rows], [x, y]);
        }
        if light.iter().all(|v| *v == 0.0) {
            return Err(value_error!(
                "image must let light through somewhere in the circle that fills it; got only zeros there"
            ));
        }
        let mut sums = vec![0.0; (columns + 1) * (rows + 1)];
        for y in 0..rows {
            let mut row = 0.0;
            for x in 0..columns {
                row += light[y * columns + x];
                sums[(y + 1) * (columns + 1) + x + 1] = sums[y * (columns + 1) + x + 1] + row;
            }
        }
        Ok(Picture { columns, rows, light, sums })
    }

    /// Light above and to the left of a position. Between the corners of texels it is bilinear.
    fn sum(&self, [x, y]: [f64; 2]) -> f64 {
        let along = |v: f64, n: usize| {
            let v = (0.5 * (v + 1.0)).clamp(0.0, 1.0) * n as f64;
            let i = (v as usize).min(n - 1);
            (i, v - i as f64)
        };
        let ((x, fx), (y, fy)) = (along(x, self.columns), along(y, self.rows));
        let row = |y: usize| {
            let at = y * (self.columns + 1) + x;
            self.sums[at] + fx * (self.sums[at + 1] - self.sums[at])
        };
        row(y) + fy * (row(y + 1) - row(y))
    }

    /// Light that passes the box between two positions.
    pub fn between(&self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> f64 {
        let light = self.sum([x1, y1]) - self.sum([x0, y1]) - self.sum([x1, y0]) + self.sum([x0, y0]);
        // Differences of sums leave a rounding error where no light passes.
        if light.abs() < 1e-12 * self.sums[self.sums.len() - 1] { 0.0 } else { light }
    }

    /// The number of texels.
    pub fn texels(&self) -> f64 {
        (self.columns * self.rows) as f64
    }

    /// Area, relative to that of the unit disc, of a clear opening that spreads as much light as evenly: the square
    /// of the light over its squares.
    pub fn relative_area(&self) -> f64 {
        let (sum, squares) = self.light.iter().fold((0.0, 0.0), |(a, b), v| (a + v, b + v * v));
        let texel = 4.0 / (self.columns * self.rows) as f64;
        sum * sum / squares * texel / PI
    }

    /// The position before which the fraction `u` of all light lies, by rows, and the fraction `v` of its row's, by
    /// columns.
    pub fn place(&self, u: f64, v: f64) -> [f64; 2] {
        let across = self.columns + 1;
        let total = self.sums[self.sums.len() - 1];
        let last_of_row = |y: usize| self.sums[(y + 1) * across - 1];
        let (y, fy) = before(self.rows, last_of_row, u * total);
        let in_row = |x: usize| self.sums[(y + 1) * across + x] - self.sums[y * across + x];
        let (x, fx) = before(self.columns, in_row, v * in_row(self.columns));
        let at = |i: usize, f: f64, n: usize| 2.0 * (i as f64 + f) / n as f64 - 1.0;
        let place = [at(x, fx, self.columns), at(y, fy, self.rows)];
        // The position may be in a corner of a texel that the circle cuts off.
        let beyond = place[0].hypot(place[1]).max(1.0);
        place.map(|v| v / beyond)
    }
}

/// The step of a rising sum at which it reaches `wanted`, and the fraction of that step.
fn before(n: usize, sum: impl Fn(usize) -> f64, wanted: f64) -> (usize, f64) {
    let (mut lo, mut hi) = (0, n);
    while hi - lo > 1 {
        let middle = (lo + hi) / 2;
        if sum(middle) <= wanted { lo = middle } else { hi = middle }
    }
    let step = sum(lo + 1) - sum(lo);
    (lo, if step > 0.0 { ((wanted - sum(lo)) / step).clamp(0.0, 1.0) } else { 0.5 })
}

/// The part of a texel that is inside the unit circle.
fn share_in_lens([columns, rows]: [usize; 2], [x, y]: [usize; 2]) -> f64 {
    let at =
        |i: usize, k: usize, n: usize| 2.0 * (i as f64 + (k as f64 + 0.5) / FINE as f64) / n as f64 - 1.0;
    let inside = |k: &usize| at(x, k % FINE, columns).hypot(at(y, k / FINE, rows)) <= 1.0;
    (0..FINE * FINE).filter(inside).count() as f64 / (FINE * FINE) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_hold_the_light_of_their_texels() {
        let picture = Picture::new(2, &[0.0, 1.0, 2.0, 4.0]).unwrap();
        // A quarter of the disc, and a square well inside it, in texels of the greatest transmission, 4.
        let light = |a, b| picture.between(a, b) * 4.0 / picture.texels();
        assert!((light([-1.0, -1.0], [1.0, 1.0]) - 7.0 / 4.0 * PI / 4.0).abs() < 1e-4);
        assert!((light([0.0, -0.5], [0.5, 0.0]) - 0.25 * 0.25).abs() < 1e-12);
        assert_eq!(light([-1.0, -1.0], [0.0, 0.0]), 0.0);
    }

    #[test]
    fn places_fall_where_the_light_is() {
        let picture = Picture::new(3, &[0.0, 0.0, 0.0, 0.0, 1.0, 3.0]).unwrap();
        let n = 4000;
        let places: Vec<_> = (0..n)
            .map(|i| picture.place((i as f64 + 0.5) / n as f64, (i as f64 * 0.618_033_988_75).fract()))
            .collect();
        assert!(places.iter().all(|p| p[1] >= 0.0 && p[0] >= -0.334 && p[0].hypot(p[1]) <= 1.0 + 1e-12));
        let middle = places.iter().filter(|p| p[0] < 1.0 / 3.0).count() as f64 / n as f64;
        let light = |from: f64, to: f64| picture.between([from, 0.0], [to, 1.0]);
        let expected = light(-1.0 / 3.0, 1.0 / 3.0) / light(-1.0, 1.0);
        assert!((middle - expected).abs() < 2e-3, "{middle} against {expected}");
    }

    #[test]
    fn dark_pictures_are_refused() {
        for (columns, values) in [(1, vec![0.0]), (1, vec![-1.0]), (2, vec![]), (1, vec![f64::NAN])] {
            assert!(Picture::new(columns, &values).unwrap_err().to_string().starts_with("image"));
        }
    }
}
