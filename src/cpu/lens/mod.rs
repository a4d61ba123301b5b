//! The flagship: an integral over the lens with visibility for every lens point.
//!
//! [`sheets`] takes the picture apart into cells (what is in front, what is behind, what is hidden), [`pack`] lays
//! them out for one focus, [`tiles`] plans, and each tile is a copy, an exact [`disc`], or a [`sweep`].

pub(crate) mod barrel;
pub(crate) mod blocks;
pub(crate) mod cells;
pub(crate) mod colors;
pub(crate) mod disc;
mod fill;
pub(crate) mod footprint;
pub(crate) mod highlights;
pub(crate) mod kernels;
mod lanes;
pub(crate) mod line;
pub(crate) mod pack;
mod patches;
pub(crate) mod plan;
mod sheets;
pub(crate) mod surfaces;
pub(crate) mod sweep;
pub(crate) mod tiles;
mod unmix;

pub use barrel::Clip;
pub use sheets::{Sheet, Sheets};

use crate::aperture::Aperture;
use crate::cancel::Cancel;
use crate::cpu::rows::{interleave, with_channels};
use crate::cpu::simd::Simd;
use crate::cpu::tiles::split;
use crate::error::{Result, value_error};
use crate::optics::{Barrel, Optics};
use crate::picture::Picture;
use colors::Colors;
use disc::Surface;
use highlights::Highlights;
use kernels::Kernels;
use pack::{Packed, TILE};
use plan::Plan;
use rayon::prelude::*;
use sweep::{Segments, Start, TileColor};
use tiles::Work;

/// The largest circle of confusion that is rendered.
pub const MAX_RADIUS_PX: f64 = 2048.0;

/// Rows or blocks that a worker takes at a time. Some cost a hundred times as much as others, and what one worker has begun
/// nobody can take over.
const AT_ONCE: usize = 8;
/// Tiles that a worker takes at a time: some more, for each time it needs memory to work in.
const TILES_AT_ONCE: usize = 4 * AT_ONCE;

/// The choices that a caller has.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The opening.
    pub aperture: Aperture,
    /// Number of views everywhere, or chosen for each tile.
    pub views: Option<usize>,
    /// The second stop of the lens, if it clips anything.
    pub barrel: Option<Barrel>,
}

/// Refuses lenses whose circles of confusion are beyond reason.
pub fn check_radius(picture: &Picture, optics: &Optics) -> Result<()> {
    let radii = picture.layers.iter().map(|layer| optics.largest_radius_px(layer.disparity_range()));
    let radius = radii.fold(0.0, f64::max);
    if radius.is_nan() || radius > MAX_RADIUS_PX {
        return Err(value_error!(
            "lens: the largest circle of confusion would have a radius of {radius:.0} px; at most \
             {MAX_RADIUS_PX} px are rendered. Use a smaller aperture, or look for depths that are too near"
        ));
    }
    Ok(())
}

/// Takes a picture apart for lenses of this strength; see [`Sheets`].
pub fn prepare(picture: &Picture, optics: &Optics, simd: Simd, cancel: &Cancel) -> Result<Sheets> {
    check_radius(picture, optics)?;
    sheets::build(picture, optics.k, simd, cancel)
}

/// What is rendered.
pub struct Input<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// What has been made of it.
    pub sheets: &'a Sheets,
    /// One pixel of the output will average so many along each axis, and so many fewer views are enough.
    pub supersample: usize,
}

/// The picture through a lens, interleaved, into `out`.
pub fn render(
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
    out: &mut [f32],
) -> Result<()> {
    let Input { picture, sheets, supersample } = *input;
    let size = picture.size;
    cancel.check()?;
    let clip = settings.barrel.map(|barrel| Clip::new(barrel, &settings.aperture));
    let Plan { s_focus, reach_px, padding, blocks, tiles, view_sets, footprint, missed } =
        Plan::new(sheets, optics, settings, supersample);
    let needed = tiles::needed(&padding, &blocks, &tiles);
    cancel.check()?;
    let mut packed = Packed::new(sheets, padding, blocks, reach_px, &needed, simd);
    cancel.check()?;

    let mut colors: Vec<Colors> = sheets.sheets.iter().map(|sheet| sheet.colors.clone()).collect();
    let mut highlights = Vec::new();
    let highlights_are_out = !view_sets.is_empty();
    if highlights_are_out {
        let dimmed;
        (highlights, dimmed) = highlights::extract(sheets, &packed.padding, s_focus, simd);
        for (colors, dimmed) in colors.iter_mut().zip(dimmed).filter(|(_, dimmed)| !dimmed.is_empty()) {
            *colors = colors.with(dimmed);
        }
        highlights::find_hidden(&mut highlights, &packed, s_focus);
        cancel.check()?;
        let drawn = sheets.sheets.iter().zip(&colors).map(|(sheet, colors)| {
            footprint.widened(sheet, colors, size, s_focus, simd).unwrap_or_else(|| colors.clone())
        });
        packed.set_colors(sheets, &drawn.collect::<Vec<_>>(), &footprint, s_focus, simd);
        cancel.check()?;
    }
    let highlights = Highlights::new(highlights, &packed.padding, &tiles);

    let front = &sheets.sheets[0];
    let discs = tiles.par_iter().filter(|tile| tile.work == Work::Disc);
    let discs = discs.map(|tile| Surface::new(&front.s, size, s_focus, tile.origin));
    let surfaces: Vec<Surface> = discs.collect();
    let keys = surfaces.iter().flat_map(Surface::keys).chain(highlights.shifts().map(kernels::key)).collect();
    let level = surfaces.iter().filter_map(Surface::level);
    let kernels = Kernels::new(&settings.aperture, s_focus, keys, level, cancel)?;
    // What outshines the rest is on the sheets' list, whether it is taken out or not.
    let none_outshines = highlights_are_out || surfaces.is_empty() || sheets.bright(simd)[0].is_empty();
    let gather =
        disc::Gather { size, colors: &colors[0], s: &front.s, s_focus, kernels: &kernels, simd, cancel };

    let scene = highlights::Scene { packed: &packed, s_focus, kernels: &kernels, clip: clip.as_ref() };
    let mut slots = split(out, size, TILE);
    slots.par_iter_mut().zip(&tiles).enumerate().with_max_len(TILES_AT_ONCE).try_for_each_init(
        || (Segments::default(), Around::default(), TileColor::new(size.channels)),
        |(segments, around, color), (i, (slot, tile))| {
            cancel.check()?;
            match &tile.work {
                Work::Copy => copy(picture, tile.origin, color),
                Work::Disc if none_outshines => gather.tile(tile.origin, &mut around.dim, color)?,
                Work::Disc => gather.tile(tile.origin, &mut around.any, color)?,
                Work::Sweep { views, occupied } => {
                    let start = Start {
                        packed: &packed,
                        s_focus,
                        origin: tile.origin,
                        occupied,
                        clip: clip.as_ref(),
                    };
                    let views = &view_sets[views];
                    simd.run(
                        #[inline(always)]
                        || segments.trace(&start, views),
                    );
                    sweep::sweep(simd, &packed, segments, tile.origin, missed, color);
                }
            }
            highlights.draw(&scene, i, tile.origin, color);
            for (y, row) in slot.rows.iter_mut().enumerate() {
                with_channels!(size.channels, C => interleave(color.row::<C>(y), row));
            }
            Ok(())
        },
    )
}

/// What discs are gathered from, without highlights or with them.
#[derive(Default)]
struct Around {
    dim: disc::Surroundings<f32>,
    any: disc::Surroundings<f64>,
}

/// The tile as the pinhole saw it: layers over one another.
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
