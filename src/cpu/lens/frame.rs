//! A frame under one focus, ready for its tiles: what does not depend on the channels that are rendered.

use super::disc;
use super::group::{Group, Input};
use super::highlights::HighlightPass;
use super::padded::Padded;
use super::padded_colors::DrawnGroup;
use super::segments::{Segments, Start};
use super::widen;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::plan::lens::aberrated::{self, Aberrated};
use crate::plan::lens::disc::Surface;
use crate::plan::lens::footprint::Footprint;
use crate::plan::lens::highlights::Highlights;
use crate::plan::lens::in_focus::InFocus;
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::lens_samples::LensSample;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::tiles::{self, Tile, Works};
use crate::plan::lens::{Missed, Plan, Settings};
use crate::scene::colors::Colors;
use crate::scene::depth_bounds::DepthBits;
use crate::simd::Simd;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A frame under one focus.
pub struct Frame<'a> {
    pub input: &'a Input<'a>,
    pub s_focus: f64,
    pub clip: Option<PupilClip>,
    pub highlights: Highlights,
    pub padded: Padded,
    pub tiles: Vec<Tile>,
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
        input: &'a Input<'a>,
        optics: &Optics,
        settings: &Settings,
        works: Works,
        simd: Simd,
        cancel: &'a Cancel,
    ) -> Result<Frame<'a>> {
        let Input { picture, scene, supersample } = *input;
        cancel.check()?;
        let clip = settings.second_stop.map(|second_stop| PupilClip::new(second_stop, &settings.aperture));
        let plan = Plan::new(scene, optics, settings, supersample, works, simd);
        cancel.check()?;
        let highlights = Highlights::new(scene, &plan, simd);
        cancel.check()?;
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
        let needed = tiles::needed(&padding, &bounds, &tiles);
        let padded = Padded::new(scene, padding, bounds, reach_px, &needed, simd);
        cancel.check()?;
        let discs = tiles.par_iter().filter(|tile| tile.disc_share() > 0.0);
        let discs =
            discs.map(|tile| Surface::new(&scene.layers[scene.front].s, picture.size, s_focus, tile.origin));
        let surfaces: Vec<Surface> = discs.collect();
        let keys = surfaces.iter().flat_map(Surface::keys).chain(highlights.keys()).collect();
        let level = surfaces.iter().filter_map(Surface::level);
        let kernels = Kernels::new(&settings.aperture, s_focus, keys, level, cancel)?;
        Ok(Frame {
            input,
            s_focus,
            clip,
            highlights,
            padded,
            tiles,
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

    /// Whether some tile is swept.
    pub fn is_swept(&self) -> bool {
        !self.sample_sets.is_empty()
    }

    /// The colours of a group with which cells are drawn, in each layer: widened where lens samples are sparse.
    pub fn widened(&self, group: &Group) -> Vec<Colors> {
        let of_layers = self.input.scene.layers.iter().zip(group.swept());
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
        self.padded.set_colors(self.input.scene, &drawn, guide.as_deref(), footprint, *s_focus, *simd);
    }

    /// The frame from which the discs of a group are gathered.
    pub fn gather(&self, group: &Group) -> disc::Gather<'_> {
        let scene = self.input.scene;
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
