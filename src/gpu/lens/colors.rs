//! The colours of cells as they are drawn under one focus: without highlights, widened or sharpened.

use super::cells::Cells;
use super::pixels;
use crate::cpu::lens::colors::Own;
use crate::cpu::lens::footprint::{MAX_WEIGHT, NEXT_CELLS, REACHES, STEPS_PER_PX};
use crate::cpu::lens::plan::Plan;
use crate::cpu::lens::surfaces::CONNECTED_PX;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, GROUP, groups};
use crate::gpu::shader::{Shader, shader, shared};

pub const PATCH: Shader = shader!("lens/patch", [], [PatchParams, Patch]);
pub const WIDEN: Shader =
    shader!("lens/widen", ["border", "lens/cells", "lens/footprint"], [WidenParams, Footprint]);
pub const SHARPEN: Shader =
    shader!("lens/sharpen", ["border", "lens/cells", "lens/footprint"], [SharpenParams, Footprint]);

shared! {
    /// Of cells that get another colour.
    struct PatchParams {
        count: u32,
    }
}

shared! {
    struct Patch {
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
    /// Of one pass of widening.
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
    /// Of sharpening.
    struct SharpenParams {
        size: [u32; 2],
        sheets: u32,
        connected_px: f32,
        footprint: Footprint,
    }
}

/// Colours without highlights.
pub enum Dim {
    /// There is no highlight.
    Same,
    /// Their own buffer.
    Own(wgpu::Buffer),
}

impl Dim {
    pub fn buffer<'a>(&'a self, cells: &'a Cells) -> &'a wgpu::Buffer {
        match self {
            Dim::Same => &cells.colors,
            Dim::Own(buffer) => buffer,
        }
    }
}

/// The colours with those of the `dimmed` cells of each sheet.
pub fn dim(commands: &mut Commands, cells: &Cells, dimmed: &[Vec<Own>]) -> Result<Dim> {
    let sheets = (0..).step_by(cells.size.pixels()).zip(dimmed);
    let patches: Vec<Patch> = sheets
        .flat_map(|(first, dimmed)| {
            dimmed.iter().map(move |cell| Patch {
                color: cell.color,
                index: (first + cell.index) as u32,
                _end: [0; 3],
            })
        })
        .collect();
    if patches.is_empty() {
        return Ok(Dim::Same);
    }
    let gpu = commands.gpu;
    let colors = commands.scratch::<[f32; 4]>("the colours without highlights", cells.len())?;
    commands.copy(&cells.colors, &colors);
    let side = (patches.len() as f64).sqrt().ceil() as usize;
    let params = PatchParams { count: patches.len() as u32 };
    let patches = gpu.upload("the cells of highlights", &patches)?;
    commands.pass(
        &PATCH,
        cells.size.channels,
        &params,
        &[Read(&patches), Write(&colors)],
        groups(side.next_multiple_of(GROUP), side),
    )?;
    Ok(Dim::Own(colors))
}

/// Those colours widened or sharpened to their footprint.
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
    let on_all = [across, down, cells.sheets as u32];
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

    let params = SharpenParams { size, sheets: cells.sheets as u32, connected_px: CONNECTED_PX, footprint };
    let drawn = spare.map_or_else(|| buffer(commands), Ok)?;
    let source = widened.as_ref().unwrap_or(colors);
    let buffers = [Read(&variances), Read(&cells.shifts), Read(&cells.links), Read(source), Write(&drawn)];
    commands.pass(&SHARPEN, channels, &params, &buffers, on_all)?;
    Ok(drawn)
}
