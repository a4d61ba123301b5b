//! The pictures of [coarser scenes](super::coarse), and what is between their pixels.
//!
//! A pixel of theirs is the mean over a square of the picture. Between them, the picture is continued by parabolas that have
//! these means and meet at the sides of the squares.

use super::frame::{Frame, Scenes};
use super::parts::BESIDE;
use super::tile_color::TileColor;
use crate::memory::Buffer;
use crate::mirror::mirrored;
use crate::plan::lens::tiles::Tile;
use crate::scene::grid::TILE;
use std::ops::Range;

const TAPS: usize = 2 * BESIDE + 1;

/// The weights of means from which the mean over `range` of the middle square follows; the square is 1 wide.
///
/// The value at a side is the one that a polynomial of third degree has there with the four means around it,
/// `(7 (a + b) - (before + after)) / 12` (Colella and Woodward 1984, equation 1.6).
fn taps(range: Range<f32>) -> [f32; TAPS] {
    const LEFT: [f32; TAPS] = [-1.0 / 12.0, 7.0 / 12.0, 7.0 / 12.0, -1.0 / 12.0, 0.0];
    const RIGHT: [f32; TAPS] = [0.0, -1.0 / 12.0, 7.0 / 12.0, 7.0 / 12.0, -1.0 / 12.0];
    let (u, v) = (range.start, range.end);
    let (linear, quadratic) = (0.5 * (u + v), (u * u + u * v + v * v) / 3.0);
    std::array::from_fn(|i| {
        let own = if i == BESIDE { 1.0 } else { 0.0 };
        let curved = 6.0 * own - 3.0 * (LEFT[i] + RIGHT[i]);
        LEFT[i] + (RIGHT[i] - LEFT[i] + curved) * linear - curved * quadratic
    })
}

/// The picture of one coarser scene, as far as it is needed.
pub struct CoarsePicture {
    /// The scene's pixels are `2^n` pixels of the picture wide.
    n: usize,
    width: usize,
    height: usize,
    /// The rows of each plane, which are those of whole tiles.
    rows: usize,
    planes: Buffer<f32>,
    /// For each pixel of a square along one axis.
    taps: Vec<[f32; TAPS]>,
}

/// The pictures of the coarser scenes.
pub struct CoarsePictures(pub Vec<CoarsePicture>);

/// The memory in which a tile is put together.
#[derive(Default)]
pub struct Between {
    /// The squares of the tile and those beside them, and the rows between those.
    squares: Vec<f32>,
    rows: Vec<f32>,
    shares: Vec<f32>,
}

impl CoarsePictures {
    /// Adds the coarser scenes' shares of the tile of a frame; of what is in `color`, the share of the frame's own is kept.
    pub fn add_to(&self, frame: &Frame, tile: &Tile, between: &mut Between, color: &mut [TileColor]) {
        let Some(Scenes { detail, .. }) = &frame.scenes else { return };
        let (x, y) = tile.origin;
        let pictures = self.0.iter().filter(|picture| {
            let squares =
                |first: usize, side: usize| first >> picture.n..(first + side).div_ceil(1 << picture.n);
            detail.needs(picture.n, squares(x, TILE.0), squares(y, TILE.1), 0)
        });
        let mut pictures = pictures.peekable();
        if pictures.peek().is_none() {
            return;
        }
        let Between { squares, rows, shares } = between;
        shares.resize(TILE.0 * TILE.1, 0.0);
        detail.shares(0, (x, y), shares);
        for plane in color.iter_mut().flat_map(|color| &mut color.planes) {
            // What has no share need not be finite.
            plane
                .iter_mut()
                .zip(&*shares)
                .for_each(|(v, share)| *v = if *share > 0.0 { share * *v } else { 0.0 });
        }
        for picture in pictures {
            detail.shares(picture.n, (x, y), shares);
            let planes = color.iter_mut().flat_map(|color| &mut color.planes);
            for (c, plane) in planes.enumerate() {
                frame.simd.run(
                    #[inline(always)]
                    || picture.add_to(c, tile.origin, shares, (squares, rows), plane),
                );
            }
        }
    }
}

