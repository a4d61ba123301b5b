//! A layered scene on a device.
//!
//! What the picture does not have is taken there and nothing else: shifts, the cells that are [listed], and where
//! surfaces end. From that and from the picture, which is there already, the device makes the cells.

use super::edges;
use super::listed::{self, Listed};
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, groups, pixels};
use crate::gpu::picture::GpuPicture;
use crate::gpu::shader::{Shader, shader, shared};
use crate::picture::Size;
use crate::scene::edges::CONNECTED_PX;
use crate::scene::layer::{Role, SceneLayer};
use crate::scene::layered::LayeredScene;
use std::ops::Range;
use wgpu::BufferUsages;

pub const CELLS: Shader = shader!("lens/cells", ["picture", "lens/depth_spans"], [CellsParams]);
pub const SPANS: Shader = shader!("lens/spans", ["lens/depth_spans", "lens/neighbours"], [SpansParams]);
pub const CHANNELS: Shader = shader!("lens/channels", [], [ChannelsParams]);

shared! {
    /// Parameters for the cells of one layer.
    struct CellsParams {
        size: [u32; 2],
        first: u32,
        planes: u32,
        covered: u32,
        listed_shifts: u32,
        color_words: u32,
        shift_words: u32,
        number_words: u32,
    }
}

shared! {
    /// Parameters for the depths that cells span.
    struct SpansParams {
        size: [u32; 2],
        layers: u32,
        connected_px: f32,
        least: f32,
        per_px: f32,
    }
}

shared! {
    /// Parameters for a selection of channels.
    struct ChannelsParams {
        size: [u32; 2],
        channels: [u32; 2],
    }
}

/// The shift of an empty cell, because shaders cannot rely on NaN.
#[cfg(test)]
pub const NOWHERE: f32 = 1e30;
/// In place of the first plane of the picture that a layer has: it has none.
pub const NO_PLANES: u32 = u32::MAX;
/// Bytes of a cell beside its colour: its codes, its shift, and a half-plane's number; half-planes are few, and those of
/// edges that fill a quarter of the picture have as many bytes; and a bit for where surfaces end.
pub const OTHER_BYTES_PER_CELL: usize = 4 + 4 + 4 + 4 + 1;

/// The cells of all layers, one layer after another.
pub struct Cells {
    pub size: Size,
    /// Number of layers.
    pub layers: usize,
    /// The number of the picture's first layer.
    pub front: usize,
    /// What the pinhole sees behind holdouts, if there are any, in planes.
    pub held: Option<wgpu::Buffer>,
    /// Depth spans: the farthest code in the low half, the nearest in the high half.
    pub codes: wgpu::Buffer,
    pub shifts: wgpu::Buffer,
    /// See [`edges::words`].
    pub edges: wgpu::Buffer,
    /// Four channels per cell.
    pub colors: wgpu::Buffer,
    /// For each cell 0, or one more than the index of its half-plane; then the half-planes, four words each.
    pub half_planes: wgpu::Buffer,
    /// For each layer whether it is a holdout.
    pub holdouts: Vec<u32>,
}

impl Cells {
    /// Takes rows of a layered scene to a device that has the same rows of its picture.
    ///
    /// The passes that make the cells are submitted at once: others may then use what is kept.
    pub fn new(
        commands: &mut Commands,
        picture: &GpuPicture,
        scene: &LayeredScene,
        rows: &Range<usize>,
    ) -> Result<Cells> {
        let gpu = commands.gpu;
        let size = Size { height: rows.len(), ..scene.size };
        let range = rows.start * size.width..rows.end * size.width;
        let (n, layers) = (size.pixels(), scene.layers.len());
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let buffer = |what, bytes: usize| gpu.buffer(what, bytes, usage);
        let half_planes: Vec<[f32; 4]> = half_planes(&scene.layers, &range);
        let number_bytes = size_of::<u32>() * n * layers;
        let held = scene.held.as_ref().map(|held| {
            const WHAT: &str = "the picture behind holdouts";
            let plane_bytes = size_of::<f32>() * n;
            let planes = buffer(WHAT, plane_bytes * size.channels)?;
            for (c, plane) in held.own.chunks(scene.size.pixels()).enumerate() {
                gpu.write(WHAT, &planes, plane_bytes * c, bytemuck::cast_slice(&plane[range.clone()]))?;
            }
            Ok(planes)
        });
        let cells = Cells {
            size,
            layers,
            front: scene.front,
            held: held.transpose()?,
            codes: buffer("the depths of all cells", size_of::<u32>() * n * layers)?,
            shifts: buffer("the shifts of all cells", size_of::<f32>() * n * layers)?,
            edges: gpu.upload("where surfaces end", &edges::words(&scene.layers, range.clone()))?,
            colors: buffer("the colours of all cells", size_of::<[f32; 4]>() * n * layers)?,
            half_planes: buffer("the half-planes of all cells", number_bytes + size_of_val(&*half_planes))?,
            holdouts: scene.layers.iter().map(|layer| u32::from(layer.role == Role::Holdout)).collect(),
        };
        let planes = bytemuck::cast_slice(&half_planes);
        gpu.write("the half-planes of all cells", &cells.half_planes, number_bytes, planes)?;
        cells.lay_out(commands, picture, scene, &range)?;
        cells.span_depths(commands, scene)?;
        commands.flush()?;
        Ok(cells)
    }

