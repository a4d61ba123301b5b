//! The flagship: an integral over the lens with visibility for every lens sample.
//!
//! [`padded`] lays the layered scene out for one focus, [`culling`] bounds its depths, and each tile is
//! [`in_focus`], an exact [`disc`], or a [`sweep`]. [`highlights`] are drawn over them.

mod aberrated_highlights;
mod adjoint;
mod culling;
mod dimming;
mod disc;
mod frame;
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
mod sweep_rows;
mod sweep_tiles;
mod tile_color;
mod widen;

use crate::cancel::Cancel;
use crate::cpu::tiles::split;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::Settings;
use crate::plan::lens::tiles::{Work, Works};
use crate::rows::{ITEMS_PER_TASK, interleave, interleave_among, with_channels};
use crate::scene::grid::TILE;
use crate::simd::Simd;
pub use adjoint::{adjoint, by_pixel, of_shifts};
pub use group::Input;

use aberrated_highlights::AberratedLight;
use frame::Frame;
use group::Group;
use in_focus::Composite;
use rayon::prelude::*;
use segments::Segments;
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
    let Input { picture, scene, .. } = *input;
    let size = picture.size;
    let mut frame = Frame::new(input, optics, settings, Works::Least, simd, cancel)?;
    let of_picture = Group::of_picture(input, &frame.highlights);
    let (guide, groups) = match picture.carried.is_empty() {
        true => (None, vec![of_picture]),
        false => (Some(of_picture), Group::carried(input, &frame.highlights)),
    };
    if frame.is_swept() {
        frame.set_colors(&groups, guide.as_ref());
        cancel.check()?;
    }
    let gathers: Vec<disc::Gather> = groups.iter().map(|group| frame.gather(group)).collect();
    let pass = frame.highlight_pass();
    let aberrated = AberratedLight::new(&frame, &groups)?;
    let Frame { padded, tiles, in_focus, missed, .. } = &frame;

    let channels: usize = groups.iter().map(|group| group.size.channels).sum();
    let mut slots = split(out, Size { channels, ..size }, TILE);
    slots.par_iter_mut().zip(tiles).enumerate().with_max_len(TILES_PER_TASK).try_for_each_init(
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
                        composite.tile(group, &scene.layers, in_focus, tile.origin, color);
                    }
                }
                Work::Disc => {
                    for (gather, color) in gathers.iter().zip(&mut *color) {
                        gather.tile(tile.origin, sums, color)?;
                    }
                }
                Work::Sweep { samples, occupied, disc, in_focus: sharp } => {
                    frame.trace(segments, tile, *samples, occupied);
                    // SAFETY: the segments have just been traced there.
                    unsafe { sweep::sweep(simd, padded, segments, tile.origin, *missed, color) };
                    if *disc > 0.0 {
                        for ((gather, color), exact) in gathers.iter().zip(&mut *color).zip(&mut *exact) {
                            gather.tile(tile.origin, sums, exact)?;
                            color.mix(exact, *disc);
                        }
                    }
                    if *sharp > 0.0 {
                        for ((group, color), exact) in groups.iter().zip(&mut *color).zip(exact) {
                            composite.tile(group, &scene.layers, in_focus, tile.origin, exact);
                            color.mix(exact, *sharp);
                        }
                    }
                }
            }
            pass.draw(i, tile, &groups, discs, color);
            if let Some(light) = &aberrated {
                light.add_to(tile, color);
            }
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
