//! Tiles that show one closed surface of nearly constant depth. Those that are swept in part have been swept before.

use super::frame::{GROUPS, LensFrame, MAX_LOOPS, Target, origin, units};
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

/// The tiles of one surface, and their discs.
pub struct Discs<'a> {
    frame: LensFrame<'a>,
    params: DiscParams,
    tiles: wgpu::Buffer,
    count: usize,
    words: wgpu::Buffer,
    sums: wgpu::Buffer,
    most_rows: usize,
    widest_row: usize,
}

impl<'a> Discs<'a> {
    /// Uploads what is needed for discs; `None` if there are none.
    pub fn new(
        commands: &mut Commands,
        frame: &LensFrame<'a>,
        kernels: &Kernels,
    ) -> Result<Option<Discs<'a>>> {
        let LensFrame { cells, plan, .. } = *frame;
        if kernels.tiles.is_empty() {
            return Ok(None);
        }
        let (gpu, size) = (commands.gpu, cells.size);
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
            front: (cells.front * size.pixels()) as u32,
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
        Ok(Some(Discs {
            frame: *frame,
            params,
            count: tiles.len(),
            tiles: gpu.upload("the tiles of one surface", &tiles)?,
            words: gpu.upload("the discs", &kernels.words)?,
            sums: commands.scratch::<[f32; 4]>("the sums of rows", (size.width + 1) * size.height)?,
            most_rows: kernels.most_rows,
            widest_row: kernels.widest_row,
        }))
    }

    /// Renders the tiles from the front layer's `colors`.
    pub fn pass(&self, commands: &mut Commands, target: Target, colors: &wgpu::Buffer) -> Result<()> {
        let LensFrame { cells, .. } = self.frame;
        let DiscParams { size, front, .. } = self.params;
        let sum = SumParams { size, front, _end: 0 };
        let rows = [size[1], 1, 1];
        let buffers = [Read(colors), Write(&self.sums)];
        commands.pass(&SUM_ROWS, target.channels, &sum, &buffers, rows)?;
        let buffers = [
            Read(colors),
            Read(&self.sums),
            Read(&cells.shifts),
            Read(&self.words),
            Read(&self.tiles),
            Write(target.picture),
        ];
        // A pixel between two discs evaluates both.
        let rows_at_once = (MAX_LOOPS / (2 * (1 + self.widest_row))).max(1);
        for first_row in (0..self.most_rows).step_by(rows_at_once) {
            let end_row = (first_row + rows_at_once) as u32;
            let work = vec![units(rows_at_once.min(self.most_rows - first_row)); self.count];
            let params =
                |first_tile| DiscParams { first_row: first_row as u32, end_row, first_tile, ..self.params };
            commands.tiles(&DISC, target.channels, params, &buffers, (&work, GROUPS))?;
        }
        Ok(())
    }
}
