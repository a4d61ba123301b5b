//! The flagship: an integral over the lens with visibility for every lens sample.
//!
//! [`padded`] lays the layered scene out for one focus, [`culling`] bounds its depths, and each tile is
//! [`in_focus`], an exact [`disc`], or a [`sweep`]. [`highlights`] are drawn over them.

mod culling;
mod dimming;
mod disc;
mod group;
mod highlights;
mod in_focus;
mod lanes;
mod padded;
mod padded_colors;
mod padded_layer;
mod planes;
mod segments;
mod shadows;
mod sweep;
mod tile_color;
mod widen;

use crate::cancel::Cancel;
use crate::cpu::tiles::split;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::disc::Surface;
use crate::plan::lens::highlights::Highlights;
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::tiles::{self, Work};
use crate::plan::lens::{Plan, Settings};
use crate::rows::{ITEMS_PER_TASK, interleave, interleave_among, with_channels};
use crate::scene::colors::Colors;
use crate::scene::grid::TILE;
use crate::simd::Simd;
pub use group::Input;

use group::Group;
use highlights::HighlightPass;
use in_focus::Composite;
use padded::Padded;
use padded_colors::DrawnGroup;
use rayon::prelude::*;
use segments::{Segments, Start};
use tile_color::TileColor;

/// Tiles that a worker takes at a time: more than elsewhere, because it allocates scratch memory each time.
const TILES_PER_TASK: usize = 4 * ITEMS_PER_TASK;

/// Renders the picture through a lens, interleaved, into `out`; or, if it carries channels, these in its place.
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
    let plan = Plan::new(scene, optics, settings, supersample);
    cancel.check()?;
    let highlights = Highlights::new(scene, &plan, simd);
    cancel.check()?;
    let Plan { s_focus, reach_px, padding, bounds, tiles, sample_sets, footprint, in_focus, missed } = plan;
    let needed = tiles::needed(&padding, &bounds, &tiles);
    let mut padded = Padded::new(scene, padding, bounds, reach_px, &needed, simd);
    cancel.check()?;

    let picture_alone = picture.carried.is_empty();
    let of_picture = Group::of_picture(input, &highlights);
    let (guide, groups) = match picture_alone {
        true => (None, vec![of_picture]),
        false => (Some(of_picture), Group::carried(input, &highlights)),
    };
    if !sample_sets.is_empty() {
        let drawn = |group: &Group| -> Vec<Colors> {
            let of_layers = scene.layers.iter().zip(group.swept());
            let widened = of_layers.map(|(layer, colors)| {
                let widened = widen::widened(&footprint, layer, colors, group.size, s_focus, simd);
                widened.unwrap_or_else(|| colors.clone())
            });
            widened.collect()
        };
        let guide = guide.as_ref().map(drawn);
        let of_group = |group: &Group| DrawnGroup {
            size: group.size,
            colors: drawn(group),
            sharpening: group.sharpening,
        };
        let drawn: Vec<DrawnGroup> = groups.iter().map(of_group).collect();
        padded.set_colors(scene, &drawn, guide.as_deref(), &footprint, s_focus, simd);
        cancel.check()?;
    }

    let front = &scene.layers[scene.front];
    let discs = tiles.par_iter().filter(|tile| tile.disc_share() > 0.0);
    let discs = discs.map(|tile| Surface::new(&front.s, size, s_focus, tile.origin));
    let surfaces: Vec<Surface> = discs.collect();
    let keys = surfaces.iter().flat_map(Surface::keys).chain(highlights.keys()).collect();
    let level = surfaces.iter().filter_map(Surface::level);
    let kernels = Kernels::new(&settings.aperture, s_focus, keys, level, cancel)?;
    let gather = |group: &'_ Group| disc::Gather {
        size: group.size,
        colors: group.dimmed[scene.front].clone(),
        s: &front.s,
        s_focus,
        kernels: &kernels,
        simd,
        cancel,
    };
    let gathers: Vec<disc::Gather> = groups.iter().map(gather).collect();
    let pass = HighlightPass {
        highlights: &highlights,
        padded: &padded,
        kernels: &kernels,
        clip: clip.as_ref(),
        simd,
    };

    let channels: usize = groups.iter().map(|group| group.size.channels).sum();
    let mut slots = split(out, Size { channels, ..size }, TILE);
    slots.par_iter_mut().zip(&tiles).enumerate().with_max_len(TILES_PER_TASK).try_for_each_init(
        || {
            let sums = disc::RunningSums::default();
            let tiles = || groups.iter().map(|group| TileColor::new(group.size.channels)).collect::<Vec<_>>();
            let scratch = highlights::Scratch::default();
            (Segments::default(), sums, Composite::default(), scratch, [tiles(), tiles()])
        },
        |(segments, sums, composite, discs, [color, exact]), (i, (slot, tile))| {
            cancel.check()?;
            match &tile.work {
                Work::InFocus => {
                    for (group, color) in groups.iter().zip(&mut *color) {
                        let planes = (group.size, &group.planes[..]);
                        composite.tile(planes, &scene.layers, &in_focus, tile.origin, color);
                    }
                }
                Work::Disc => {
                    for (gather, color) in gathers.iter().zip(&mut *color) {
                        gather.tile(tile.origin, sums, color)?;
                    }
                }
                Work::Sweep { samples, occupied, disc } => {
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
                    if *disc > 0.0 {
                        for ((gather, color), exact) in gathers.iter().zip(&mut *color).zip(exact) {
                            gather.tile(tile.origin, sums, exact)?;
                            color.mix(exact, *disc);
                        }
                    }
                }
            }
            pass.draw(i, tile, &groups, discs, color);
            for (y, row) in slot.rows.iter_mut().enumerate() {
                if let [only] = &color[..] {
                    with_channels!(channels, C => interleave(only.row::<C>(y), row));
                    continue;
                }
                let mut first = 0;
                for color in &*color {
                    let n = color.planes.len();
                    with_channels!(n, C => interleave_among(color.row::<C>(y), channels, &mut row[first..]));
                    first += n;
                }
            }
            Ok(())
        },
    )
}
