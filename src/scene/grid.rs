//! The sizes of the blocks and tiles into which frames are divided.

/// Side of a block in pixels; depth is bounded for each block.
pub const BLOCK: usize = 16;
/// Columns and rows of the tiles in which a frame is rendered.
pub const TILE: (usize, usize) = (64, 32);
