//! The sizes of the pieces that frames are looked at in.

/// Side of a block, for which depths are bounded.
pub const BLOCK: usize = 16;
/// Columns and rows of the tiles that a frame is rendered in.
pub const TILE: (usize, usize) = (64, 32);
