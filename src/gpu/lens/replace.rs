//! Colours of single cells, put in the place of others.

use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, GROUP, groups};
use crate::gpu::shader::{Shader, shader, shared};
use crate::scene::colors::CellColor;

pub const REPLACE_COLORS: Shader = shader!("lens/replace_colors", [], [ReplaceParams, Replacement]);

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

/// Replaces the colours of some cells of each layer, of which every one has so many `pixels`.
pub fn replace<'a>(
    commands: &mut Commands,
    colors: &wgpu::Buffer,
    channels: usize,
    pixels: usize,
    layers: impl Iterator<Item = &'a [CellColor]>,
) -> Result<()> {
    let of_layer = |(first, cells): (usize, &'a [CellColor])| {
        let replacement = move |cell: &CellColor| Replacement {
            color: cell.color,
            index: (first + cell.index) as u32,
            _end: [0; 3],
        };
        cells.iter().map(replacement)
    };
    let replacements: Vec<Replacement> = (0..).step_by(pixels).zip(layers).flat_map(of_layer).collect();
    if replacements.is_empty() {
        return Ok(());
    }
    let side = (replacements.len() as f64).sqrt().ceil() as usize;
    let params = ReplaceParams { count: replacements.len() as u32 };
    let replacements = commands.gpu.upload("the cells with other colours", &replacements)?;
    let buffers = [Read(&replacements), Write(colors)];
    commands.pass(&REPLACE_COLORS, channels, &params, &buffers, groups(side.next_multiple_of(GROUP), side))
}
