//! Highlights, drawn as exact discs of which a part is visible.

use super::frame::{LensFrame, MAX_LOOPS, origin, per_pixel};
use super::kernels::Kernels;
use super::optical_vignetting::SecondStop;
use crate::aperture::Aperture;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::plan::lens::highlights::{Highlights, OWN_WEIGHT, WINDOW};
use crate::scene::edges::CONNECTED_PX;

pub const HIGHLIGHTS: Shader = shader!(
    "lens/highlights",
    ["mirror", "lens/depth_spans", "lens/kernels", "lens/optical_vignetting"],
    [HighlightsParams, Highlight, Tile, SecondStop]
);

shared! {
    struct HighlightsParams {
        size: [u32; 2],
        window: i32,
        connected_px: f32,
        own_weight: f32,
        layers: u32,
        _gap: [u32; 2],
        second_stop: SecondStop,
    }
}

shared! {
    struct Highlight {
        light: [f32; 4],
        place: [i32; 2],
        t: f32,
        share: f32,
        kernels: [u32; 2],
        _end: [u32; 2],
    }
}

shared! {
    struct Tile {
        origin: [u32; 2],
        first: u32,
        count: u32,
        is_hidden_in_part: u32,
        _end: u32,
    }
}

/// Adds all highlights to the picture. `lights` tells how much of them is visible where some of it may not be.
pub fn pass(
    commands: &mut Commands,
    frame: &LensFrame,
    kernels: Kernels,
    highlights: &Highlights,
    lights: Option<&wgpu::Buffer>,
    aperture: &Aperture,
) -> Result<()> {
    let LensFrame { cells, plan, clip, picture, .. } = *frame;
    let gpu = commands.gpu;
    if highlights.all.is_empty() {
        return Ok(());
    }
    // For each highlight, a pixel looks up two weights.
    let at_once = (MAX_LOOPS / (2 * kernels.widest_row + 1)).max(1);
    let mut lists: Vec<u32> = Vec::new();
    let mut passes: Vec<Vec<Tile>> = Vec::new();
    let listed = highlights.by_tile.iter().zip(&highlights.hidden_in_part);
    for (tile, (list, &hidden)) in plan.tiles.iter().zip(listed) {
        for (i, part) in list.chunks(at_once).enumerate() {
            passes.resize_with(passes.len().max(i + 1), Vec::new);
            let (first, count) = (lists.len() as u32, part.len() as u32);
            let is_hidden_in_part = hidden.into();
            passes[i].push(Tile { origin: origin(tile.origin), first, count, is_hidden_in_part, _end: 0 });
            lists.extend(part);
        }
    }
    let all: Vec<Highlight> = highlights
        .all
        .iter()
        .zip(&kernels.of_highlights)
        .map(|(highlight, kernels)| Highlight {
            light: highlight.excess,
            place: [highlight.x, highlight.y],
            t: highlight.t as f32,
            share: highlight.share,
            kernels: kernels.map(|kernel| kernel as u32),
            _end: [0; 2],
        })
        .collect();
    // The table of open parts is stored after the words of the discs.
    let (second_stop, open) = SecondStop::new(clip, aperture.lean(), kernels.words.len());
    let params = HighlightsParams {
        size: pixels(cells.size),
        window: WINDOW as i32,
        connected_px: CONNECTED_PX,
        own_weight: OWN_WEIGHT,
        layers: cells.layers as u32,
        _gap: [0; 2],
        second_stop,
    };
    let words =
        gpu.upload("the discs", &[kernels.words, open.into_iter().map(f32::to_bits).collect()].concat())?;
    let all = gpu.upload("the highlights", &all)?;
    let lists = gpu.upload("the highlights of tiles", &lists)?;
    let nothing = gpu.upload("no light", &[[0.0f32; 4]])?;
    let lights = lights.unwrap_or(&nothing);
    for tiles in passes {
        let groups = per_pixel(tiles.len());
        let tiles = gpu.upload("the tiles with highlights", &tiles)?;
        let buffers = [
            Read(&words),
            Read(&all),
            Read(&tiles),
            Read(&lists),
            Read(lights),
            Read(&cells.shifts),
            Read(&cells.half_planes),
            Write(picture),
        ];
        commands.pass(&HIGHLIGHTS, cells.size.channels, &params, &buffers, groups)?;
    }
    Ok(())
}
