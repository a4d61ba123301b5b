//! The colours of cells as they are drawn under one focus: without highlights, widened or sharpened.

use super::group::Group;
use super::layered::Cells;
use super::replace::replace;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, groups, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::picture::Size;
use crate::plan::lens::Plan;
use crate::plan::lens::footprint::{MAX_WEIGHT, NEXT_CELLS, REACHES, STEPS_PER_PX};
use crate::scene::colors::CellColor;
use crate::scene::contrast::light_channels;
use crate::scene::edges::CONNECTED_PX;

pub const WIDEN: Shader =
    shader!("lens/widen", ["mirror", "lens/depth_spans", "lens/footprint"], [WidenParams, Footprint]);
pub const SHARPEN: Shader = shader!(
    "lens/sharpen",
    ["mirror", "lens/depth_spans", "lens/footprint", "lens/neighbours"],
    [SharpenParams, Footprint]
);

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
        rule: u32,
        lights: u32,
        _gap: [u32; 2],
        footprint: Footprint,
    }
}

/// The colours of a group of channels, with those of the `dimmed` cells of each layer replaced.
pub fn dim(
    commands: &mut Commands,
    cells: &Cells,
    group: &Group,
    dimmed: &[Vec<CellColor>],
) -> Result<wgpu::Buffer> {
    if dimmed.iter().all(Vec::is_empty) {
        return Ok(group.colors.clone());
    }
    let colors = commands.scratch::<[f32; 4]>("the colours without highlights", cells.len())?;
    commands.copy(&group.colors, &colors);
    let dimmed = dimmed.iter().map(Vec::as_slice);
    replace(commands, &colors, group.size.channels, cells.size.pixels(), dimmed)?;
    Ok(colors)
}

/// How cells are drawn under one focus.
pub struct Drawing<'a> {
    cells: &'a Cells,
    footprint: Footprint,
    variances: wgpu::Buffer,
    /// The largest variance that is to be added beyond that of the next cells.
    most: f32,
}

/// Colours that have been widened, and a buffer that is free.
struct Widened {
    colors: wgpu::Buffer,
    spare: Option<wgpu::Buffer>,
}

impl<'a> Drawing<'a> {
    pub fn new(commands: &Commands, cells: &'a Cells, plan: &Plan) -> Result<Drawing<'a>> {
        let table = plan.footprint.table();
        let footprint = Footprint {
            s_focus: plan.s_focus as f32,
            steps_per_px: STEPS_PER_PX,
            entries: table.len() as u32,
            next_cells: NEXT_CELLS,
        };
        let variances = commands.gpu.upload("the table of footprints", table)?;
        let most = table.iter().copied().fold(0.0, f32::max) - NEXT_CELLS;
        Ok(Drawing { cells, footprint, variances, most })
    }

    /// The colours with which the cells of a group are drawn: widened or sharpened to their footprint. Those that are
    /// carried are sharpened as `guide` allows, the picture's own [as they are before](Drawing::guide).
    pub fn drawn(
        &self,
        commands: &mut Commands,
        group: &Group,
        colors: &wgpu::Buffer,
        guide: Option<(&wgpu::Buffer, Size)>,
    ) -> Result<wgpu::Buffer> {
        let (cells, channels) = (self.cells, group.size.channels);
        let Widened { colors, spare } = self.widened(commands, channels, colors)?;
        let (guide, lights) = guide.map_or((&colors, 0), |(guide, size)| (guide, light_channels(size)));
        let params = SharpenParams {
            size: pixels(cells.size),
            layers: cells.layers as u32,
            connected_px: CONNECTED_PX,
            rule: group.sharpening as u32,
            lights: lights as u32,
            _gap: [0; 2],
            footprint: self.footprint,
        };
        let drawn = spare.map_or_else(|| self.buffer(commands), Ok)?;
        let buffers = [
            Read(&self.variances),
            Read(&cells.shifts),
            Read(&cells.edges),
            Read(&colors),
            Read(guide),
            Write(&drawn),
        ];
        commands.pass(&SHARPEN, channels, &params, &buffers, self.on_all())?;
        Ok(drawn)
    }

    /// The colours of a picture by which those that it carries are sharpened.
    pub fn guide(&self, commands: &mut Commands, size: Size, colors: &wgpu::Buffer) -> Result<wgpu::Buffer> {
        Ok(self.widened(commands, size.channels, colors)?.colors)
    }

    fn widened(&self, commands: &mut Commands, channels: usize, colors: &wgpu::Buffer) -> Result<Widened> {
        let cells = self.cells;
        // Weights w of neighbours at distance h add the variance 2 w h^2.
        let mut done = 0.0f32;
        let mut widened: Option<wgpu::Buffer> = None;
        let mut spare: Option<wgpu::Buffer> = None;
        for reach in REACHES {
            if self.most <= done {
                break;
            }
            let per_weight = 2.0 * (reach * reach) as f32;
            let params = WidenParams {
                size: pixels(cells.size),
                reach: reach as i32,
                done,
                per_weight,
                max_weight: MAX_WEIGHT,
                connected_px: CONNECTED_PX,
                _gap: 0,
                footprint: self.footprint,
            };
            let target = spare.take().map_or_else(|| self.buffer(commands), Ok)?;
            let source = widened.as_ref().unwrap_or(colors);
            let buffers = [Read(&self.variances), Read(&cells.shifts), Read(source), Write(&target)];
            commands.pass(&WIDEN, channels, &params, &buffers, self.on_all())?;
            spare = widened.replace(target);
            done += MAX_WEIGHT * per_weight;
        }
        Ok(Widened { colors: widened.unwrap_or_else(|| colors.clone()), spare })
    }

    fn on_all(&self) -> [u32; 3] {
        let [across, down, _] = groups(self.cells.size.width, self.cells.size.height);
        [across, down, self.cells.layers as u32]
    }

    fn buffer(&self, commands: &mut Commands) -> Result<wgpu::Buffer> {
        commands.scratch::<[f32; 4]>("the colours as they are drawn", self.cells.len())
    }
}
