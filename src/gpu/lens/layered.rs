//! A layered scene on a device.

use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, groups, pixels};
use crate::gpu::device::Gpu;
use crate::gpu::shader::{Shader, shader, shared};
use crate::memory;
use crate::picture::Size;
use crate::scene::layer::{Role, SceneLayer};
use crate::scene::layered::LayeredScene;
use rayon::prelude::*;
use std::sync::Arc;

pub const CHANNELS: Shader = shader!("lens/channels", [], [ChannelsParams]);

shared! {
    /// Parameters for a selection of channels.
    struct ChannelsParams {
        size: [u32; 2],
        channels: [u32; 2],
    }
}

/// The shift of an empty cell, because shaders cannot rely on NaN.
pub const NOWHERE: f32 = 1e30;
/// The connectivity of a layer that has none.
pub const NO_CONNECTIVITY: u8 = 128;
/// The connectivity of a layer that has none because it is a holdout.
pub const OF_HOLDOUT: u8 = NO_CONNECTIVITY | 64;
/// Bytes of a cell beside its colour: its codes, its shift, its connectivity, and a half-plane's number. Half-planes
/// are few; those of edges that fill a quarter of the picture have as many bytes.
pub const OTHER_BYTES_PER_CELL: usize = 4 + 4 + 1 + 4 + 4;
/// Number of values that one worker converts at a time.
const CHUNK: usize = 1 << 14;

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
    /// Four bytes per word.
    pub connectivity: wgpu::Buffer,
    /// Four channels per cell.
    pub colors: wgpu::Buffer,
    /// For each cell 0, or one more than the index of its half-plane; then the half-planes, three words each.
    pub half_planes: wgpu::Buffer,
    /// For each layer whether it is a holdout.
    pub holdouts: Vec<u32>,
}

impl Cells {
    /// Uploads a layered scene to a device.
    pub fn new(gpu: &Arc<Gpu>, scene: &LayeredScene) -> Result<Cells> {
        let (size, n) = (scene.size, scene.size.pixels());
        let codes: Vec<u32> = scene
            .depths
            .iter()
            .flat_map(|depths| {
                depths.lo.iter().zip(depths.hi.iter()).map(|(&lo, &hi)| u32::from(lo) | u32::from(hi) << 16)
            })
            .collect();
        let codes = gpu.upload("the depths of all cells", &codes)?;
        let shown = |s: &f32| if s.is_nan() { NOWHERE } else { *s };
        let shifts: Vec<f32> = scene.layers.iter().flat_map(|layer| layer.s.iter().map(shown)).collect();
        let shifts = gpu.upload("the shifts of all cells", &shifts)?;
        let mut connectivity: Vec<u8> = Vec::with_capacity((n * scene.layers.len()).next_multiple_of(4));
        for layer in &scene.layers {
            let end = connectivity.len() + n;
            match layer.role {
                Role::Holdout => connectivity.resize(end, OF_HOLDOUT),
                Role::Surface if layer.connectivity.is_empty() => connectivity.resize(end, NO_CONNECTIVITY),
                Role::Surface => connectivity.extend_from_slice(&layer.connectivity),
            }
        }
        let connectivity = gpu.upload("the connectivity between cells", &connectivity)?;
        let mut colors: Vec<[f32; 4]> = memory::zeros(n * scene.layers.len());
        scene.layers.iter().zip(colors.chunks_mut(n)).for_each(|(layer, out)| interleave(layer, size, out));
        let colors = gpu.upload("the colours of all cells", &colors)?;
        let half_planes = gpu.upload("the half-planes of all cells", &half_planes(&scene.layers, n))?;
        let held = scene
            .held
            .as_ref()
            .map(|held| gpu.upload("the picture behind holdouts", &held.own))
            .transpose()?;
        let (layers, front) = (scene.layers.len(), scene.front);
        let holdouts = scene.layers.iter().map(|layer| u32::from(layer.role == Role::Holdout)).collect();
        Ok(Cells { size, layers, front, held, codes, shifts, connectivity, colors, half_planes, holdouts })
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
            connectivity: self.connectivity.clone(),
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

/// Interleaves the channels of a layer's colours.
fn interleave(layer: &SceneLayer, size: Size, out: &mut [[f32; 4]]) {
    let planes = layer.colors.to_planes();
    let planes: Vec<&[f32]> = planes.chunks(size.pixels()).collect();
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(i, out)| {
        for (x, color) in out.iter_mut().enumerate() {
            for (value, plane) in color.iter_mut().zip(&planes) {
                *value = plane[i * CHUNK + x];
            }
        }
    });
}

/// The words of the half-planes.
fn half_planes(layers: &[SceneLayer], pixels: usize) -> Vec<u32> {
    let mut words = memory::zeros(layers.len() * pixels);
    let mut planes: Vec<u32> = Vec::new();
    for (first, layer) in (0..).step_by(pixels).zip(layers) {
        for (index, plane) in layer.partial.iter() {
            let [x, y] = plane.normal;
            let values = [x, y, plane.cut, plane.opacity].map(f32::to_bits);
            planes.extend(values);
            words[first + index] = (planes.len() / values.len()) as u32;
        }
    }
    words.extend(planes);
    words
}
