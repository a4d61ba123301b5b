//! Carries out [`plan::sprites`](crate::plan::sprites).
//!
//! Points are put into bins of some columns and rows, each with a bit for every point that is drawn and with the
//! distance that its sprites reach. Then every workgroup owns a tile of a target of half the size: it goes through the
//! bins that reach it, and each of its texels adds up the sprites that cover it. The targets are resolved over the
//! picture. Bins come in the order of the picture, so that every run adds the same numbers in the same order.

mod table;

pub use table::Table;

use super::bands::Requirements;
use super::commands::Bound::{self, Read, Write};
use super::commands::{Commands, GROUP, groups, pixels};
use super::picture::GpuPicture;
use super::shader::{Defocus, Shader, shader, shared};
use crate::error::Result;
use crate::optics::{Measure, Optics};
use crate::plan::sprites::{Settings, step};
use std::ops::RangeInclusive;
use table::{Sprite, boundaries};

pub const BIN: Shader = shader!(
    "sprites/bin",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/points"],
    [Params, Sprite, Bin, Defocus]
);
pub const GATHER: Shader = shader!(
    "sprites/gather",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/points"],
    [Params, Sprite, Bin, Defocus]
);
pub const BEHIND: Shader = shader!(
    "sprites/behind",
    ["mirror", "picture", "depth", "defocus", "sprites/circles", "sprites/light"],
    [Params, Defocus]
);
pub const REST: Shader = shader!(
    "sprites/rest",
    ["mirror", "picture", "depth", "interleaved", "defocus", "sprites/circles", "sprites/spans"],
    [Params, Defocus]
);
pub const IN_FRONT: Shader = shader!(
    "sprites/in_front",
    [
        "mirror",
        "picture",
        "depth",
        "interleaved",
        "defocus",
        "sprites/circles",
        "sprites/light",
        "sprites/spans"
    ],
    [Params, Defocus]
);

/// Number of columns and rows of points in a bin.
pub const BIN_SIZE: [usize; 2] = [32, 8];
/// Number of pixels of a row after which sums begin anew.
pub const SPAN: usize = 256;
/// The largest number of loop iterations of an invocation of [`GATHER`] in one pass; more work is divided among passes.
/// So no pass takes so long that a driver ends it, and the limit of software rasterisers is not reached.
const MAX_LOOPS: usize = 40_000;

shared! {
    struct Params {
        size: [u32; 2],
        half: [u32; 2],
        first_bin: [i32; 2],
        bins: [u32; 2],
        reach: i32,
        boundaries: u32,
        first_step: u32,
        layer: u32,
        first_row: i32,
        end_row: i32,
        threshold_px: f32,
        max_coc_px: f32,
        top: u32,
        _gap: [u32; 3],
        shift: Defocus,
    }
}

