//! The frame with a mirrored margin as wide as the largest circle of confusion, so that no ray leaves it.

use crate::mirror::mirrored;
use crate::scene::grid::{BLOCK, TILE};

/// The padded frame.
#[derive(Debug, Clone, Copy)]
pub struct Padding {
    pub width: usize,
    pub height: usize,
    /// Mirrored pixels on every side; a multiple of [`BLOCK`].
    pub pad: usize,
    /// Cells from one padded row to the next; a multiple of [`BLOCK`].
    pub stride: usize,
    /// Number of padded rows.
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

    /// The frame column that padded column `px` shows, and whether it is mirrored.
    pub fn column(&self, px: usize) -> (usize, bool) {
        mirrored(px as i64 - self.pad as i64, self.width)
    }

    /// The frame row that padded row `py` shows, and whether it is mirrored.
    pub fn row(&self, py: usize) -> (usize, bool) {
        mirrored(py as i64 - self.pad as i64, self.height)
    }

    /// The padded columns that show frame column `x`, and whether they are mirrored.
    pub fn columns_of(&self, x: usize) -> impl Iterator<Item = (usize, bool)> {
        images(x, self.width, self.pad, self.stride)
    }
}

/// The positions that show element `i` when `n` elements are extended by `pad` in front and to `extent` in total.
pub fn images(i: usize, n: usize, pad: usize, extent: usize) -> impl Iterator<Item = (usize, bool)> {
    // The extension repeats with period 2 n; each period holds the element and its mirror image.
    let (i, n, pad) = (i as i64, n as i64, pad as i64);
    let first = -(pad / (2 * n)) - 1;
    let last = (extent as i64 - pad) / (2 * n) + 1;
    (first..=last)
        .flat_map(move |period| [(2 * n * period + i, false), (2 * n * period - 1 - i, true)])
        .map(move |(at, flipped)| (at + pad, flipped))
        .filter(move |(at, _)| (0..extent as i64).contains(at))
        .map(|(at, flipped)| (at as usize, flipped))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_where_the_mirror_shows_them() {
        for (n, pad, extent) in [(3, 8, 20), (5, 2, 9), (1, 4, 9), (40, 16, 96)] {
            for i in 0..n {
                let mut found: Vec<_> = images(i, n, pad, extent).collect();
                found.sort_unstable();
                let shows = |at: usize| mirrored(at as i64 - pad as i64, n);
                let expected: Vec<_> =
                    (0..extent).filter(|&at| shows(at).0 == i).map(|at| (at, shows(at).1)).collect();
                assert_eq!(found, expected);
            }
        }
    }
}
