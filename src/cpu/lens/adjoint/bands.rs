//! Bands of tiles, of which each has its own planes to add to.

use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::tile_color::TileColor;
use crate::picture::Size;
use crate::plan::lens::tiles::Tile;
use crate::scene::grid::TILE;
use std::ops::Range;

/// Number of bands that are done at the same time. It bounds memory, and does not depend on the number of threads, so that
/// no sum does.
pub const WAVE: usize = 16;

/// The tiles of a frame in bands of whole rows of tiles: as high as the margin on both sides of them, so that a window is
/// at most twice as high as its band, unless there would be too few bands.
pub fn bands<'a>(frame: &'a Frame) -> Vec<Band<'a>> {
    let padding = &frame.padded.padding;
    let (across, down) = (padding.width.div_ceil(TILE.0), padding.height.div_ceil(TILE.1));
    let rows = (2 * padding.pad).div_ceil(TILE.1).min(down.div_ceil(WAVE)).max(1);
    let bands = frame.tiles.chunks(rows * across).zip(0..);
    bands.map(|(tiles, band)| Band { tiles, first_tile: band * rows * across }).collect()
}

/// Some rows of tiles.
pub struct Band<'a> {
    pub tiles: &'a [Tile],
    /// The number of the first tile.
    pub first_tile: usize,
}

impl Band<'_> {
    /// The rows of the frame, and those with which the last tiles go beyond it.
    pub fn rows(&self) -> Range<usize> {
        self.tiles[0].origin.1..self.tiles[self.tiles.len() - 1].origin.1 + TILE.1
    }
}

/// Reads a tile of planes; zero beyond the frame.
pub fn read(size: Size, planes: &[f32], origin: (usize, usize), into: &mut TileColor) {
    let (across, down) = (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1));
    for (plane, into) in planes.chunks_exact(size.pixels()).zip(&mut into.planes) {
        into.fill(0.0);
        for y in 0..down {
            let start = (origin.1 + y) * size.width + origin.0;
            into[y * TILE.0..][..across].copy_from_slice(&plane[start..start + across]);
        }
    }
}
