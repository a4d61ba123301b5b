//! Tiles that show one closed surface of nearly constant depth. Those that are swept in part have been swept before.

use super::frame::{GROUPS, LensFrame, MAX_LOOPS, origin, units};
use super::kernels::{Disc, Kernels};
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::plan::lens::disc::APART;
use crate::plan::lens::kernels::{COARSE, FINE, SMALL_PX};

pub const SUM_ROWS: Shader = shader!("lens/sum_rows", [], [SumParams]);
pub const DISC: Shader = shader!("lens/disc", ["mirror", "lens/kernels"], [DiscParams, Tile]);

shared! {
    /// Parameters of the running sums.
    struct SumParams {
        size: [u32; 2],
        front: u32,
        _end: u32,
    }
}

shared! {
    /// Parameters of the discs.
    struct DiscParams {
        size: [u32; 2],
        s_focus: f32,
        small_px: f32,
        fine: f32,
        coarse: f32,
        apart: f32,
        first_step: i32,
        first_row: u32,
        end_row: u32,
        front: u32,
        first_tile: u32,
    }
}

shared! {
    struct Tile {
        origin: [u32; 2],
        kernel: i32,
        share: f32,
    }
}

/// Renders the tiles from the front layer's `colors`.
pub fn pass(
    commands: &mut Commands,
    frame: &LensFrame,
    kernels: &Kernels,
    colors: &wgpu::Buffer,
) -> Result<()> {
    let LensFrame { cells, plan, picture, .. } = *frame;
    let gpu = commands.gpu;
    if kernels.tiles.is_empty() {
        return Ok(());
    }
    let (size, channels) = (cells.size, cells.size.channels);
    let front = (cells.front * size.pixels()) as u32;
    let sums = commands.scratch::<[f32; 4]>("the sums of rows", (size.width + 1) * size.height)?;
    let buffers = [Read(colors), Write(&sums)];
    let rows = [size.height as u32, 1, 1];
    commands.pass(&SUM_ROWS, channels, &SumParams { size: pixels(size), front, _end: 0 }, &buffers, rows)?;

    let params = DiscParams {
        size: pixels(size),
        s_focus: plan.s_focus as f32,
        small_px: SMALL_PX as f32,
        fine: FINE as f32,
        coarse: COARSE as f32,
        apart: APART as f32,
        first_step: kernels.first_step,
        first_row: 0,
        end_row: 0,
        front,
        first_tile: 0,
    };
    let tile = |&(at, disc, share): &((usize, usize), Disc, f32)| {
        let kernel = match disc {
            Disc::Same(kernel) => kernel as i32,
            Disc::PerPixel => -1,
        };
        Tile { origin: origin(at), kernel, share }
    };
    let tiles: Vec<Tile> = kernels.tiles.iter().map(tile).collect();
    let count = tiles.len();
    let tiles = gpu.upload("the tiles of one surface", &tiles)?;
    let words = gpu.upload("the discs", &kernels.words)?;
    let buffers =
        [Read(colors), Read(&sums), Read(&cells.shifts), Read(&words), Read(&tiles), Write(picture)];
    // A pixel between two discs evaluates both.
    let rows_at_once = (MAX_LOOPS / (2 * (1 + kernels.widest_row))).max(1);
    for first_row in (0..kernels.most_rows).step_by(rows_at_once) {
        let end_row = (first_row + rows_at_once) as u32;
        let work = vec![units(rows_at_once.min(kernels.most_rows - first_row)); count];
        let params = |first_tile| DiscParams { first_row: first_row as u32, end_row, first_tile, ..params };
        commands.tiles(&DISC, channels, params, &buffers, (&work, GROUPS))?;
    }
    Ok(())
}
