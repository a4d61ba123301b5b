//! The flagship: an integral over the lens with visibility for every lens sample.
//!
//! [`padded`] lays the layered scene out for one focus, [`culling`] bounds its depths, and each tile is
//! [`in_focus`], an exact [`disc`], or a [`sweep`]. [`highlights`] are drawn over them.

mod aberrated_highlights;
mod adjoint;
mod coarse;
mod coarse_pictures;
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
mod painting;
mod parts;
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
use crate::plan::lens::padding::Margin;
use crate::rows::{interleave, interleave_among, with_channels};
use crate::scene::grid::TILE;
use crate::simd::Simd;
pub use adjoint::{Asked, Derivatives, adjoint, by_pixel};
pub use group::Input;

use aberrated_highlights::AberratedLight;
use frame::Frame;
use group::Group;
use painting::{Painting, Scratch, TILES_PER_TASK};
use rayon::prelude::*;

/// Renders the picture through a lens, interleaved, into `out`; or, if it carries channels, these in its place.
pub fn render(
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
    out: &mut [f32],
) -> Result<()> {
    let Input { picture, supersample, .. } = *input;
    let size = picture.size;
    let mut frame = Frame::new(input, optics, settings, Margin::Period, simd, cancel)?;
    let of_picture = Group::of_picture(input, &frame.highlights);
    let (guide, groups) = match picture.carried.is_empty() {
        true => (None, vec![of_picture]),
        false => (Some(of_picture), Group::carried(input, &frame.highlights)),
    };
    let coarse = coarse::pictures(&frame, (&groups, guide.as_ref()), optics, settings, supersample)?;
    if frame.is_swept() {
        frame.set_colors(&groups, guide.as_ref());
        cancel.check()?;
    }
    let painting = Painting::new(&frame, &groups, coarse);
    let pass = frame.highlight_pass();
    let aberrated = AberratedLight::new(&frame, &groups)?;

    let channels: usize = groups.iter().map(|group| group.size.channels).sum();
    let mut slots = split(out, Size { channels, ..size }, TILE);
    slots.par_iter_mut().zip(&frame.tiles).enumerate().with_max_len(TILES_PER_TASK).try_for_each_init(
        || (Scratch::new(&groups), highlights::Scratch::default()),
        |(scratch, discs), (i, (slot, tile))| {
            cancel.check()?;
            painting.tile(scratch, tile)?;
            let color = &mut scratch.color;
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
