//! Highlights, drawn as exact discs.

use super::frame::{GROUPS, LensFrame, MAX_LOOPS, Target, origin, units};
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

/// The discs of highlights, and in which tiles they are drawn.
pub struct HighlightDiscs<'a> {
    frame: LensFrame<'a>,
    params: HighlightsParams,
    /// All highlights, without their light.
    all: Vec<Highlight>,
    words: wgpu::Buffer,
    lists: wgpu::Buffer,
    nearest: wgpu::Buffer,
    /// The tiles of each pass, and the work for each of them.
    passes: Vec<(wgpu::Buffer, Vec<f64>)>,
}

impl<'a> HighlightDiscs<'a> {
    /// Uploads what is needed to draw highlights; `None` if there are none.
    pub fn new(
        commands: &Commands,
        frame: &LensFrame<'a>,
        kernels: &Kernels,
        highlights: &Highlights,
        aperture: &Aperture,
    ) -> Result<Option<HighlightDiscs<'a>>> {
        let LensFrame { cells, codes, plan, clip } = *frame;
        let gpu = commands.gpu;
        if highlights.all.is_empty() {
            return Ok(None);
        }
        // For each highlight, a pixel looks up two weights. For each cluster it follows a ray, by four cells of all layers
        // at every step.
        let loops_each =
            plan.reach_px.ceil() as usize * (1 + 4 * (1 + cells.layers)) + 2 * kernels.widest_row + 2;
        let at_once = (MAX_LOOPS / loops_each).max(1);
        let mut lists: Vec<u32> = Vec::new();
        let mut passes: Vec<Vec<Tile>> = Vec::new();
        for (i, tile) in plan.tiles.iter().enumerate() {
            let members = highlights.of_tile(i).flat_map(|cluster| cluster.members.clone());
            let list: Vec<u32> = members.map(|i| i as u32).collect();
            for (i, part) in list.chunks(at_once).enumerate() {
                passes.resize_with(passes.len().max(i + 1), Vec::new);
                let (first, count) = (lists.len() as u32, part.len() as u32);
                let disc = tile.disc_share();
                passes[i].push(Tile { origin: origin(tile.origin), first, count, disc, _end: 0 });
                lists.extend(part);
            }
        }
        let upload = |tiles: Vec<Tile>| {
            let work = tiles.iter().map(|tile| units(tile.count as usize)).collect();
            Ok((gpu.upload("the tiles with highlights", &tiles)?, work))
        };
        let nearest = plan.bounds.range.iter().map(|(_, nearest)| u32::from(*nearest));
        let nearest: Vec<u32> = nearest.chain(cells.holdouts.iter().copied()).collect();
        // The table of open parts is stored after the words of the discs.
        let (second_stop, open) = SecondStop::new(clip, aperture.lean(), kernels.words.len());
        let params = HighlightsParams {
            size: pixels(cells.size),
            padded: [plan.padding.stride as u32, plan.padding.rows as u32],
            pad: plan.padding.pad.map(|pad| pad as i32),
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
        let words: Vec<u32> =
            kernels.words.iter().copied().chain(open.into_iter().map(f32::to_bits)).collect();
        Ok(Some(HighlightDiscs {
            frame: *frame,
            params,
            all: without_light(highlights, kernels),
            words: gpu.upload("the discs", &words)?,
            lists: gpu.upload("the highlights of tiles", &lists)?,
            nearest: gpu.upload("the depths of blocks", &nearest)?,
            passes: passes.into_iter().map(upload).collect::<Result<_>>()?,
        }))
    }

    /// Adds all highlights, which are of this light, to the picture.
    pub fn pass(&self, commands: &mut Commands, target: Target, light: &[[f32; 4]]) -> Result<()> {
        let LensFrame { cells, .. } = self.frame;
        let all = self.all.iter().zip(light).map(|(highlight, &light)| Highlight { light, ..*highlight });
        let all = commands.gpu.upload("the highlights", &all.collect::<Vec<_>>())?;
        for (tiles, work) in &self.passes {
            let buffers = [
                Read(&cells.codes),
                Read(&cells.half_planes),
                Read(&self.words),
                Read(&all),
                Read(tiles),
                Read(&self.lists),
                Read(&self.nearest),
                Write(target.picture),
            ];
            let params = |first_tile| HighlightsParams { first_tile, ..self.params };
            commands.tiles(&HIGHLIGHTS, target.channels, params, &buffers, (work, GROUPS))?;
        }
        Ok(())
    }
}

/// All highlights in the form that shaders use.
fn without_light(highlights: &Highlights, kernels: &Kernels) -> Vec<Highlight> {
    let of_cluster = |cluster: &Cluster| {
        let [farthest, nearest] = cluster.span.map(u32::from);
        let layer = highlights.all[cluster.middle].layer as u32;
        let layer = if cluster.hidden_in_part { layer } else { NOT_HIDDEN };
        let words = [u32::from(cluster.code) | nearest << 16, farthest | layer << 16];
        let middle = cluster.middle as u32;
        cluster.members.clone().map(move |_| (middle, words))
    };
    let all = highlights.all.iter().zip(highlights.clusters.iter().flat_map(of_cluster));
    all.zip(&kernels.of_highlights)
        .map(|((highlight, (middle, [codes, farthest_and_layer])), kernels)| Highlight {
            light: [0.0; 4],
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
        .collect()
}
