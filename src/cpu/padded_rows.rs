//! Rows of a picture with a mirrored margin, for filters.

use crate::mirror::mirrored;
use crate::picture::Size;

/// Number of columns that filters process together, large enough for the compiler to vectorise the loops. Rows of a
/// window hold whole blocks.
pub const BLOCK: usize = 64;

/// Some rows of planes with a mirrored margin around them, so that a filter can read around any pixel without bounds
/// tests. It is small enough to stay in a worker's cache, and is refilled for one band of rows after another.
pub struct PaddedRows {
    size: Size,
    margin: usize,
    /// Distance from one row to the next.
    pub stride: usize,
    /// Distance from one plane to the next.
    area: usize,
    /// The first row of the frame in the window, not counting the margin.
    first: usize,
    values: Vec<f32>,
    /// Positions of a row outside the frame, each with the position whose mirror image it is.
    beyond: Vec<(usize, usize)>,
}

impl PaddedRows {
    /// A window for `size.channels` planes, up to `rows` rows of a frame, and a margin of at least `margin` pixels.
    pub fn new(size: Size, rows: usize, margin: usize) -> PaddedRows {
        let stride = size.width.next_multiple_of(BLOCK) + 2 * margin;
        let area = (rows + 2 * margin) * stride;
        let beyond = (0..margin)
            .chain(margin + size.width..stride)
            .map(|px| (px, margin + mirrored(px as i64 - margin as i64, size.width).0))
            .collect();
        PaddedRows { size, margin, stride, area, first: 0, values: vec![0.0; size.channels * area], beyond }
    }

    /// Moves the window to `rows` rows starting at `first`; `read(plane, y, row)` reads a row of the frame.
    pub fn fill(&mut self, first: usize, rows: usize, read: impl Fn(usize, usize, &mut [f32])) {
        self.first = first;
        for (plane, values) in self.values.chunks_mut(self.area).enumerate() {
            for (i, out) in values.chunks_mut(self.stride).take(rows + 2 * self.margin).enumerate() {
                let y = mirrored((first + i) as i64 - self.margin as i64, self.size.height).0;
                read(plane, y, &mut out[self.margin..][..self.size.width]);
                for &(px, source) in &self.beyond {
                    out[px] = out[source];
                }
            }
        }
    }

    /// One plane.
    #[inline(always)]
    pub fn plane(&self, i: usize) -> &[f32] {
        &self.values[i * self.area..][..self.area]
    }

    /// A block of the first `C` planes, starting at index `at`.
    #[inline(always)]
    pub fn blocks<const C: usize, const N: usize>(&self, at: usize) -> [[f32; N]; C] {
        let mut out = [[0.0; N]; C];
        for c in 0..C {
            out[c] = *block(self.plane(c), at);
        }
        out
    }

    /// Index of pixel `(x, y)` of the frame in a plane.
    #[inline(always)]
    pub fn index(&self, x: usize, y: usize) -> usize {
        (y - self.first + self.margin) * self.stride + x + self.margin
    }
}

/// A block of a plane, starting at index `at`; no longer than [`BLOCK`].
#[inline(always)]
pub fn block<const N: usize>(plane: &[f32], at: usize) -> &[f32; N] {
    plane[at..].first_chunk().expect("rows of a window hold whole blocks")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_continue_the_picture_as_its_mirror_image() {
        let size = Size { width: 3, height: 5, channels: 2 };
        let mut window = PaddedRows::new(size, 2, 7);
        for (first, rows) in [(2, 2), (4, 1)] {
            window.fill(first, rows, |plane, y, row| {
                row.iter_mut().enumerate().for_each(|(x, v)| *v = (100 * plane + 10 * y + x) as f32);
            });
            for (plane, y) in (0..2).flat_map(|plane| (first..first + rows).map(move |y| (plane, y))) {
                for (dy, dx) in (-7..8).flat_map(|dy| (-7..10).map(move |dx| (dy, dx))) {
                    let at = window.index(0, y) as i64 + dy * window.stride as i64 + dx;
                    let expected = 100 * plane + 10 * mirrored(y as i64 + dy, 5).0 + mirrored(dx, 3).0;
                    assert_eq!(window.plane(plane)[at as usize], expected as f32, "{plane} {y} {dy} {dx}");
                }
            }
        }
    }
}
