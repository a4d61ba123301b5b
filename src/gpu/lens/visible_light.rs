//! How much of the light of highlights nearer surfaces hide.

use super::frame::{LensFrame, MAX_LOOPS, per_pixel};
use super::traces::{BATCH, LensSample, Segment, Tile, TraceBuffers};
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::plan::lens::Plan;
use crate::plan::lens::highlights::{Highlights, OTHER_SURFACE_PX, SAME_SURFACE_PX};
use crate::scene::grid::{BLOCK, TILE};

pub const VISIBLE_LIGHT: Shader = shader!(
    "lens/visible_light",
    ["mirror", "lens/depth_spans", "lens/traces"],
    [VisibleLightParams, Tile, LensSample, Segment]
);

shared! {
    struct VisibleLightParams {
        size: [u32; 2],
        pad: u32,
        blocks_across: u32,
        block: u32,
        layers: u32,
        first_sample: u32,
        end_sample: u32,
        px_per_code: f32,
        same_surface_px: f32,
        other_surface_px: f32,
        _gap: u32,
    }
}

/// For each pixel, the light that its samples meet and the light that they would meet if nothing stood in between;
/// 0 in tiles where nothing is hidden. `light` is the light of all cells.
pub fn pass(
    commands: &mut Commands,
    frame: &LensFrame,
    traces: &TraceBuffers,
    highlights: &Highlights,
    light: &wgpu::Buffer,
) -> Result<wgpu::Buffer> {
    let LensFrame { cells, codes, plan, .. } = *frame;
    let gpu = commands.gpu;
    let hidden = plan.tiles.iter().zip(&highlights.hidden_in_part).filter(|(_, hidden)| **hidden);
    let tiles: Vec<Tile> = hidden.filter_map(|(tile, _)| traces.tile(tile)).collect();
    let groups = per_pixel(tiles.len());
    let tiles = gpu.upload("the tiles with hidden light", &tiles)?;
    let lit = gpu.upload("the blocks with light", &lit_blocks(highlights, plan))?;
    let lights = commands.scratch::<[[f32; 4]; 2]>("the light that is met", cells.size.pixels())?;
    commands.clear(&lights);
    let buffers = [
        Read(&cells.codes),
        Read(light),
        Read(&cells.half_planes),
        Read(&traces.traces),
        Read(&tiles),
        Read(&traces.windows),
        Read(&lit),
        Write(&lights),
    ];
    // An invocation tests all segments of one sample of each batch, and follows all its samples to their ends.
    let loops_a_sample =
        traces.longest * (1 + cells.layers) + traces.longest * (2 + 2 * cells.layers) / BATCH + 1;
    for [first_sample, end_sample] in traces.passes((MAX_LOOPS / loops_a_sample).max(1)) {
        let params = VisibleLightParams {
            size: pixels(cells.size),
            pad: plan.padding.pad as u32,
            blocks_across: plan.bounds.across as u32,
            block: BLOCK as u32,
            layers: cells.layers as u32,
            first_sample,
            end_sample,
            px_per_code: codes.step() as f32,
            same_surface_px: SAME_SURFACE_PX,
            other_surface_px: OTHER_SURFACE_PX,
            _gap: 0,
        };
        commands.pass(&VISIBLE_LIGHT, cells.size.channels, &params, &buffers, groups)?;
    }
    Ok(lights)
}

/// For each block of the padded frame, whether there may be light in a tile that begins there.
fn lit_blocks(highlights: &Highlights, plan: &Plan) -> Vec<u32> {
    let (across, down) = (plan.bounds.across, plan.bounds.down);
    let widened = plan.light_footprint.passes().map(|(reach, ..)| reach).sum::<usize>();
    let mut lit = vec![0; across * down];
    let range = |v: i32, side: usize, n: usize| {
        let v = v as usize + plan.padding.pad;
        let first = v.saturating_sub(widened + side - 1 + BLOCK - 1) / BLOCK;
        first..((v + widened) / BLOCK + 1).min(n)
    };
    for h in &highlights.all {
        for by in range(h.y, TILE.1, down) {
            lit[by * across..][range(h.x, TILE.0, across)].fill(1);
        }
    }
    lit
}
