//! The colours of cells as they are drawn under one focus: without highlights, widened or sharpened.

use super::layered::Cells;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, GROUP, groups, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::plan::lens::Plan;
use crate::plan::lens::footprint::{self, MAX_WEIGHT, STEPS_PER_PX};
use crate::scene::colors::CellColor;
use crate::scene::edges::CONNECTED_PX;

pub const REPLACE_COLORS: Shader = shader!("lens/replace_colors", [], [ReplaceParams, Replacement]);
pub const WIDEN: Shader =
    shader!("lens/widen", ["mirror", "lens/depth_spans", "lens/footprint"], [WidenParams, Footprint]);
pub const SHARPEN: Shader =
    shader!("lens/sharpen", ["mirror", "lens/depth_spans", "lens/footprint"], [SharpenParams, Footprint]);

shared! {
    /// Parameters for cells whose colour is replaced.
    struct ReplaceParams {
        count: u32,
    }
}

shared! {
    struct Replacement {
        color: [f32; 4],
        index: u32,
        _end: [u32; 3],
    }
}

shared! {
    struct Footprint {
        s_focus: f32,
        steps_per_px: f32,
        entries: u32,
        next_cells: f32,
    }
}

shared! {
    /// Parameters of one widening pass.
    struct WidenParams {
        size: [u32; 2],
        reach: i32,
        done: f32,
        per_weight: f32,
        max_weight: f32,
        connected_px: f32,
        _gap: u32,
        footprint: Footprint,
    }
}

shared! {
    /// Parameters of sharpening.
    struct SharpenParams {
        size: [u32; 2],
        layers: u32,
        connected_px: f32,
        footprint: Footprint,
    }
}

/// Colours without highlights.
pub enum Dim {
    /// There is no highlight.
    Same,
    /// The colours are in a buffer of their own.
    Copy(wgpu::Buffer),
}

impl Dim {
    pub fn buffer<'a>(&'a self, cells: &'a Cells) -> &'a wgpu::Buffer {
        match self {
            Dim::Same => &cells.colors,
            Dim::Copy(buffer) => buffer,
        }
    }
}

/// The colours, with those of the `dimmed` cells of each layer replaced.
pub fn dim(commands: &mut Commands, cells: &Cells, dimmed: &[Vec<CellColor>]) -> Result<Dim> {
    if dimmed.iter().all(Vec::is_empty) {
        return Ok(Dim::Same);
    }
    let colors = commands.scratch::<[f32; 4]>("the colours without highlights", cells.len())?;
    commands.copy(&cells.colors, &colors);
    replace(commands, cells, dimmed, &colors)?;
    Ok(Dim::Copy(colors))
}

/// The light of the highlights of each layer, widened to its footprint.
pub fn light(
    commands: &mut Commands,
    cells: &Cells,
    plan: &Plan,
    light: &[Vec<CellColor>],
) -> Result<wgpu::Buffer> {
    let narrow = commands.scratch::<[f32; 4]>("the light of highlights", cells.len())?;
    commands.clear(&narrow);
    replace(commands, cells, light, &narrow)?;
    let footprint = Footprints::new(commands, &plan.light_footprint, plan.s_focus)?;
    Ok(footprint.widened(commands, cells, &narrow)?.0.unwrap_or(narrow))
}

/// Replaces the colours of some cells of each layer.
fn replace(
    commands: &mut Commands,
    cells: &Cells,
    by_layer: &[Vec<CellColor>],
    colors: &wgpu::Buffer,
) -> Result<()> {
    let layers = (0..).step_by(cells.size.pixels()).zip(by_layer);
    let replacements: Vec<Replacement> = layers
        .flat_map(|(first, cells)| {
            cells.iter().map(move |cell| Replacement {
                color: cell.color,
                index: (first + cell.index) as u32,
                _end: [0; 3],
            })
        })
        .collect();
    let side = (replacements.len() as f64).sqrt().ceil() as usize;
    let params = ReplaceParams { count: replacements.len() as u32 };
    let replacements = commands.gpu.upload("the cells of highlights", &replacements)?;
    commands.pass(
        &REPLACE_COLORS,
        cells.size.channels,
        &params,
        &[Read(&replacements), Write(colors)],
        groups(side.next_multiple_of(GROUP), side),
    )
}

/// A table of footprints on the device.
struct Footprints<'a> {
    table: &'a footprint::Footprint,
    params: Footprint,
    variances: wgpu::Buffer,
}

impl Footprints<'_> {
    fn new<'a>(commands: &Commands, table: &'a footprint::Footprint, s_focus: f64) -> Result<Footprints<'a>> {
        let variances = commands.gpu.upload("the table of footprints", table.table())?;
        let params = Footprint {
            s_focus: s_focus as f32,
            steps_per_px: STEPS_PER_PX,
            entries: table.table().len() as u32,
            next_cells: table.next_cells,
        };
        Ok(Footprints { table, params, variances })
    }

    /// The colours after all passes of widening, if there are any, and a buffer to spare.
    fn widened(
        &self,
        commands: &mut Commands,
        cells: &Cells,
        colors: &wgpu::Buffer,
    ) -> Result<(Option<wgpu::Buffer>, Option<wgpu::Buffer>)> {
        let (mut widened, mut spare): (Option<wgpu::Buffer>, Option<wgpu::Buffer>) = (None, None);
        for (reach, done, per_weight) in self.table.passes() {
            let params = WidenParams {
                size: pixels(cells.size),
                reach: reach as i32,
                done,
                per_weight,
                max_weight: MAX_WEIGHT,
                connected_px: CONNECTED_PX,
                _gap: 0,
                footprint: self.params,
            };
            let target = spare.take().map_or_else(|| drawn_buffer(commands, cells), Ok)?;
            let source = widened.as_ref().unwrap_or(colors);
            let buffers = [Read(&self.variances), Read(&cells.shifts), Read(source), Write(&target)];
            commands.pass(&WIDEN, cells.size.channels, &params, &buffers, on_all(cells))?;
            spare = widened.replace(target);
        }
        Ok((widened, spare))
    }
}

fn drawn_buffer(commands: &mut Commands, cells: &Cells) -> Result<wgpu::Buffer> {
    commands.scratch::<[f32; 4]>("the colours as they are drawn", cells.len())
}

/// Workgroups for every cell of every layer.
fn on_all(cells: &Cells) -> [u32; 3] {
    let [across, down, _] = groups(cells.size.width, cells.size.height);
    [across, down, cells.layers as u32]
}

/// The colours, widened or sharpened to their footprint.
pub fn drawn(
    commands: &mut Commands,
    cells: &Cells,
    plan: &Plan,
    colors: &wgpu::Buffer,
) -> Result<wgpu::Buffer> {
    let footprint = Footprints::new(commands, &plan.footprint, plan.s_focus)?;
    let (widened, spare) = footprint.widened(commands, cells, colors)?;
    let params = SharpenParams {
        size: pixels(cells.size),
        layers: cells.layers as u32,
        connected_px: CONNECTED_PX,
        footprint: footprint.params,
    };
    let drawn = spare.map_or_else(|| drawn_buffer(commands, cells), Ok)?;
    let source = widened.as_ref().unwrap_or(colors);
    let buffers = [
        Read(&footprint.variances),
        Read(&cells.shifts),
        Read(&cells.connectivity),
        Read(source),
        Write(&drawn),
    ];
    commands.pass(&SHARPEN, cells.size.channels, &params, &buffers, on_all(cells))?;
    Ok(drawn)
}