    /// Makes the cells of each layer, a range of whose pixels these are.
    fn lay_out(
        &self,
        commands: &mut Commands,
        picture: &GpuPicture,
        scene: &LayeredScene,
        range: &Range<usize>,
    ) -> Result<()> {
        let (gpu, size, n) = (commands.gpu, self.size, self.size.pixels());
        let coverage = picture.coverage();
        let mut numbers = 0;
        for (l, (layer, of_picture)) in scene.layers.iter().zip(scene.layers_of_picture()).enumerate() {
            let coverage = of_picture.and_then(|number| coverage.get(number).copied());
            let Listed { record, places, words } = Listed::new(layer, range.clone(), coverage, numbers);
            numbers += layer.partial_in(range.clone()).len();
            let listed_shifts = layer.role == Role::Surface && layer.colors.is_list();
            if !listed_shifts {
                let own = bytemuck::cast_slice(&layer.s[range.clone()]);
                gpu.write("the shifts of all cells", &self.shifts, size_of::<f32>() * n * l, own)?;
            }
            // If no cell is listed, none is looked up.
            let record = if words.is_empty() { listed::Record::NOTHING } else { record };
            let params = CellsParams {
                size: pixels(size),
                first: (n * l) as u32,
                planes: of_picture.map_or(NO_PLANES, |number| (size.channels * number) as u32),
                covered: u32::from(coverage.is_some()),
                listed_shifts: u32::from(listed_shifts),
                color_words: record.color as u32,
                shift_words: record.shift as u32,
                number_words: record.number as u32,
            };
            let places = gpu.upload("the places of listed cells", &places)?;
            let words = gpu.upload("the listed cells", &words)?;
            let buffers = [
                Read(&picture.color),
                Read(&places),
                Read(&words),
                Write(&self.colors),
                Write(&self.shifts),
                Write(&self.half_planes),
            ];
            commands.pass(&CELLS, size.channels, &params, &buffers, groups(size.width, size.height))?;
        }
        Ok(())
    }

    /// Finds the depths that the cells span.
    fn span_depths(&self, commands: &mut Commands, scene: &LayeredScene) -> Result<()> {
        let [least, per_px] = scene.codes.scale();
        let params = SpansParams {
            size: pixels(self.size),
            layers: self.layers as u32,
            connected_px: CONNECTED_PX,
            least,
            per_px,
        };
        let [across, down, _] = groups(self.size.width, self.size.height);
        let buffers = [Write(&self.codes), Read(&self.shifts), Read(&self.edges)];
        commands.pass(&SPANS, self.size.channels, &params, &buffers, [across, down, self.layers as u32])
    }

    /// The same cells with only one or two channels of their colours, for one job.
    pub fn of_channels(&self, commands: &mut Commands, channels: &[usize]) -> Result<Cells> {
        const NONE: u32 = 4;
        let colors = commands.scratch::<[f32; 4]>("some channels of all cells", self.len())?;
        let number = |i: usize| channels.get(i).map_or(NONE, |c| *c as u32);
        let params = ChannelsParams { size: pixels(self.size), channels: [number(0), number(1)] };
        let [across, down, _] = groups(self.size.width, self.size.height);
        let buffers = [Read(&self.colors), Write(&colors)];
        commands.pass(&CHANNELS, NONE as usize, &params, &buffers, [across, down, self.layers as u32])?;
        let held = match &self.held {
            Some(held) => Some(planes_of(commands, held, self.size, channels)?),
            None => None,
        };
        Ok(Cells {
            size: Size { channels: channels.len(), ..self.size },
            layers: self.layers,
            front: self.front,
            held,
            codes: self.codes.clone(),
            shifts: self.shifts.clone(),
            edges: self.edges.clone(),
            colors,
            half_planes: self.half_planes.clone(),
            holdouts: self.holdouts.clone(),
        })
    }

    /// Number of cells of all layers.
    pub fn len(&self) -> usize {
        self.layers * self.size.pixels()
    }
}

/// These planes of a picture, for one job.
fn planes_of(
    commands: &mut Commands,
    picture: &wgpu::Buffer,
    size: Size,
    channels: &[usize],
) -> Result<wgpu::Buffer> {
    let plane = size.pixels() * size_of::<f32>();
    let some = commands.scratch::<f32>("some channels behind holdouts", channels.len() * size.pixels())?;
    for (to, from) in channels.iter().enumerate() {
        commands.copy_part(picture, from * plane, &some, to * plane, plane);
    }
    Ok(some)
}

/// The half-planes of all layers' cells in a range of pixels.
fn half_planes(layers: &[SceneLayer], range: &Range<usize>) -> Vec<[f32; 4]> {
    let all = layers.iter().flat_map(|layer| layer.partial_in(range.clone()));
    all.map(|(_, plane)| [plane.normal[0], plane.normal[1], plane.cut, plane.opacity]).collect()
}
