//! The frame with a mirrored margin as wide as the largest circle of confusion, so that no ray leaves it. Mirror images of
//! mirror images are not laid out again.

use crate::mirror::mirrored;
use crate::scene::grid::{BLOCK, TILE};

/// How far beyond its border the frame is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Margin {
    /// As far as any ray goes.
    Reach,
    /// As far as any ray goes, or until the mirror images repeat: then [`Padding::inside`] tells where they do.
    Period,
}

/// The padded frame.
#[derive(Debug, Clone, Copy)]
pub struct Padding {
    pub width: usize,
    pub height: usize,
    /// Mirrored columns and rows on every side; multiples of [`BLOCK`].
    pub pad: [usize; 2],
    /// Cells from one padded row to the next; a multiple of [`BLOCK`].
    pub stride: usize,
    /// Number of padded rows.
    pub rows: usize,
    /// After how many columns and rows mirror images repeat, where those of images are not laid out again.
    pub periods: [Option<usize>; 2],
}

impl Padding {
    pub fn new(width: usize, height: usize, reach_px: f64, margin: Margin) -> Padding {
        let reach = reach_px.ceil() as usize + 2;
        let whole = [width.next_multiple_of(TILE.0), height.next_multiple_of(TILE.1)];
        // The mirror images repeat after twice the frame. A tile at any place of such a period is inside.
        let enough = |i: usize| {
            let extent = 2 * [width, height][i] + [TILE.0, TILE.1][i];
            extent.saturating_sub(whole[i]).div_ceil(2)
        };
        let repeats = [0, 1].map(|i| margin == Margin::Period && reach > enough(i));
        let pad = [0, 1].map(|i| if repeats[i] { enough(i) } else { reach }.next_multiple_of(BLOCK));
        let periods = [0, 1].map(|i| repeats[i].then_some(2 * [width, height][i]));
        Padding { width, height, pad, stride: whole[0] + 2 * pad[0], rows: whole[1] + 2 * pad[1], periods }
    }

    /// The cell that shows the same as `cell` from each pixel of the tile at `origin`, and is inside the padded frame: one
    /// whole period of mirror images farther to some side, or several, where `cell` is not inside itself.
    #[inline(always)]
    pub fn inside(&self, origin: (usize, usize), cell: [i32; 2]) -> [i32; 2] {
        let along = |i: usize, origin: usize, last: usize| {
            let first = (origin + self.pad[i]) as i32;
            match self.periods[i] {
                Some(period) if !(0..=last as i32).contains(&(first + cell[i])) => {
                    (first + cell[i]).rem_euclid(period as i32) - first
                }
                _ => cell[i],
            }
        };
        [along(0, origin.0, self.stride - TILE.0), along(1, origin.1, self.rows - TILE.1)]
    }

    /// Index of pixel `(x, y)` of the frame in the padded arrays.
    pub fn index(&self, x: usize, y: usize) -> usize {
        (y + self.pad[1]) * self.stride + x + self.pad[0]
    }

    /// The frame column that padded column `px` shows, and whether it is mirrored.
    pub fn column(&self, px: usize) -> (usize, bool) {
        mirrored(px as i64 - self.pad[0] as i64, self.width)
    }

    /// The frame row that padded row `py` shows, and whether it is mirrored.
    pub fn row(&self, py: usize) -> (usize, bool) {
        mirrored(py as i64 - self.pad[1] as i64, self.height)
    }

    /// The padded columns that show frame column `x`, and whether they are mirrored.
    pub fn columns_of(&self, x: usize) -> impl Iterator<Item = (usize, bool)> {
        images(x, self.width, self.pad[0], self.stride)
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
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cells_inside_show_the_same(
            size in (1usize..300, 1usize..300),
            tile in (0.0..1.0f64, 0.0..1.0f64),
            cell in (-16384i32..=16384, -16384i32..=16384),
            reach in 0.0..16384.0f64,
        ) {
            let padding = Padding::new(size.0, size.1, reach, Margin::Period);
            let cell = [cell.0, cell.1].map(|c| c.clamp(-reach as i32 - 1, reach as i32 + 1));
            let place = |share: f64, n: usize, tile: usize| (share * n.div_ceil(tile) as f64) as usize * tile;
            let origin = (place(tile.0, size.0, TILE.0), place(tile.1, size.1, TILE.1));
            let [dx, dy] = padding.inside(origin, cell);
            let shown = |first: usize, by: i32, n: usize| mirrored(first as i64 + i64::from(by), n);
            for (x, y) in [(0, 0), (TILE.0 - 1, TILE.1 - 1)] {
                prop_assert_eq!(shown(origin.0 + x, dx, size.0), shown(origin.0 + x, cell[0], size.0));
                prop_assert_eq!(shown(origin.1 + y, dy, size.1), shown(origin.1 + y, cell[1], size.1));
                let at = |first: usize, by: i32, pad: usize| (first + pad) as i64 + i64::from(by);
                prop_assert!((0..padding.stride as i64).contains(&at(origin.0 + x, dx, padding.pad[0])));
                prop_assert!((0..padding.rows as i64).contains(&at(origin.1 + y, dy, padding.pad[1])));
            }
            let reaches_all = Padding::new(size.0, size.1, reach, Margin::Reach);
            prop_assert_eq!(reaches_all.inside(origin, cell), cell);
            prop_assert!(padding.stride <= 2 * size.0 + 3 * TILE.0 && padding.rows <= 2 * size.1 + 3 * TILE.1);
        }
    }

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
