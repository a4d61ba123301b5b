//! The parts of a tile whose rays are culled together.

use super::culling::PART;
use crate::scene::grid::TILE;

/// Pixels of a coarser picture on either side of one on which what is between its pixels depends.
pub const BESIDE: usize = 2;

const ACROSS: usize = TILE.0 / PART.0;
const ALL: usize = ACROSS * (TILE.1 / PART.1);

/// Some parts of a tile.
#[derive(Debug, Clone, Copy, Default)]
pub struct Parts([bool; ALL]);

impl Parts {
    /// The parts for which a condition on their first column and row in the tile holds.
    pub fn that(is_one: impl Fn((usize, usize)) -> bool) -> Parts {
        Parts(std::array::from_fn(|i| is_one(origin(i))))
    }

    pub fn any(&self) -> bool {
        self.0.contains(&true)
    }

    /// The first column and row of each of these parts in the tile.
    pub fn origins(self) -> impl Iterator<Item = (usize, usize)> {
        (0..ALL).filter(move |i| self.0[*i]).map(origin)
    }
}

/// The first column and row of part number `i` in the tile.
fn origin(i: usize) -> (usize, usize) {
    (i % ACROSS * PART.0, i / ACROSS * PART.1)
}
