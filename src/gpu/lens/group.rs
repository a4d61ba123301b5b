//! Channels that are rendered together; the twin of `cpu::lens::group`.

use super::frame::Input;
use super::layered::{Cells, NO_PLANES};
use super::replace::replace;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, groups, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::picture::{Size, Weighting};
use crate::plan::lens::carried::CarriedLight;
use crate::plan::lens::footprint::Sharpening;
use crate::plan::lens::highlights::Highlights;
use crate::scene::colors::{CellColor, Colors};

pub const INTERLEAVE: Shader = shader!("lens/interleave", ["picture"], [InterleaveParams]);

shared! {
    /// Parameters for the cells of one layer.
    struct InterleaveParams {
        size: [u32; 2],
        first: u32,
        planes: u32,
    }
}

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

    /// Group number `g` of those that the picture carries, taken to the device.
    pub fn carried(
        commands: &mut Commands,
        input: &Input,
        highlights: &Highlights,
        g: usize,
    ) -> Result<Group> {
        let Input { picture, scene, cells, .. } = *input;
        let group = &picture.carried()[g];
        let size = Size { channels: group.size.channels, ..scene.size };
        let light = match group.weighting {
            Weighting::Light => CarriedLight::new(scene, highlights, g),
            Weighting::Mean => CarriedLight { dimmed: Vec::new(), swept: None, excess: Vec::new() },
        };
        let planes = match &scene.held {
            Some(held) => (commands.gpu.upload("channels behind holdouts", &held.carried[g])?, 1),
            None => (picture.upload_carried(g)?, picture.layers),
        };
        // Of one layer, what the pinhole sees is what cells are, but for those that are listed.
        let is_seen = scene.held.is_none() && picture.layers == 1;
        let of_layers: Vec<&Colors> = scene.layers.iter().map(|layer| &layer.carried[g]).collect();
        let colors = laid_out(commands, cells, &of_layers, is_seen.then_some(&planes.0), size)?;
        Ok(Group {
            size,
            planes,
            colors,
            dimmed: light.dimmed,
            swept: light.swept,
            light: light.excess,
            sharpening: Sharpening::of_carried(group.weighting),
        })
    }
}

/// The colours of all cells, from planes that are on the device, or else are uploaded, and from those that are listed.
fn laid_out(
    commands: &mut Commands,
    cells: &Cells,
    layers: &[&Colors],
    at_hand: Option<&wgpu::Buffer>,
    size: Size,
) -> Result<wgpu::Buffer> {
    let n = size.pixels();
    let given: Vec<&[f32]> = layers.iter().filter_map(|colors| colors.planes()).collect();
    let planes = match at_hand {
        Some(planes) => planes.clone(),
        None => commands.gpu.upload("the channels of layers", &given.concat())?,
    };
    let colors = commands.scratch::<[f32; 4]>("the channels of all cells", cells.len())?;
    let mut first_plane = 0;
    for (first, layer) in (0..).step_by(n).zip(layers) {
        let of_layer = if layer.is_list() { NO_PLANES } else { first_plane };
        let params = InterleaveParams { size: pixels(size), first: first as u32, planes: of_layer };
        let on_all = groups(size.width, size.height);
        commands.pass(&INTERLEAVE, size.channels, &params, &[Read(&planes), Write(&colors)], on_all)?;
        first_plane += if layer.is_list() { 0 } else { size.channels as u32 };
    }
    replace(commands, &colors, size.channels, n, layers.iter().map(|colors| colors.listed(0..n)))?;
    Ok(colors)
}
