//! Highlights, drawn as exact discs.

use super::frame::{GROUPS, LensFrame, MAX_LOOPS, origin, units};
use super::kernels::Kernels;
use super::optical_vignetting::SecondStop;
use crate::aperture::Aperture;
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::plan::lens::highlights::{Cluster, Highlights, OTHER_SURFACE_PX, SAME_SURFACE_PX};
use crate::scene::grid::BLOCK;

pub const HIGHLIGHTS: Shader = shader!(
    "lens/highlights",
    ["mirror", "lens/depth_spans", "lens/half_planes", "lens/kernels", "lens/optical_vignetting"],
    [HighlightsParams, Highlight, Tile, SecondStop]
);

shared! {
    struct HighlightsParams {
        size: [u32; 2],
        padded: [u32; 2],
        pad: [i32; 2],
        block: i32,
        layers: u32,
        s_focus: f32,
        reach_px: f32,
        s_min: f32,
        step: f32,
        same_surface_px: f32,
        other_surface_px: f32,
        first_tile: u32,
        _gap: u32,
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
        middle: u32,
        codes: u32,
        farthest_and_layer: u32,
        drawn: f32,
        _end: [u32; 2],
    }
}

shared! {
    struct Tile {
        origin: [u32; 2],
        first: u32,
        count: u32,
        disc: f32,
        _end: u32,
    }
}

/// In place of the layer of a cluster of which nothing is hidden.
pub const NOT_HIDDEN: u32 = 0xffff;

/// Adds all highlights to the picture.
pub fn pass(
    commands: &mut Commands,
    frame: &LensFrame,
    kernels: Kernels,
    highlights: &Highlights,
    aperture: &Aperture,
) -> Result<()> {
    let LensFrame { cells, codes, plan, clip, picture } = *frame;
    let gpu = commands.gpu;
    if highlights.all.is_empty() {
        return Ok(());
    }
    let pad = plan.padding.pad.map(|pad| pad as i32);
    // For each highlight, a pixel looks up two weights. For each cluster it follows a ray, by four cells of all layers at
    // every step.
    let loops_each =
        plan.reach_px.ceil() as usize * (1 + 4 * (1 + cells.layers)) + 2 * kernels.widest_row + 2;
    let at_once = (MAX_LOOPS / loops_each).max(1);
    let mut lists: Vec<u32> = Vec::new();
    let mut passes: Vec<Vec<Tile>> = Vec::new();
    for (i, tile) in plan.tiles.iter().enumerate() {
        let list: Vec<u32> =
            highlights.of_tile(i).flat_map(|cluster| cluster.members.clone()).map(|i| i as u32).collect();
        for (i, part) in list.chunks(at_once).enumerate() {
            passes.resize_with(passes.len().max(i + 1), Vec::new);
            let (first, count) = (lists.len() as u32, part.len() as u32);
            let disc = tile.disc_share();
            passes[i].push(Tile { origin: origin(tile.origin), first, count, disc, _end: 0 });
            lists.extend(part);
        }
    }
    let of_cluster = |cluster: &Cluster| {
        let [farthest, nearest] = cluster.span.map(u32::from);
        let layer = highlights.all[cluster.middle].layer as u32;
        let layer = if cluster.hidden_in_part { layer } else { NOT_HIDDEN };
        let words = [u32::from(cluster.code) | nearest << 16, farthest | layer << 16];
        let middle = cluster.middle as u32;
        cluster.members.clone().map(move |_| (middle, words))
    };
    let all: Vec<Highlight> = highlights
        .all
        .iter()
        .zip(highlights.clusters.iter().flat_map(of_cluster))
        .zip(&kernels.of_highlights)
        .map(|((highlight, (middle, [codes, farthest_and_layer])), kernels)| Highlight {
            light: highlight.excess,
            place: [highlight.x, highlight.y],
            t: highlight.t as f32,
            share: highlight.share,
            kernels: kernels.map(|kernel| kernel as u32),
            middle,
            codes,
            farthest_and_layer,
            drawn: highlight.drawn,
            _end: [0; 2],
        })
        .collect();
    let nearest = plan.bounds.range.iter().map(|(_, nearest)| u32::from(*nearest));
    let nearest: Vec<u32> = nearest.chain(cells.holdouts.iter().copied()).collect();
    // The table of open parts is stored after the words of the discs.
    let (second_stop, open) = SecondStop::new(clip, aperture.lean(), kernels.words.len());
    let params = HighlightsParams {
        size: pixels(cells.size),
        padded: [plan.padding.stride as u32, plan.padding.rows as u32],
        pad,
        block: BLOCK as i32,
        layers: cells.layers as u32,
        s_focus: plan.s_focus as f32,
        reach_px: plan.reach_px as f32,
        s_min: codes.s_min as f32,
        step: codes.step() as f32,
        same_surface_px: SAME_SURFACE_PX,
        other_surface_px: OTHER_SURFACE_PX,
        first_tile: 0,
        _gap: 0,
        second_stop,
    };
    let words =
        gpu.upload("the discs", &[kernels.words, open.into_iter().map(f32::to_bits).collect()].concat())?;
    let all = gpu.upload("the highlights", &all)?;
    let lists = gpu.upload("the highlights of tiles", &lists)?;
    let nearest = gpu.upload("the depths of blocks", &nearest)?;
    for tiles in passes {
        let work: Vec<f64> = tiles.iter().map(|tile| units(tile.count as usize)).collect();
        let tiles = gpu.upload("the tiles with highlights", &tiles)?;
        let buffers = [
            Read(&cells.codes),
            Read(&cells.half_planes),
            Read(&words),
            Read(&all),
            Read(&tiles),
            Read(&lists),
            Read(&nearest),
            Write(picture),
        ];
        let params = |first_tile| HighlightsParams { first_tile, ..params };
        commands.tiles(&HIGHLIGHTS, cells.size.channels, params, &buffers, (&work, GROUPS))?;
    }
    Ok(())
}
