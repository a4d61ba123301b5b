//! Carries out [`plan::sprites`](crate::plan::sprites).
//!
//! Points are appended to a list, drawn as instanced quads that the device blends into targets of half the size, and
//! resolved over the picture. The list is in the order of the picture: each workgroup counts its points, and the
//! prefix sums of these counts are the positions at which each workgroup appends its own. Quads are blended in the
//! order of the list, so that every run adds the same numbers in the same order.

mod table;

pub use table::Table;

use super::bands::Requirements;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::draw::{Draw, Targets};
use super::picture::GpuPicture;
use super::shader::{Defocus, Shader, shader, shared};
use crate::error::Result;
use crate::optics::{Measure, Optics};
use crate::plan::sprites::{Settings, step};
use std::ops::RangeInclusive;
use table::{Sprite, boundaries};

pub const COUNT: Shader = shader!(
    "sprites/count",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/points"],
    [Params, Sprite, Defocus]
);
pub const OFFSETS: Shader = shader!("sprites/offsets", [], [OffsetParams]);
pub const APPEND: Shader = shader!(
    "sprites/append",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/points"],
    [Params, Sprite, Point, Defocus]
);
pub const PLACE: Shader = shader!(
    "sprites/place",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/points", "sprites/quad"],
    [Params, Sprite, Point, Defocus]
);
pub const WEIGH: Shader = shader!("sprites/weigh", ["sprites/quad"], []);
pub const GATHER: Shader = shader!(
    "sprites/gather",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/points"],
    [Params, Sprite, Defocus]
);
pub const BEHIND: Shader = shader!(
    "sprites/behind",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/light"],
    [Params, Defocus]
);
pub const REST: Shader = shader!(
    "sprites/rest",
    ["mirror", "picture", "depth", "interleaved", "defocus", "sprites/circles"],
    [Params, Defocus]
);
pub const IN_FRONT: Shader = shader!(
    "sprites/in_front",
    ["mirror", "picture", "depth", "interleaved", "defocus", "sprites/circles", "sprites/light"],
    [Params, Defocus]
);

const DRAW: Draw = Draw { name: "sprites/draw", vertex: &PLACE, fragment: &WEIGH };

/// Number of points of one workgroup.
pub const CHUNK: usize = 256;
/// Number of workgroups in a row of them; a device may be limited to 65535.
const MOST_ACROSS: usize = 1 << 14;
/// The largest number of pixels that an invocation of [`GATHER`] reads in one pass.
const MAX_READS: usize = 30_000;
/// Number of words of one indirect draw.
const DRAW_WORDS: usize = 4;

shared! {
    struct Params {
        size: [u32; 2],
        half: [u32; 2],
        pitch: u32,
        reach: i32,
        boundaries: u32,
        first_step: u32,
        groups_across: u32,
        layer: u32,
        first_row: i32,
        end_row: i32,
        threshold_px: f32,
        max_coc_px: f32,
        top: u32,
        _gap: u32,
        shift: Defocus,
    }
}

shared! {
    struct OffsetParams {
        groups: u32,
    }
}

shared! {
    struct Point {
        number: u32,
        step: u32,
    }
}

/// The light of one layer.
struct Light {
    color: wgpu::Buffer,
    coverage: wgpu::Buffer,
}

impl Light {
    fn new(commands: &mut Commands, values: usize) -> Result<Light> {
        Ok(Light {
            color: commands.scratch::<[f32; 4]>("the light of sprites", values)?,
            coverage: commands.scratch::<f32>("the coverage of sprites", values)?,
        })
    }
}

/// A layer into which sprites are drawn.
#[derive(Debug, Clone, Copy)]
pub enum Depth {
    InFront = 0,
    Behind = 1,
}

/// What the method requires of a device. Sprites are padded to whole pixels of the targets, and the search for the
/// background behind the layer in front reads as far again.
pub fn requirements(settings: &Settings, largest_px: f64) -> Requirements {
    let reach_px = largest_px.min(settings.max_coc_px()).ceil() as usize + 6;
    let bytes_per_px = size_of::<[f32; 4]>();
    // The list, the sums of the rest, and for every fourth pixel the light of two layers and the targets.
    let light = size_of::<[f32; 4]>() + size_of::<f32>();
    let all_bytes_per_px = size_of::<Point>() + light + (3 * light).div_ceil(4);
    let reaching = Requirements::reaching(2 * reach_px);
    Requirements { bytes_per_px, all_bytes_per_px, around_px: reach_px, block_px: 2, ..reaching }
}

