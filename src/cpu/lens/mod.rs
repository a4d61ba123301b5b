//! The flagship: an integral over the lens with visibility for every lens sample.
//!
//! [`padded`] lays the layered scene out for one focus, [`culling`] bounds its depths, and each tile is a copy, an
//! exact [`disc`], or a [`sweep`]. [`highlights`] are drawn over them.

mod culling;
mod disc;
mod highlights;
mod lanes;
mod padded;
mod padded_colors;
mod padded_layer;
mod sweep;
mod tile_color;
mod widen;

use crate::cancel::Cancel;
use crate::cpu::tiles::split;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::Picture;
use crate::plan::lens::disc::Surface;
use crate::plan::lens::highlights::{Highlights, extract};
use crate::plan::lens::kernels::{self, Kernels};
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::tiles::{self, Work};
use crate::plan::lens::{Plan, Settings};
use crate::rows::{ITEMS_PER_TASK, interleave, with_channels};
use crate::scene::colors::Colors;
use crate::scene::grid::TILE;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use padded::Padded;
use rayon::prelude::*;
use sweep::{Segments, Start};
use tile_color::TileColor;

/// Tiles that a worker takes at a time: more than elsewhere, because it allocates scratch memory each time.
const TILES_PER_TASK: usize = 4 * ITEMS_PER_TASK;

/// The input of a render.
pub struct Input<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// The layered scene made from it.
    pub scene: &'a LayeredScene,
    /// The output averages this many pixels along each axis, so correspondingly fewer samples are enough.
    pub supersample: usize,
}

/// Renders the picture through a lens, interleaved, into `out`.
pub fn render(
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
    out: &mut [f32],
) -> Result<()> {
    let Input { picture, scene, supersample } = *input;
    let size = picture.size;
    cancel.check()?;
    let clip = settings.second_stop.map(|second_stop| PupilClip::new(second_stop, &settings.aperture));
    let Plan { s_focus, reach_px, padding, bounds, tiles, sample_sets, footprint, missed } =
        Plan::new(scene, optics, settings, supersample);
    let needed = tiles::needed(&padding, &bounds, &tiles);
    cancel.check()?;
    let mut padded = Padded::new(scene, padding, bounds, reach_px, &needed, simd);
    cancel.check()?;

    let mut colors: Vec<Colors> = scene.layers.iter().map(|layer| layer.colors.clone()).collect();
    let mut highlights = Vec::new();
    let highlights_are_out = !sample_sets.is_empty();
    if highlights_are_out {
        let dimmed;
        (highlights, dimmed) = extract(scene, &padded.padding, s_focus, simd);
        for (colors, dimmed) in colors.iter_mut().zip(dimmed).filter(|(_, dimmed)| !dimmed.is_empty()) {
            *colors = colors.with(dimmed);
        }
        highlights::find_hidden(&mut highlights, &padded, s_focus);
        cancel.check()?;
        let drawn = scene.layers.iter().zip(&colors).map(|(layer, colors)| {
            widen::widened(&footprint, layer, colors, size, s_focus, simd).unwrap_or_else(|| colors.clone())
        });
        padded.set_colors(scene, &drawn.collect::<Vec<_>>(), &footprint, s_focus, simd);
        cancel.check()?;
    }
    let highlights = Highlights::new(highlights, &padded.padding, &tiles);

    let front = &scene.layers[0];
    let discs = tiles.par_iter().filter(|tile| tile.work == Work::Disc);
    let discs = discs.map(|tile| Surface::new(&front.s, size, s_focus, tile.origin));
    let surfaces: Vec<Surface> = discs.collect();
    let keys = surfaces.iter().flat_map(Surface::keys).chain(highlights.shifts().map(kernels::key)).collect();
    let level = surfaces.iter().filter_map(Surface::level);
    let kernels = Kernels::new(&settings.aperture, s_focus, keys, level, cancel)?;
    // Every cell that outshines the rest is in the list of highlights, whether or not it was taken out of the layers.
    let none_outshines = highlights_are_out || surfaces.is_empty() || scene.bright(simd)[0].is_empty();
    let gather =
        disc::Gather { size, colors: &colors[0], s: &front.s, s_focus, kernels: &kernels, simd, cancel };

    let pass = highlights::HighlightPass { padded: &padded, s_focus, kernels: &kernels, clip: clip.as_ref() };
    let mut slots = split(out, size, TILE);
    slots.par_iter_mut().zip(&tiles).enumerate().with_max_len(TILES_PER_TASK).try_for_each_init(
        || (Segments::default(), Sums::default(), TileColor::new(size.channels)),
        |(segments, sums, color), (i, (slot, tile))| {
            cancel.check()?;
            match &tile.work {
                Work::Copy => copy(picture, tile.origin, color),
                Work::Disc if none_outshines => gather.tile(tile.origin, &mut sums.dim, color)?,
                Work::Disc => gather.tile(tile.origin, &mut sums.any, color)?,
                Work::Sweep { samples, occupied } => {
                    let start = Start {
                        padded: &padded,
                        s_focus,
                        origin: tile.origin,
                        occupied,
                        clip: clip.as_ref(),
                    };
                    let samples = &sample_sets[samples];
                    simd.run(
                        #[inline(always)]
                        || segments.trace(&start, samples),
                    );
                    // SAFETY: the segments have just been traced there.
                    unsafe { sweep::sweep(simd, &padded, segments, tile.origin, missed, color) };
                }
            }
            highlights.draw(&pass, i, tile.origin, color);
            for (y, row) in slot.rows.iter_mut().enumerate() {
                with_channels!(size.channels, C => interleave(color.row::<C>(y), row));
            }
            Ok(())
        },
    )
}

/// The running sums from which discs are gathered, without highlights or with them.
#[derive(Default)]
struct Sums {
    dim: disc::RunningSums<f32>,
    any: disc::RunningSums<f64>,
}

/// Renders a tile as the pinhole sees it: its layers composited.
fn copy(picture: &Picture, origin: (usize, usize), out: &mut TileColor) {
    let (size, n) = (picture.size, picture.size.pixels());
    let across = TILE.0.min(size.width - origin.0);
    for y in 0..TILE.1.min(size.height - origin.1) {
        let start = (origin.1 + y) * size.width + origin.0;
        let mut left = [1.0f32; TILE.0];
        for (i, layer) in picture.layers.iter().enumerate() {
            let row = |c: usize| &layer.color[c * n + start..][..across];
            for (c, plane) in out.planes.iter_mut().enumerate() {
                let out = &mut plane[y * TILE.0..][..across];
                if i == 0 {
                    out.copy_from_slice(row(c));
                } else {
                    out.iter_mut().zip(row(c)).zip(&left).for_each(|((out, v), left)| *out += left * v);
                }
            }
            if picture.layers.len() > 1 {
                left.iter_mut().zip(row(size.channels - 1)).for_each(|(left, alpha)| *left *= 1.0 - alpha);
            }
        }
    }
}
