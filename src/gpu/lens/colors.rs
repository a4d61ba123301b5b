//! The colours of cells as they are drawn under one focus: without highlights, widened or sharpened.

use super::layered::Cells;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, GROUP, groups, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::plan::lens::Plan;
use crate::plan::lens::footprint::{MAX_WEIGHT, NEXT_CELLS, REACHES, STEPS_PER_PX};
use crate::scene::colors::CellColor;
use crate::scene::edges::CONNECTED_PX;

pub const REPLACE_COLORS: Shader = shader!("lens/replace_colors", [], [ReplaceParams, Replacement]);
pub const WIDEN: Shader =
    shader!("lens/widen", ["mirror", "lens/depth_spans", "lens/footprint"], [WidenParams, Footprint]);
pub const SHARPEN: Shader = shader!(
    "lens/sharpen",
    ["mirror", "lens/depth_spans", "lens/footprint", "lens/neighbours"],
    [SharpenParams, Footprint]
);

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
    let layers = (0..).step_by(cells.size.pixels()).zip(dimmed);
    let replacements: Vec<Replacement> = layers
        .flat_map(|(first, dimmed)| {
            dimmed.iter().map(move |cell| Replacement {
                color: cell.color,
                index: (first + cell.index) as u32,
                _end: [0; 3],
            })
        })
        .collect();
    if replacements.is_empty() {
        return Ok(Dim::Same);
    }
    let gpu = commands.gpu;
    let colors = commands.scratch::<[f32; 4]>("the colours without highlights", cells.len())?;
    commands.copy(&cells.colors, &colors);
    let side = (replacements.len() as f64).sqrt().ceil() as usize;
    let params = ReplaceParams { count: replacements.len() as u32 };
    let replacements = gpu.upload("the cells of highlights", &replacements)?;
    commands.pass(
        &REPLACE_COLORS,
        cells.size.channels,
        &params,
        &[Read(&replacements), Write(&colors)],
        groups(side.next_multiple_of(GROUP), side),
    )?;
    Ok(Dim::Copy(colors))
}

/// The colours, widened or sharpened to their footprint.
pub fn drawn(
    commands: &mut Commands,
    cells: &Cells,
    plan: &Plan,
    colors: &wgpu::Buffer,
) -> Result<wgpu::Buffer> {
    let gpu = commands.gpu;
    let (size, channels) = (pixels(cells.size), cells.size.channels);
    let table = plan.footprint.table();
    let footprint = Footprint {
        s_focus: plan.s_focus as f32,
        steps_per_px: STEPS_PER_PX,
        entries: table.len() as u32,
        next_cells: NEXT_CELLS,
    };
    let variances = gpu.upload("the table of footprints", table)?;
    let [across, down, _] = groups(cells.size.width, cells.size.height);
    let on_all = [across, down, cells.layers as u32];
    let buffer =
        |commands: &mut Commands| commands.scratch::<[f32; 4]>("the colours as they are drawn", cells.len());

    // Weights w of neighbours at distance h add the variance 2 w h^2.
    let most = table.iter().copied().fold(0.0, f32::max) - NEXT_CELLS;
    let mut done = 0.0f32;
    let mut widened: Option<wgpu::Buffer> = None;
    let mut spare: Option<wgpu::Buffer> = None;
    for reach in REACHES {
        if most <= done {
            break;
        }
        let per_weight = 2.0 * (reach * reach) as f32;
        let params = WidenParams {
            size,
            reach: reach as i32,
            done,
            per_weight,
            max_weight: MAX_WEIGHT,
            connected_px: CONNECTED_PX,
            _gap: 0,
            footprint,
        };
        let target = spare.take().map_or_else(|| buffer(commands), Ok)?;
        let source = widened.as_ref().unwrap_or(colors);
        let buffers = [Read(&variances), Read(&cells.shifts), Read(source), Write(&target)];
        commands.pass(&WIDEN, channels, &params, &buffers, on_all)?;
        spare = widened.replace(target);
        done += MAX_WEIGHT * per_weight;
    }

    let params = SharpenParams { size, layers: cells.layers as u32, connected_px: CONNECTED_PX, footprint };
    let drawn = spare.map_or_else(|| buffer(commands), Ok)?;
    let source = widened.as_ref().unwrap_or(colors);
    let buffers = [Read(&variances), Read(&cells.shifts), Read(&cells.edges), Read(source), Write(&drawn)];
    commands.pass(&SHARPEN, channels, &params, &buffers, on_all)?;
    Ok(drawn)
}