/// The step with which sprites at a disparity are drawn.
fn step_at(optics: &Optics, settings: &Settings, d: f32) -> i32 {
    step(settings.cut(-optics.shift_px(f64::from(d))))
}

/// The steps of all sprites of a picture.
pub fn steps(scene: &GpuPicture, optics: &Optics, settings: &Settings) -> RangeInclusive<i32> {
    let [least, greatest] = scene.disparity_range;
    step_at(optics, settings, greatest)..=step_at(optics, settings, least)
}

/// Renders the picture with a table that contains all its [`steps`].
pub fn render(
    commands: &mut Commands,
    table: &Table,
    scene: &GpuPicture,
    optics: &Optics,
    settings: &Settings,
) -> Result<wgpu::Buffer> {
    let gpu = commands.gpu;
    let size = scene.size;
    let steps = steps(scene, optics, settings);
    let step_at = |d: f32| step_at(optics, settings, d);
    let reach = table.reach(&steps);
    let boundaries = boundaries(scene.disparity_range, &steps, step_at);
    let half = (size.width.div_ceil(2), size.height.div_ceil(2));
    let params = Params {
        size: pixels(size),
        half: [half.0 as u32, half.1 as u32],
        pitch: Targets::pitch(half.0) as u32,
        reach: reach as i32,
        boundaries: boundaries.len() as u32,
        first_step: table.number(*steps.start()) as u32,
        groups_across: 0,
        layer: 0,
        first_row: 0,
        end_row: 0,
        threshold_px: settings.threshold_px() as f32,
        max_coc_px: settings.max_coc_px() as f32,
        top: 0,
        _gap: 0,
        shift: optics.defocus(Measure::Shift, 1.0).into(),
    };
    let boundaries = gpu.upload("the boundaries between steps", &boundaries)?;
    let disparity = scene.disparity()?;
    let points = Points { scene, disparity: &disparity, table, boundaries, params, reach };
    let [in_front, behind] = points.layers(commands, &steps)?;
    let picture = commands.output(size)?;

    let on_all = groups(size.width, size.height);
    let input = [Read(&scene.color), Read(&disparity)];
    // If no pixel is behind the focus, the light of that layer is never read.
    let behind = behind.map_or_else(|| Light::new(commands, 1), Ok)?;
    let buffers = [input[0], input[1], Read(&behind.color), Read(&behind.coverage), Write(&picture)];
    commands.pass(&BEHIND, size.channels, &params, &buffers, on_all)?;
    if let Some(light) = &in_front {
        let sums = (size.width + 1) * size.height;
        let colors = commands.scratch::<[f32; 4]>("the sums of what is not in front", sums)?;
        let seen = commands.scratch::<f32>("how much of it there is", sums)?;
        let buffers = [input[0], input[1], Read(&picture), Write(&colors), Write(&seen)];
        commands.pass(&REST, size.channels, &params, &buffers, [size.height as u32, 1, 1])?;
        let sums = [Read(&colors), Read(&seen)];
        let light = [Read(&light.color), Read(&light.coverage)];
        let buffers = [input[0], input[1], light[0], light[1], sums[0], sums[1], Write(&picture)];
        // A pixel in front reads the rows of a square.
        let work = (size.width, size.height, 1 + 2 * points.reach);
        let params = |top| Params { top, ..params };
        commands.rows(&IN_FRONT, size.channels, params, &buffers, work)?;
    }
    Ok(picture)
}

/// The points that are drawn.
struct Points<'a> {
    scene: &'a GpuPicture,
    disparity: &'a wgpu::Buffer,
    table: &'a Table,
    boundaries: wgpu::Buffer,
    params: Params,
    reach: usize,
}

