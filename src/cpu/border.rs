//! What lies beyond the border of the picture: its mirror image.

use crate::picture::Size;
use rayon::prelude::*;

/// Half-sample symmetric extension, however far out: `.. 1 0 | 0 1 2 .. n-1 | n-1 n-2 ..`. The index, and whether
/// it is a mirror image.
pub fn mirrored(i: i64, n: usize) -> (usize, bool) {
    let i = i.rem_euclid(2 * n as i64) as usize;
    if i < n { (i, false) } else { (2 * n - 1 - i, true) }
}

/// Columns that filters work on at once; padded rows are long enough for whole blocks of them.
pub const BLOCK: usize = 64;

/// Planes with a mirrored margin on every side, so that a filter may read around any pixel without asking.
pub struct Padded {
    margin: usize,
    /// Values from one padded row to the next.
    pub stride: usize,
    /// Values from one plane to the next.
    area: usize,
    values: Vec<f32>,
}

impl Padded {
    /// Pads `size.channels` planes by at least `margin` pixels; `read(plane, y, row)` gives the rows.
    pub fn new(size: Size, margin: usize, read: impl Fn(usize, usize, &mut [f32]) + Sync) -> Padded {
        let stride = size.width.next_multiple_of(BLOCK) + 2 * margin;
        let rows = size.height + 2 * margin;
        let mut values = vec![0.0f32; size.channels * rows * stride];
        let beyond: Vec<(usize, usize)> = (0..margin)
            .chain(margin + size.width..stride)
            .map(|px| (px, margin + mirrored(px as i64 - margin as i64, size.width).0))
            .collect();
        values.par_chunks_mut(stride).enumerate().for_each(|(row, out)| {
            let y = mirrored((row % rows) as i64 - margin as i64, size.height).0;
            read(row / rows, y, &mut out[margin..][..size.width]);
            for &(px, source) in &beyond {
                out[px] = out[source];
            }
        });
        Padded { margin, stride, area: rows * stride, values }
    }

    /// One padded plane.
    pub fn plane(&self, i: usize) -> &[f32] {
        &self.values[i * self.area..][..self.area]
    }

    /// Index of pixel `(x, y)` in a padded plane.
    pub fn index(&self, x: usize, y: usize) -> usize {
        (y + self.margin) * self.stride + x + self.margin
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrors_repeat_the_edge_pixel() {
        let at = |i| mirrored(i, 3).0;
        assert_eq!((-7..10).map(at).collect::<Vec<_>>(), [0, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2]);
        assert_eq!((-2..2).map(|i| mirrored(i, 1).0).collect::<Vec<_>>(), [0; 4]);
    }

    #[test]
    fn padded_planes_continue_the_picture_as_its_mirror_image() {
        let size = Size { width: 3, height: 2, channels: 2 };
        let padded = Padded::new(size, 4, |plane, y, row| {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = (100 * plane + 10 * y + x) as f32);
        });
        for plane in 0..2 {
            for (dy, dx) in (-4..5).flat_map(|dy| (-4..6).map(move |dx| (dy, dx))) {
                let at = padded.index(0, 0) as i64 + dy * padded.stride as i64 + dx;
                let expected = 100 * plane + 10 * mirrored(dy, 2).0 + mirrored(dx, 3).0;
                assert_eq!(padded.plane(plane)[at as usize], expected as f32, "{plane} {dy} {dx}");
            }
        }
    }
}
