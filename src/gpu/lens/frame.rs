//! The input that the passes over tiles share.

use super::layered::Cells;
use crate::gpu::picture::GpuPicture;
use crate::plan::lens::Plan;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::scene::depth_codes::DepthCodes;
use crate::scene::grid::TILE;
use crate::scene::layered::LayeredScene;

/// The largest number of loop iterations of an invocation in one pass; more work is divided among passes. So no pass
/// takes so long that a driver ends it, and the limit of software rasterisers is not reached where all iterations are counted.
pub const MAX_LOOPS: usize = 40_000;
/// Rows of a tile that one workgroup renders, with one pixel per invocation.
pub const GROUP_ROWS: usize = 4;

/// The number of workgroups of a tile with one pixel per invocation.
pub const GROUPS: u32 = TILE.1.div_ceil(GROUP_ROWS) as u32;

/// The work for a tile of whose pixels each one takes so many units.
pub fn units(per_pixel: usize) -> f64 {
    (TILE.0 * TILE.1 * per_pixel) as f64
}

/// The input of a render.
pub struct Input<'a> {
    pub picture: &'a GpuPicture,
    pub scene: &'a LayeredScene,
    pub cells: &'a Cells,
    /// See `cpu::lens::Input`.
    pub supersample: usize,
}

/// The scene on the device, and the plan.
#[derive(Clone, Copy)]
pub struct LensFrame<'a> {
    pub cells: &'a Cells,
    pub codes: &'a DepthCodes,
    pub plan: &'a Plan,
    /// The clipping by the second stop, if there is one.
    pub clip: Option<&'a PupilClip>,
}

/// The picture to which passes write.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    pub picture: &'a wgpu::Buffer,
    pub channels: usize,
}

/// The first pixel of a tile in the form that shaders use.
pub fn origin((x, y): (usize, usize)) -> [u32; 2] {
    [x as u32, y as u32]
}