shared! {
    struct Bin {
        least: [i32; 2],
        greatest: [i32; 2],
        rows: [u32; BIN_SIZE[1]],
        before: [u32; BIN_SIZE[1]],
        count: u32,
        _end: u32,
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

/// A layer to which sprites belong.
#[derive(Debug, Clone, Copy)]
pub enum Depth {
    InFront = 0,
    Behind = 1,
}

/// What the method requires of a device. Sprites are padded to whole pixels of the targets, and the search for the
/// background behind the layer in front reads as far again.
pub fn requirements(settings: &Settings, largest_px: f64) -> Requirements {
    let reach_px = largest_px.min(settings.max_coc_px()).ceil() as usize + 6;
    let (color, light) = (size_of::<[f32; 4]>(), size_of::<[f32; 4]>() + size_of::<f32>());
    // The sums of the rest, of which there are a few more than pixels.
    let (bytes_per_px, sums) = (color + color.div_ceil(SPAN), light + light.div_ceil(SPAN));
    // With them, for every fourth pixel the light of two layers, and the bins of both.
    let bins = (2 * size_of::<Bin>()).div_ceil(BIN_SIZE[0] * BIN_SIZE[1]);
    let all_bytes_per_px = sums + (2 * light).div_ceil(4) + bins;
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
    let bins = Bins::new([size.width, size.height], reach);
    let params = Params {
        size: pixels(size),
        half: [size.width, size.height].map(|pixels| pixels.div_ceil(2) as u32),
        first_bin: bins.first,
        bins: bins.count,
        reach: reach as i32,
        boundaries: boundaries.len() as u32,
        first_step: table.number(*steps.start()) as u32,
        layer: 0,
        first_row: 0,
        end_row: 0,
        threshold_px: settings.threshold_px() as f32,
        max_coc_px: settings.max_coc_px() as f32,
        top: 0,
        _gap: [0; 3],
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
        let spans = size.width.div_ceil(SPAN);
        let sums = (size.width + spans) * size.height;
        let colors = commands.scratch::<[f32; 4]>("the sums of what is not in front", sums)?;
        let seen = commands.scratch::<f32>("how much of it there is", sums)?;
        let buffers = [input[0], input[1], Read(&picture), Write(&colors), Write(&seen)];
        commands.pass(&REST, size.channels, &params, &buffers, [size.height as u32, spans as u32, 1])?;
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

/// The bins of a picture and of its mirror images within reach.
struct Bins {
    /// Column and row of the first one; the bin that begins with the picture is in column and row 0.
    first: [i32; 2],
    /// Number of columns and rows.
    count: [u32; 2],
}

impl Bins {
    fn new(size: [usize; 2], reach: usize) -> Bins {
        let before = BIN_SIZE.map(|side| reach.div_ceil(side));
        let count = |i: usize| before[i] + (size[i] + reach).div_ceil(BIN_SIZE[i]);
        Bins { first: before.map(|count| -(count as i32)), count: [count(0) as u32, count(1) as u32] }
    }
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
    fn buffers(&self) -> [Bound<'_>; 4] {
        let Points { scene, disparity, table, boundaries, .. } = self;
        [Read(&scene.color), Read(disparity), Read(boundaries), Read(&table.sprites)]
    }

    /// The light of the layers in front and behind, if any of these steps are in them.
    fn layers(&self, commands: &mut Commands, steps: &RangeInclusive<i32>) -> Result<[Option<Light>; 2]> {
        let wanted = [*steps.start() < 0, *steps.end() > 0].map(|any| any && self.reach > 0);
        if wanted == [false; 2] {
            return Ok([None, None]);
        }
        let bins = self.bins(commands)?;
        let mut layer =
            |depth: Depth| wanted[depth as usize].then(|| self.gather(commands, depth, &bins)).transpose();
        Ok([layer(Depth::InFront)?, layer(Depth::Behind)?])
    }

    /// The bins of both layers.
    fn bins(&self, commands: &mut Commands) -> Result<wgpu::Buffer> {
        let [across, down] = self.params.bins;
        let bins = commands.scratch::<Bin>("the bins of sprites", 2 * across as usize * down as usize)?;
        let [color, disparity, boundaries, sprites] = self.buffers();
        let buffers = [color, disparity, boundaries, sprites, Write(&bins)];
        commands.pass(&BIN, self.scene.size.channels, &self.params, &buffers, [across, down, 2])?;
        Ok(bins)
    }

    /// Adds up the sprites of one layer.
    fn gather(&self, commands: &mut Commands, depth: Depth, bins: &wgpu::Buffer) -> Result<Light> {
        let [width, height] = self.params.half.map(|v| v as usize);
        let light = Light::new(commands, width * height)?;
        let [color, disparity, boundaries, sprites] = self.buffers();
        let tables = [boundaries, sprites, Read(bins), Read(&self.table.weights)];
        let buffers: Vec<_> = [color, disparity]
            .into_iter()
            .chain(tables)
            .chain([Write(&light.color), Write(&light.coverage)])
            .collect();
        // The rows of bins within reach of a tile, which is as high as so many points and begins with a bin.
        let rows = (2 * GROUP + self.reach) / BIN_SIZE[1] + 1 + self.reach.div_ceil(BIN_SIZE[1]);
        let at_once = (MAX_LOOPS / self.loops_of_row()).max(1);
        for first_row in (0..rows).step_by(at_once) {
            let end_row = (first_row + at_once).min(rows);
            let params = |top| Params {
                layer: depth as u32,
                first_row: first_row as i32,
                end_row: end_row as i32,
                top,
                ..self.params
            };
            let points = (end_row - first_row) * BIN_SIZE[1] * self.points_across();
            commands.rows(&GATHER, self.scene.size.channels, params, &buffers, (width, height, points))?;
        }
        Ok(light)
    }

    /// The largest number of points in a row that cover one texel.
    fn points_across(&self) -> usize {
        2 * self.reach + 2
    }

    /// The largest number of loop iterations of an invocation for a row of bins: for each bin those that list it, hold its
    /// points and add them, with the search for the step of a point and with the bin's rows, and in each row the points.
    fn loops_of_row(&self) -> usize {
        let [columns, rows] = BIN_SIZE;
        let across = (2 * GROUP + 2 * self.reach).div_ceil(columns) + 2;
        let search = (u32::BITS - self.params.boundaries.leading_zeros()) as usize;
        // A list of up to 256 bins takes 9.
        9 + across * (3 + search + rows) + rows * self.points_across()
    }
}
