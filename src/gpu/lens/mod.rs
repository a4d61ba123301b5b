//! Carries out [`plan::lens`](crate::plan::lens).
//!
//! The layered scene stays on the device; another focus only uploads its plan. [`colors`] prepares the cells' colours
//! for the focus. Then each tile is in focus, an exact [`disc`], a [`sweep`] or in part both, and [`highlights`] are added to them.

pub(super) mod colors;
pub(super) mod disc;
pub(super) mod edges;
pub(super) mod frame;
pub(super) mod group;
pub(super) mod highlights;
mod kernels;
pub(super) mod layered;
mod listed;
pub(super) mod optical_vignetting;
pub(super) mod replace;
pub(super) mod sweep;
#[cfg(test)]
mod tests;

pub use frame::Input;
pub use layered::Cells;

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, pixels};
use super::picture::GpuPicture;
use super::shader::{Shader, shader, shared};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::footprint::REACHES;
use crate::plan::lens::highlights::Highlights;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::padding::Margin;
use crate::plan::lens::tiles::{self, Work};
use crate::plan::lens::{Plan, Settings, check_full_resolution, reach_px};
use crate::scene::grid::{BLOCK, TILE};
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use colors::Drawing;
use disc::Discs;
use frame::{GROUPS, LensFrame, Target, origin, units};
use group::Group;
use highlights::HighlightDiscs;
use kernels::Kernels;
use sweep::Sweep;

pub const IN_FOCUS: Shader =
    shader!("lens/in_focus", ["mirror", "picture", "lens/depth_spans"], [InFocusParams]);

shared! {
    /// Parameters for tiles in focus.
    struct InFocusParams {
        size: [u32; 2],
        layers: u32,
        cell_layers: u32,
        loss_per_px2: [f32; 2],
        s_focus: f32,
        first_tile: u32,
        own_channels: u32,
    }
}

/// What the method requires of a device. Rays reach as far as the largest circle of confusion around the tiles. Cells
/// are widened by the sum of all [`REACHES`], and highlights are found by the blocks around them.
pub fn requirements(scene: &LayeredScene, optics: &Optics) -> Requirements {
    let s_focus = optics.k * optics.d_focus;
    let reach_px = reach_px(scene, s_focus);
    let beyond = REACHES.iter().sum::<usize>() + 4 * BLOCK;
    let bytes_per_px = size_of::<[f32; 4]>() * scene.layers.len();
    // The colours without highlights for discs and for the sweep, and twice as they are drawn; those of one colour; and
    // sums along rows.
    let all_bytes_per_px = (2 + 2 + 1) * bytes_per_px + size_of::<[f32; 4]>() + size_of::<f32>();
    let kept_bytes_per_px = bytes_per_px + layered::OTHER_BYTES_PER_CELL * scene.layers.len();
    Requirements {
        bytes_per_px,
        all_bytes_per_px,
        kept_bytes_per_px,
        block_px: TILE.1,
        ..Requirements::reaching(reach_px.ceil() as usize + beyond)
    }
}

/// What is rendered of a frame under one focus on a device: all that does not depend on the channels.
struct Passes<'a> {
    frame: LensFrame<'a>,
    in_focus: Option<InFocus<'a>>,
    drawing: Drawing<'a>,
    sweep: Option<Sweep<'a>>,
    discs: Option<Discs<'a>>,
    highlights: Option<HighlightDiscs<'a>>,
}

impl Passes<'_> {
    /// Renders a group of channels. If a picture carries it, `guide` is [the picture's own](Drawing::guide).
    fn render(
        &self,
        commands: &mut Commands,
        group: &Group,
        guide: Option<(&wgpu::Buffer, Size)>,
    ) -> Result<wgpu::Buffer> {
        let cells = self.frame.cells;
        let picture = commands.output(group.size)?;
        let target = Target { picture: &picture, channels: group.size.channels };
        let dim = colors::dim(commands, cells, group, &group.dimmed)?;
        if let Some(in_focus) = &self.in_focus {
            in_focus.pass(commands, target, group)?;
        }
        if let Some(sweep) = &self.sweep {
            let swept = match &group.swept {
                Some(swept) => colors::dim(commands, cells, group, swept)?,
                None => dim.clone(),
            };
            let drawn = self.drawing.drawn(commands, group, &swept, guide)?;
            sweep.pass(commands, target, &drawn)?;
        }
        if let Some(discs) = &self.discs {
            discs.pass(commands, target, &dim)?;
        }
        if let Some(highlights) = self.highlights.as_ref().filter(|_| !group.light.is_empty()) {
            highlights.pass(commands, target, &group.light)?;
        }
        Ok(picture)
    }

    /// The colours by which the channels are sharpened that a picture carries, if any are swept.
    fn guide(&self, commands: &mut Commands, own: &Group) -> Result<Option<wgpu::Buffer>> {
        if self.sweep.is_none() {
            return Ok(None);
        }
        let colors = colors::dim(commands, self.frame.cells, own, own.swept.as_ref().unwrap_or(&own.dimmed))?;
        self.drawing.guide(commands, own.size, &colors).map(Some)
    }
}