impl CoarsePicture {
    /// The picture of a scene whose pixels are `2^n` pixels of the picture wide: planes of as many rows as whole tiles have.
    pub fn new(n: usize, (width, height): (usize, usize), planes: Buffer<f32>) -> CoarsePicture {
        let side = 1 << n;
        let at = |i: usize| i as f32 / side as f32;
        let taps = (0..side).map(|i| taps(at(i)..at(i + 1))).collect();
        CoarsePicture { n, width, height, rows: height.next_multiple_of(TILE.1), planes, taps }
    }

    /// Adds shares of the plane of channel `c` to a tile of the frame.
    #[inline(always)]
    fn add_to(
        &self,
        c: usize,
        origin: (usize, usize),
        shares: &[f32],
        (read, rows): (&mut Vec<f32>, &mut Vec<f32>),
        out: &mut [f32],
    ) {
        let CoarsePicture { n, width, height, rows: in_plane, planes, taps } = self;
        let plane = &planes[c * in_plane * width..][..in_plane * width];
        // The squares of the tile, and those beside them.
        let squares = |side: usize| (side >> n).max(1) + 2 * BESIDE;
        let around = |first: usize, i: usize, extent: usize| {
            mirrored(((first >> n) + i) as i64 - BESIDE as i64, extent).0
        };
        let across = squares(TILE.0);
        // Between rows.
        rows.resize(across * TILE.1, 0.0);
        let columns: Vec<usize> = (0..across).map(|i| around(origin.0, i, *width)).collect();
        read.resize(across * squares(TILE.1), 0.0);
        for (j, row) in read.chunks_exact_mut(across).enumerate() {
            let own = &plane[around(origin.1, j, *height) * width..][..*width];
            row.iter_mut().zip(&columns).for_each(|(v, &x)| *v = own[x]);
        }
        for (y, out) in rows.chunks_exact_mut(across).enumerate() {
            let (own, taps) = (y >> n, &taps[y & ((1 << n) - 1)]);
            let beside: [&[f32]; TAPS] = std::array::from_fn(|k| &read[(own + k) * across..][..across]);
            for (x, out) in out.iter_mut().enumerate() {
                *out = between(std::array::from_fn(|k| beside[k][x]), taps);
            }
        }
        let rows =
            rows.chunks_exact(across).zip(out.chunks_exact_mut(TILE.0)).zip(shares.chunks_exact(TILE.0));
        for ((row, out), shares) in rows {
            for (x, (out, share)) in out.iter_mut().zip(shares).enumerate() {
                let own: &[f32; TAPS] =
                    row[x >> n..].first_chunk().expect("squares beside the tile are read");
                let value = between(*own, &taps[x & ((1 << n) - 1)]);
                // Where this picture has no share, nothing may have been rendered.
                *out += if *share > 0.0 { share * value } else { 0.0 };
            }
        }
    }
}

/// The value between means.
#[inline(always)]
fn between(means: [f32; TAPS], taps: &[f32; TAPS]) -> f32 {
    let mut sum = 0.0;
    for k in 0..TAPS {
        sum += taps[k] * means[k];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_kept_and_quadratics_continued() {
        // The mean of a quadratic over a range.
        let mean = |a: f32, b: f32| 0.3 + 0.5 * (a + b) * 0.7 + 0.4 * (a * a + a * b + b * b) / 3.0;
        let means: [f32; TAPS] = std::array::from_fn(|i| mean(i as f32 - 2.0, i as f32 - 1.0));
        let sum =
            |taps: [f32; TAPS], of: [f32; TAPS]| -> f32 { taps.iter().zip(of).map(|(a, b)| a * b).sum() };
        for side in [2, 4, 8] {
            let at = |i: usize| i as f32 / side as f32;
            let mut all = [0.0; TAPS];
            for i in 0..side {
                let own = taps(at(i)..at(i + 1));
                all.iter_mut().zip(own).for_each(|(sum, v)| *sum += v / side as f32);
                assert!((sum(own, means) - mean(at(i), at(i + 1))).abs() < 1e-5);
            }
            assert!(all.iter().zip([0.0, 0.0, 1.0, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-5), "{all:?}");
        }
    }
}