impl Points<'_> {
    fn buffers(&self) -> [super::commands::Bound<'_>; 4] {
        let Points { scene, disparity, table, boundaries, .. } = self;
        [Read(&scene.color), Read(disparity), Read(boundaries), Read(&table.sprites)]
    }

    /// The light of the layers in front and behind, if any of these steps are in them.
    fn layers(&self, commands: &mut Commands, steps: &RangeInclusive<i32>) -> Result<[Option<Light>; 2]> {
        let wanted = [*steps.start() < 0, *steps.end() > 0].map(|any| any && self.reach > 0);
        let half = self.params.half.map(|v| v as usize);
        if wanted == [false; 2] {
            return Ok([None, None]);
        }
        let targets = Targets::new(commands.gpu, half[0], half[1]);
        let list = targets.map(|targets| Ok((targets, self.list(commands)?))).transpose()?;
        let mut layer = |depth: Depth| -> Result<Option<Light>> {
            if !wanted[depth as usize] {
                return Ok(None);
            }
            let light = Light::new(commands, self.params.pitch as usize * half[1])?;
            match &list {
                Some((targets, list)) => self.draw(commands, depth, targets, list, &light),
                None => self.gather(commands, depth, &light),
            }?;
            Ok(Some(light))
        };
        Ok([layer(Depth::InFront)?, layer(Depth::Behind)?])
    }

    /// The list of all points, and the two indirect draws for it.
    fn list(&self, commands: &mut Commands) -> Result<(wgpu::Buffer, wgpu::Buffer)> {
        let size = self.scene.size;
        let all = (size.width + 2 * self.reach) * (size.height + 2 * self.reach);
        let chunks = all.div_ceil(CHUNK);
        let across = chunks.min(MOST_ACROSS);
        let groups = [across as u32, chunks.div_ceil(across) as u32, 1];
        let chunks = across * groups[1] as usize;
        let params = Params { groups_across: across as u32, ..self.params };
        let offsets = commands.scratch::<[u32; 2]>("the places in the list", chunks)?;
        let draws = commands.indirect("the draws", 2 * DRAW_WORDS)?;
        let list = commands.scratch::<Point>("the list of sprites", all)?;

        let [color, disparity, boundaries, sprites] = self.buffers();
        let buffers = [color, disparity, boundaries, sprites, Write(&offsets)];
        commands.pass(&COUNT, size.channels, &params, &buffers, groups)?;
        let of_groups = OffsetParams { groups: chunks as u32 };
        commands.pass(&OFFSETS, size.channels, &of_groups, &[Write(&offsets), Write(&draws)], [1, 1, 1])?;
        let buffers = [color, disparity, boundaries, sprites, Read(&offsets), Write(&list)];
        commands.pass(&APPEND, size.channels, &params, &buffers, groups)?;
        Ok((list, draws))
    }

    fn draw(
        &self,
        commands: &mut Commands,
        depth: Depth,
        targets: &Targets,
        (list, draws): &(wgpu::Buffer, wgpu::Buffer),
        light: &Light,
    ) -> Result<()> {
        let params = Params { layer: depth as u32, ..self.params };
        let [color, disparity, boundaries, sprites] = self.buffers();
        let buffers = [color, disparity, boundaries, sprites, Read(list), Read(&self.table.weights)];
        let place = (depth as usize * DRAW_WORDS * size_of::<u32>()) as u64;
        commands.draw(&DRAW, self.scene.size.channels, &params, &buffers, (draws, place), targets)?;
        targets.copy(commands, &light.color, &light.coverage);
        Ok(())
    }

    fn gather(&self, commands: &mut Commands, depth: Depth, light: &Light) -> Result<()> {
        let [color, disparity, boundaries, sprites] = self.buffers();
        let input = [color, disparity, boundaries, sprites, Read(&self.table.weights)];
        let buffers: Vec<_> =
            input.into_iter().chain([Write(&light.color), Write(&light.coverage)]).collect();
        let [width, height] = self.params.half.map(|v| v as usize);
        let reach = self.reach as i32;
        let rows_at_once = (MAX_READS / (2 * self.reach + 2)).max(1);
        for first_row in (-reach..reach + 2).step_by(rows_at_once) {
            let end_row = (first_row + rows_at_once as i32).min(reach + 2);
            let params = |top| Params { layer: depth as u32, first_row, end_row, top, ..self.params };
            let work = (width, height, rows_at_once * (2 * self.reach + 2));
            commands.rows(&GATHER, self.scene.size.channels, params, &buffers, work)?;
        }
        Ok(())
    }
}