/// Renders the picture through a lens; or, if it carries channels, these in its place. Each group of channels is given to
/// `take`, with its number, before the next one is rendered; its buffer is used again afterwards.
pub fn render(
    commands: &mut Commands,
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    (simd, cancel): (Simd, &Cancel),
    mut take: impl FnMut(&mut Commands, usize, &wgpu::Buffer) -> Result<()>,
) -> Result<()> {
    let Input { picture, scene, cells, supersample } = *input;
    let size = scene.size;
    check_full_resolution(reach_px(scene, optics.k * optics.d_focus))?;
    let tiles = (Margin::Period, tiles::origins(size.width, size.height));
    let plan = Plan::new(scene, optics, settings, supersample, tiles, simd);
    cancel.check()?;
    let highlights = Highlights::new(scene, &plan, simd);
    let kernels = Kernels::new(scene, &plan, &highlights, &settings.aperture, cancel)?;

    let clip = settings.second_stop.map(|second_stop| PupilClip::new(second_stop, &settings.aperture));
    let frame = LensFrame { cells, codes: &scene.codes, plan: &plan, clip: clip.as_ref() };
    let passes = Passes {
        in_focus: InFocus::new(commands, &frame, picture)?,
        drawing: Drawing::new(commands, cells, &plan)?,
        sweep: Sweep::new(commands, &frame)?,
        discs: Discs::new(commands, &frame, &kernels)?,
        highlights: HighlightDiscs::new(commands, &frame, &kernels, &highlights, &settings.aperture)?,
        frame,
    };
    let own = Group::of_picture(input, &highlights);
    if picture.carried().is_empty() {
        let rendered = passes.render(commands, &own, None)?;
        return take(commands, 0, &rendered);
    }
    let guide = passes.guide(commands, &own)?;
    let mark = commands.mark();
    for g in 0..picture.carried().len() {
        cancel.check()?;
        commands.recycle(mark);
        let group = Group::carried(commands, input, &highlights, g)?;
        let rendered = passes.render(commands, &group, guide.as_ref().map(|guide| (guide, own.size)))?;
        take(commands, g, &rendered)?;
    }
    Ok(())
}

/// The tiles that are in focus.
struct InFocus<'a> {
    cells: &'a Cells,
    /// The picture's own planes, the last of which in each layer is its coverage.
    color: wgpu::Buffer,
    params: InFocusParams,
    tiles: wgpu::Buffer,
    count: usize,
}

impl<'a> InFocus<'a> {
    /// Uploads the tiles; `None` if there are none.
    fn new(commands: &Commands, frame: &LensFrame<'a>, picture: &GpuPicture) -> Result<Option<InFocus<'a>>> {
        let LensFrame { cells, plan, .. } = *frame;
        let tiles = plan.tiles.iter().filter(|tile| tile.work == Work::InFocus);
        let origins: Vec<[u32; 2]> = tiles.map(|tile| origin(tile.origin)).collect();
        if origins.is_empty() {
            return Ok(None);
        }
        let params = InFocusParams {
            size: pixels(picture.size),
            layers: 0,
            cell_layers: cells.layers as u32,
            loss_per_px2: plan.in_focus.loss_per_px2,
            s_focus: plan.s_focus as f32,
            first_tile: 0,
            own_channels: picture.size.channels as u32,
        };
        Ok(Some(InFocus {
            cells,
            color: picture.color.clone(),
            params,
            tiles: commands.gpu.upload("the tiles in focus", &origins)?,
            count: origins.len(),
        }))
    }

    /// Renders the tiles.
    fn pass(&self, commands: &mut Commands, target: Target, group: &Group) -> Result<()> {
        let (planes, layers) = &group.planes;
        let work = vec![units(1); self.count];
        let buffers = [
            Read(planes),
            Read(&self.color),
            Read(&self.tiles),
            Read(&self.cells.shifts),
            Write(target.picture),
        ];
        let params = |first_tile| InFocusParams { layers: *layers as u32, first_tile, ..self.params };
        commands.tiles(&IN_FOCUS, target.channels, params, &buffers, (&work, GROUPS))
    }
}
