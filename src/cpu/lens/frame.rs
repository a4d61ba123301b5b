//! A frame under one focus, ready for its tiles: what does not depend on the channels that are rendered.

use super::culling::PART;
use super::disc;
use super::group::{Group, Input};
use super::highlights::HighlightPass;
use super::padded::Padded;
use super::padded_colors::DrawnGroup;
use super::parts::{BESIDE, Parts};
use super::segments::{Segments, Start};
use super::widen;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::plan::lens::aberrated::{self, Aberrated};
use crate::plan::lens::detail::Detail;
use crate::plan::lens::disc::Surface;
use crate::plan::lens::footprint::Footprint;
use crate::plan::lens::highlights::Highlights;
use crate::plan::lens::in_focus::InFocus;
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::lens_samples::LensSample;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::padding::Margin;
use crate::plan::lens::tiles::{self, Tile};
use crate::plan::lens::{Missed, Plan, Resolution, Settings, check_full_resolution};
use crate::scene::coarser::Coarser;
use crate::scene::colors::Colors;
use crate::scene::depth_bounds::DepthBits;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The scenes of several sizes that share the work of a frame, and which of them a frame is of.
#[derive(Clone)]
pub struct Scenes {
    pub detail: Arc<Detail>,
    /// The pixels of the frame are `2^number` pixels of the picture wide.
    pub number: usize,
}

impl Scenes {
    fn finest(detail: Detail) -> Scenes {
        Scenes { detail: Arc::new(detail), number: 0 }
    }

    /// The parts of the tile at `origin` of which this scene has a share.
    fn parts(&self, (x, y): (usize, usize)) -> Parts {
        // Between the pixels of a coarser picture, those beside them are asked as well.
        let margin = if self.number == 0 { 0 } else { BESIDE };
        Parts::that(|(column, row)| {
            let (columns, rows) = (x + column..x + column + PART.0, y + row..y + row + PART.1);
            self.detail.needs(self.number, columns, rows, margin)
        })
    }
}

/// The parts of a tile in which the scene that the tile is of has a share.
fn parts(tile: &Tile, scenes: Option<&Scenes>) -> Parts {
    scenes.map_or_else(|| Parts::that(|_| true), |scenes| scenes.parts(tile.origin))
}

/// A frame under one focus.
pub struct Frame<'a> {
    pub scene: &'a LayeredScene,
    pub s_focus: f64,
    pub clip: Option<PupilClip>,
    pub highlights: Highlights,
    pub padded: Padded,
    pub tiles: Vec<Tile>,
    /// Set if scenes of several sizes share the work.
    pub scenes: Option<Scenes>,
    pub kernels: Kernels,
    pub footprint: Footprint,
    pub in_focus: InFocus,
    pub missed: Missed,
    pub aberrated: Option<Aberrated>,
    sample_sets: BTreeMap<usize, Vec<LensSample>>,
    pub simd: Simd,
    pub cancel: &'a Cancel,
}

