//! What is blurred so widely that [coarser scenes](crate::scene::coarser) show it, is rendered there.

use super::coarse_pictures::{CoarsePicture, CoarsePictures};
use super::culling::PART;
use super::frame::{Frame, Scenes};
use super::group::Group;
use super::painting::{Painting, Scratch, TILES_PER_TASK};
use super::parts::BESIDE;
use crate::cpu::tiles::split;
use crate::error::Result;
use crate::memory::Buffer;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::Settings;
use crate::plan::lens::detail::SCENES;
use crate::plan::lens::tiles::Tile;
use crate::scene::coarser::Coarser;
use crate::scene::colors::Colors;
use crate::scene::grid::TILE;
use rayon::prelude::*;
use std::sync::Arc;

/// A group of channels in a coarser scene.
fn of_scene<'a>(scene: &Coarser, group: &Group, finer: &[Colors]) -> Group<'a> {
    let Size { width, height, .. } = scene.scene.size;
    Group {
        size: Size { width, height, ..group.size },
        planes: Vec::new(),
        coverage: Vec::new(),
        dimmed: scene.colors(finer),
        swept: None,
        excess: Vec::new(),
        lights: group.lights,
        sharpening: group.sharpening,
    }
}

/// The pictures of the coarser scenes of a frame that show these groups. If they are carried by a picture, `guide` is
/// its own.
pub fn pictures(
    frame: &Frame,
    (groups, guide): (&[Group], Option<&Group>),
    optics: &Optics,
    settings: &Settings,
    supersample: usize,
) -> Result<Option<CoarsePictures>> {
    let Frame { scene, scenes, simd, cancel, .. } = frame;
    let Some(Scenes { detail, .. }) = scenes else { return Ok(None) };
    let mut pictures = Vec::new();
    let all: Vec<&Group> = groups.iter().chain(guide).collect();
    let mut last: Option<(Coarser, Vec<Group>)> = None;
    let coarsest = detail.coarsest().unwrap_or(0);
    // As far beyond the border as rays go, and those of the parts of tiles there that are rendered; but mirror images repeat.
    let farthest = frame.padded.reach_px as usize + ((PART.0 + BESIDE) << coarsest);
    let beyond = [scene.size.width, scene.size.height].map(|n| n.min(farthest));
    for number in 1..=coarsest {
        let (finer, colors): (_, Vec<&[Colors]>) = match &last {
            None => (*scene, all.iter().map(|group| &group.dimmed[..]).collect()),
            Some((finer, groups)) => (&finer.scene, groups.iter().map(|group| &group.dimmed[..]).collect()),
        };
        let own = Coarser::new(finer, if number == 1 { beyond } else { [0; 2] }, *simd);
        let of_groups = all.iter().zip(colors).map(|(group, finer)| of_scene(&own, group, finer));
        let of_groups: Vec<Group> = of_groups.collect();
        if SCENES.contains(&number) {
            let scenes = Scenes { detail: Arc::clone(detail), number };
            let optics = Optics { k: optics.k / f64::from(1 << number), ..*optics };
            let frame = Frame::coarser(&own.scene, scenes, &optics, settings, supersample, *simd, cancel)?;
            let (shown, guide) = of_groups.split_at(groups.len());
            let picture = frame.map(|frame| picture(number, frame, shown, guide.first()));
            pictures.extend(picture.transpose()?);
        }
        last = Some((own, of_groups));
    }
    Ok(Some(CoarsePictures(pictures)))
}

/// The picture of a frame of the scene number `n`.
fn picture(n: usize, mut frame: Frame, groups: &[Group], guide: Option<&Group>) -> Result<CoarsePicture> {
    let (cancel, Size { width, height, .. }) = (frame.cancel, frame.scene.size);
    if frame.is_swept() {
        frame.set_colors(groups, guide);
        cancel.check()?;
    }
    let channels: usize = groups.iter().map(|group| group.size.channels).sum();
    let rows = height.next_multiple_of(TILE.1);
    let mut planes = Buffer::unset(channels * rows * width);
    let mut slots: Vec<_> = split(&mut planes, Size { width, height: channels * rows, channels: 1 }, TILE)
        .into_iter()
        .map(Some)
        .collect();
    let (across, in_plane) = (width.div_ceil(TILE.0), width.div_ceil(TILE.0) * (rows / TILE.1));
    let of_tile = |tile: &Tile| {
        let first = tile.origin.1 / TILE.1 * across + tile.origin.0 / TILE.0;
        (0..channels).filter_map(|c| slots[c * in_plane + first].take()).collect::<Vec<_>>()
    };
    let of_tiles: Vec<_> = frame.tiles.iter().map(of_tile).collect();
    let painting = Painting::new(&frame, groups, None);
    of_tiles.into_par_iter().zip(&frame.tiles).with_max_len(TILES_PER_TASK).try_for_each_init(
        || Scratch::new(groups),
        |scratch, (slots, tile)| {
            cancel.check()?;
            painting.tile(scratch, tile)?;
            let planes = scratch.color.iter().flat_map(|color| &color.planes);
            for (slot, plane) in slots.into_iter().zip(planes) {
                for (row, own) in slot.rows.into_iter().zip(plane.chunks_exact(TILE.0)) {
                    row.copy_from_slice(&own[..row.len()]);
                }
            }
            Ok(())
        },
    )?;
    Ok(CoarsePicture::new(n, (width, height), planes))
}
