//! Tiles in which visibility has to be resolved for every lens sample.

use super::frame::{LensFrame, MAX_LOOPS};
use super::traces::{BATCH, LensSample, Segment, Tile, TraceBuffers};
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::scene::grid::{BLOCK, TILE};

pub const SWEEP: Shader = shader!(
    "lens/sweep",
    ["mirror", "lens/depth_spans", "lens/traces"],
    [SweepParams, Tile, LensSample, Segment]
);

/// Rows of a tile that one workgroup sweeps.
pub const ROWS: usize = 16;
/// A typical number of a sample's segments that contain cells near a tile.
const FOLLOWED: usize = 20;

shared! {
    struct SweepParams {
        size: [u32; 2],
        pad: u32,
        blocks_across: u32,
        block: u32,
        layers: u32,
        missed: u32,
        first_sample: u32,
        end_sample: u32,
    }
}

/// Sweeps the tiles with the colours `drawn`.
pub fn pass(
    commands: &mut Commands,
    frame: &LensFrame,
    traces: &TraceBuffers,
    drawn: &wgpu::Buffer,
) -> Result<()> {
    let LensFrame { cells, plan, picture, .. } = *frame;
    let gpu = commands.gpu;
    let tiles: Vec<Tile> = plan.tiles.iter().filter_map(|tile| traces.tile(tile)).collect();
    let groups = [tiles.len() as u32, TILE.1.div_ceil(ROWS) as u32, 1];
    let tiles = gpu.upload("the tiles that are swept", &tiles)?;
    let left_out = commands.scratch::<f32>("the samples that do not count", cells.size.pixels())?;
    let buffers = [
        Read(&cells.codes),
        Read(drawn),
        Read(&cells.half_planes),
        Read(&traces.traces),
        Read(&tiles),
        Read(&traces.windows),
        Write(&left_out),
        Write(picture),
    ];
    // An invocation tests all segments of one sample of each batch, and follows the picked segments of all its
    // samples.
    let loops_a_batch = traces.longest * (2 + 2 * cells.layers) + BATCH * FOLLOWED * (1 + cells.layers);
    for [first_sample, end_sample] in traces.passes((MAX_LOOPS / loops_a_batch).max(1) * BATCH) {
        let params = SweepParams {
            size: pixels(cells.size),
            pad: plan.padding.pad as u32,
            blocks_across: plan.bounds.across as u32,
            block: BLOCK as u32,
            layers: cells.layers as u32,
            missed: plan.missed as u32,
            first_sample,
            end_sample,
        };
        commands.pass(&SWEEP, cells.size.channels, &params, &buffers, groups)?;
    }
    Ok(())
}
