//! The picture of one tile while it is computed.

use crate::scene::grid::TILE;

/// A tile's picture: planes of `TILE` pixels.
pub struct TileColor {
    pub planes: Vec<Vec<f32>>,
}

impl TileColor {
    pub fn new(channels: usize) -> TileColor {
        TileColor { planes: vec![vec![0.0; TILE.0 * TILE.1]; channels] }
    }

    /// Puts a share of another picture of the tile in place of as much of this one.
    pub fn mix(&mut self, other: &TileColor, share: f32) {
        for (own, other) in self.planes.iter_mut().zip(&other.planes) {
            own.iter_mut().zip(other).for_each(|(own, other)| *own += share * (other - *own));
        }
    }

    /// Row `y` of every channel.
    pub fn row<const C: usize>(&self, y: usize) -> [&[f32; TILE.0]; C] {
        let row = |c: usize| self.planes[c][y * TILE.0..].first_chunk();
        std::array::from_fn(|c| row(c).expect("planes hold whole tiles"))
    }
}
