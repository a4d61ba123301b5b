//! The tiles of a frame: in focus, or exact discs or swept in this scene and in coarser ones.

use super::coarse_pictures::{Between, CoarsePictures};
use super::disc;
use super::frame::Frame;
use super::group::Group;
use super::in_focus::Composite;
use super::segments::Segments;
use super::sweep;
use super::tile_color::TileColor;
use crate::error::Result;
use crate::plan::lens::tiles::{Tile, Work};
use crate::rows::ITEMS_PER_TASK;

/// Tiles that a worker takes at a time: more than elsewhere, because it allocates scratch memory each time.
pub const TILES_PER_TASK: usize = 4 * ITEMS_PER_TASK;

/// What is needed to render the tiles of a frame, but for its highlights.
pub struct Painting<'a> {
    frame: &'a Frame<'a>,
    groups: &'a [Group<'a>],
    gathers: Vec<disc::Gather<'a>>,
    coarse: Option<CoarsePictures>,
}

/// The memory of one worker.
pub struct Scratch {
    segments: Segments,
    sums: disc::RunningSums,
    composite: Composite,
    between: Between,
    /// The tile in each group of channels.
    pub color: Vec<TileColor>,
    exact: Vec<TileColor>,
}

impl Scratch {
    pub fn new(groups: &[Group]) -> Scratch {
        let tiles = || groups.iter().map(|group| TileColor::new(group.size.channels)).collect();
        Scratch {
            segments: Segments::default(),
            sums: disc::RunningSums::default(),
            composite: Composite::default(),
            between: Between::default(),
            color: tiles(),
            exact: tiles(),
        }
    }
}

impl<'a> Painting<'a> {
    /// The painting of a frame whose colours are set.
    pub fn new(
        frame: &'a Frame<'a>,
        groups: &'a [Group<'a>],
        coarse: Option<CoarsePictures>,
    ) -> Painting<'a> {
        let gathers = groups.iter().map(|group| frame.gather(group)).collect();
        Painting { frame, groups, gathers, coarse }
    }

    /// Renders a tile into the scratch's `color`.
    pub fn tile(&self, scratch: &mut Scratch, tile: &Tile) -> Result<()> {
        let Frame { scene, padded, in_focus, missed, simd, .. } = self.frame;
        let Scratch { segments, sums, composite, between, color, exact } = scratch;
        let mut sharp = |color: &mut [TileColor]| {
            for (group, color) in self.groups.iter().zip(color) {
                composite.tile(group, &scene.layers, in_focus, tile.origin, color);
            }
        };
        let is_own = self.frame.parts(tile).any();
        match &tile.work {
            Work::InFocus => {
                sharp(color);
                return Ok(());
            }
            Work::Disc if is_own => {
                for (gather, color) in self.gathers.iter().zip(&mut *color) {
                    gather.tile(tile.origin, sums, color)?;
                }
            }
            Work::Sweep { samples, occupied, disc, in_focus } if is_own => {
                self.frame.trace(segments, tile, *samples, occupied);
                // SAFETY: the segments have just been traced there.
                unsafe { sweep::sweep(*simd, padded, segments, tile.origin, *missed, color) };
                if *disc > 0.0 {
                    for ((gather, color), exact) in self.gathers.iter().zip(&mut *color).zip(&mut *exact) {
                        gather.tile(tile.origin, sums, exact)?;
                        color.mix(exact, *disc);
                    }
                }
                if *in_focus > 0.0 {
                    sharp(exact);
                    color.iter_mut().zip(exact).for_each(|(color, exact)| color.mix(exact, *in_focus));
                }
            }
            Work::Disc | Work::Sweep { .. } => {}
        }
        if let Some(coarse) = &self.coarse {
            coarse.add_to(self.frame, tile, between, color);
        }
        Ok(())
    }
}
