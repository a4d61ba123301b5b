//! What the passes over tiles have in common.

use super::layered::Cells;
use crate::plan::lens::Plan;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::scene::depth_codes::DepthCodes;
use crate::scene::grid::TILE;

/// How often an invocation may go through its loops in one pass; what needs more is shared among passes. No pass then
/// takes so long that a driver ends it, and llvmpipe, which silently leaves all loops after 65535 turns, never does.
pub const MAX_LOOPS: usize = 40_000;
/// Rows of a tile that one workgroup has, a pixel for each invocation.
pub const GROUP_ROWS: usize = 4;

/// Workgroups that cover some tiles.
pub fn per_pixel(tiles: usize) -> [u32; 3] {
    [tiles as u32, TILE.1.div_ceil(GROUP_ROWS) as u32, 1]
}

/// The scene on the device, the plan, and the picture that passes write.
pub struct LensFrame<'a> {
    pub cells: &'a Cells,
    pub codes: &'a DepthCodes,
    pub plan: &'a Plan,
    /// What the second stop hides, if anything.
    pub clip: Option<&'a PupilClip>,
    pub picture: &'a wgpu::Buffer,
}

/// The first pixel of a tile as shaders have it.
pub fn origin((x, y): (usize, usize)) -> [u32; 2] {
    [x as u32, y as u32]
}
