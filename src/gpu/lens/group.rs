//! Channels that are rendered together; the twin of `cpu::lens::group`.

use super::frame::Input;
use crate::error::Result;
use crate::gpu::commands::Commands;
use crate::gpu::device::Gpu;
use crate::gpu::picture::GpuPicture;
use crate::memory;
use crate::picture::{Size, Weighting};
use crate::plan::lens::carried::CarriedLight;
use crate::plan::lens::footprint::Sharpening;
use crate::plan::lens::highlights::Highlights;
use crate::scene::colors::{CellColor, Colors};
use crate::scene::layered::LayeredScene;
use rayon::prelude::*;

/// Number of values that one worker converts at a time.
const CHUNK: usize = 1 << 14;

/// Up to four channels on a device.
pub struct Group {
    /// The frame with these channels.
    pub size: Size,
    /// Planes of what the pinhole sees, and of how many layers they are.
    pub planes: (wgpu::Buffer, usize),
    /// The colours of all cells, four channels per cell.
    pub colors: wgpu::Buffer,
    /// For each layer, the colours of cells without the light of highlights.
    pub dimmed: Vec<Vec<CellColor>>,
    /// The same as they are swept, if these are not the dimmed ones.
    pub swept: Option<Vec<Vec<CellColor>>>,
    /// The light of each highlight, if highlights are drawn.
    pub light: Vec<[f32; 4]>,
    pub sharpening: Sharpening,
}

impl Group {
    /// The channels of the picture itself.
    pub fn of_picture(input: &Input, highlights: &Highlights) -> Group {
        let Input { picture, cells, .. } = *input;
        let planes = match &cells.held {
            Some(held) => (held.clone(), 1),
            None => (picture.color.clone(), picture.layers),
        };
        Group {
            size: cells.size,
            planes,
            colors: cells.colors.clone(),
            dimmed: highlights.dimmed.clone(),
            swept: highlights.swept.clone(),
            light: highlights.all.iter().map(|highlight| highlight.excess).collect(),
            sharpening: Sharpening::Own,
        }
    }

    /// Group number `g` of those that the picture carries, uploaded to the device.
    pub fn carried(commands: &Commands, input: &Input, highlights: &Highlights, g: usize) -> Result<Group> {
        let Input { picture, scene, .. } = *input;
        let group = &picture.carried()[g];
        let size = Size { channels: group.size.channels, ..scene.size };
        let light = match group.weighting {
            Weighting::Light => CarriedLight::new(scene, highlights, g),
            Weighting::Mean => CarriedLight { dimmed: Vec::new(), swept: None, excess: Vec::new() },
        };
        Ok(Group {
            size,
            planes: planes(commands, picture, scene, g)?,
            colors: interleaved(commands.gpu, scene.layers.iter().map(|layer| &layer.carried[g]), size)?,
            dimmed: light.dimmed,
            swept: light.swept,
            light: light.excess,
            sharpening: Sharpening::of_carried(group.weighting),
        })
    }
}

/// The planes of a group that is carried, and of how many layers they are.
fn planes(
    commands: &Commands,
    picture: &GpuPicture,
    scene: &LayeredScene,
    g: usize,
) -> Result<(wgpu::Buffer, usize)> {
    Ok(match &scene.held {
        Some(held) => (commands.gpu.upload("channels behind holdouts", &held.carried[g])?, 1),
        None => (picture.upload_carried(g)?, picture.layers),
    })
}

/// Uploads the colours of layers, four channels per cell.
fn interleaved<'a>(
    gpu: &Gpu,
    layers: impl ExactSizeIterator<Item = &'a Colors>,
    size: Size,
) -> Result<wgpu::Buffer> {
    let mut all: Vec<[f32; 4]> = memory::zeros(size.pixels() * layers.len());
    layers.zip(all.chunks_mut(size.pixels())).for_each(|(colors, out)| interleave(colors, size, out));
    gpu.upload("the channels of all cells", &all)
}

/// Interleaves the channels of a layer's colours.
fn interleave(colors: &Colors, size: Size, out: &mut [[f32; 4]]) {
    let planes = colors.to_planes();
    let planes: Vec<&[f32]> = planes.chunks(size.pixels()).collect();
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(i, out)| {
        for (x, color) in out.iter_mut().enumerate() {
            for (value, plane) in color.iter_mut().zip(&planes) {
                *value = plane[i * CHUNK + x];
            }
        }
    });
}