impl<'a> Frame<'a> {
    pub fn new(
        input: &Input<'a>,
        optics: &Optics,
        settings: &Settings,
        margin: Margin,
        simd: Simd,
        cancel: &'a Cancel,
    ) -> Result<Frame<'a>> {
        let Input { scene, supersample, .. } = *input;
        cancel.check()?;
        let origins = tiles::origins(scene.size.width, scene.size.height);
        let plan = Plan::new(scene, optics, settings, supersample, (margin, origins), simd);
        cancel.check()?;
        let highlights = Highlights::new(scene, &plan, simd);
        cancel.check()?;
        // What a lens does differently at every place is not known at another scale.
        let is_even = settings.second_stop.is_none() && settings.aberrated.is_none();
        let may_be = settings.resolution == Resolution::Adaptive && is_even && Coarser::exists(scene);
        if !may_be {
            check_full_resolution(plan.reach_px)?;
        }
        let detail = may_be.then(|| Detail::new(&plan, &scene.codes)).flatten();
        let scenes = detail.map(Scenes::finest);
        Frame::of_plan(scene, plan, (highlights, scenes), settings, simd, cancel)
    }

    /// The frame of a coarser scene, as far as these tell that it is needed; `None` if it is not. It has no highlights.
    pub fn coarser(
        scene: &'a LayeredScene,
        scenes: Scenes,
        optics: &Optics,
        settings: &Settings,
        supersample: usize,
        simd: Simd,
        cancel: &'a Cancel,
    ) -> Result<Option<Frame<'a>>> {
        let mut origins = tiles::origins(scene.size.width, scene.size.height);
        origins.retain(|origin| scenes.parts(*origin).any());
        if origins.is_empty() {
            return Ok(None);
        }
        let plan = Plan::new(scene, optics, settings, supersample, (Margin::Period, origins), simd);
        cancel.check()?;
        Frame::of_plan(scene, plan, (Highlights::default(), Some(scenes)), settings, simd, cancel).map(Some)
    }

    fn of_plan(
        scene: &'a LayeredScene,
        plan: Plan,
        (highlights, scenes): (Highlights, Option<Scenes>),
        settings: &Settings,
        simd: Simd,
        cancel: &'a Cancel,
    ) -> Result<Frame<'a>> {
        let clip = settings.second_stop.map(|second_stop| PupilClip::new(second_stop, &settings.aperture));
        let Plan {
            s_focus,
            reach_px,
            padding,
            bounds,
            tiles,
            sample_sets,
            footprint,
            in_focus,
            missed,
            aberrated,
        } = plan;
        // What hides a highlight is looked up as well.
        let is_read = |(i, tile): &(usize, &Tile)| {
            let is_own = parts(tile, scenes.as_ref()).any();
            tile.is_swept() && (is_own || highlights.of_tile(*i).next().is_some())
        };
        let read = tiles.iter().enumerate().filter(is_read).map(|(_, tile)| tile);
        let needed = tiles::needed(&padding, &bounds, read);
        let padded = Padded::new(scene, padding, bounds, reach_px, &needed, simd);
        cancel.check()?;
        let is_disc = |tile: &&Tile| tile.disc_share() > 0.0 && parts(tile, scenes.as_ref()).any();
        let discs = tiles.par_iter().filter(is_disc);
        let discs =
            discs.map(|tile| Surface::new(&scene.layers[scene.front].s, scene.size, s_focus, tile.origin));
        let surfaces: Vec<Surface> = discs.collect();
        let keys = surfaces.iter().flat_map(Surface::keys).chain(highlights.keys()).collect();
        let level = surfaces.iter().filter_map(Surface::level);
        let kernels = Kernels::new(&settings.aperture, s_focus, keys, level, cancel)?;
        Ok(Frame {
            scene,
            s_focus,
            clip,
            highlights,
            padded,
            tiles,
            scenes,
            kernels,
            footprint,
            in_focus,
            missed,
            aberrated,
            sample_sets,
            simd,
            cancel,
        })
    }

    /// The parts of a tile in which this scene has a share.
    pub fn parts(&self, tile: &Tile) -> Parts {
        parts(tile, self.scenes.as_ref())
    }

    /// Whether some tile is swept in this scene.
    pub fn is_swept(&self) -> bool {
        self.tiles.iter().any(|tile| tile.is_swept() && self.parts(tile).any())
    }

    /// The colours of a group with which cells are drawn, in each layer: widened where lens samples are sparse.
    pub fn widened(&self, group: &Group) -> Vec<Colors> {
        let of_layers = self.scene.layers.iter().zip(group.swept());
        let widened = of_layers.map(|(layer, colors)| {
            let passes = widen::Widening::new(&self.footprint, layer, group.size, self.s_focus);
            passes.map_or_else(|| colors.clone(), |passes| passes.of(colors, self.simd))
        });
        widened.collect()
    }

    /// Lays out the colours with which all groups are swept. Where they are carried by a picture, `guide` is its own.
    pub fn set_colors(&mut self, groups: &[Group], guide: Option<&Group>) {
        let guide = guide.map(|guide| self.widened(guide));
        let of_group = |group: &Group| DrawnGroup {
            size: group.size,
            colors: self.widened(group),
            sharpening: group.sharpening,
        };
        let drawn: Vec<DrawnGroup> = groups.iter().map(of_group).collect();
        let Frame { footprint, s_focus, simd, .. } = self;
        self.padded.set_colors(self.scene, &drawn, guide.as_deref(), footprint, *s_focus, *simd);
    }

    /// The frame from which the discs of a group are gathered.
    pub fn gather(&self, group: &Group) -> disc::Gather<'_> {
        let scene = self.scene;
        disc::Gather {
            size: group.size,
            colors: group.dimmed[scene.front].clone(),
            s: &scene.layers[scene.front].s,
            s_focus: self.s_focus,
            kernels: &self.kernels,
            simd: self.simd,
            cancel: self.cancel,
        }
    }

    /// The drawing of highlights.
    pub fn highlight_pass(&self) -> HighlightPass<'_> {
        HighlightPass {
            highlights: &self.highlights,
            padded: &self.padded,
            kernels: &self.kernels,
            clip: self.clip.as_ref(),
            simd: self.simd,
        }
    }

    /// The samples of a tile that is swept with so many.
    pub fn samples(&self, count: usize) -> &[LensSample] {
        &self.sample_sets[&count]
    }

    /// Traces the rays of a tile that is swept with so many samples through the depths that may be met.
    pub fn trace(&self, segments: &mut Segments, tile: &Tile, samples: usize, occupied: &DepthBits) {
        let Frame { padded, s_focus, clip, .. } = self;
        let start = Start { padded, s_focus: *s_focus, origin: tile.origin, occupied, clip: clip.as_ref() };
        segments.parts = self.parts(tile);
        let samples = self.samples(samples);
        let (rays, seen) = match &self.aberrated {
            Some(lens) => aberrated::rays(lens, (tile.origin, tile.reach_px), samples).into_iter().unzip(),
            None => (Vec::new(), Vec::new()),
        };
        let samples = if self.aberrated.is_some() { &rays } else { samples };
        self.simd.run(
            #[inline(always)]
            || segments.trace(&start, samples, &seen),
        );
    }
}
