//! The plan of the flagship for one focus. It is made from depths alone, and both devices carry it out.

pub(crate) mod aberrated;
pub(crate) mod carried;
pub(crate) mod detail;
pub(crate) mod disc;
pub(crate) mod footprint;
pub(crate) mod highlights;
pub(crate) mod in_focus;
pub(crate) mod kernels;
pub(crate) mod lens_samples;
pub(crate) mod optical_vignetting;
pub(crate) mod padded_bounds;
pub(crate) mod padding;
pub(crate) mod point_image;
pub(crate) mod ray;
pub(crate) mod tiles;

use crate::aperture::Aperture;
use crate::error::{Result, value_error};
use crate::optics::{Imaging, Optics, SecondStop, Transverse};
use crate::scene::contrast::Contrast;
use crate::scene::depth_bounds::DepthBounds;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use aberrated::{Aberrated, Bounds, Reaches};
use footprint::Footprint;
use in_focus::InFocus;
use lens_samples::LensSample;
use optical_vignetting::PupilClip;
use padding::{Margin, Padding};
use std::collections::{BTreeMap, BTreeSet};
use tiles::{Tile, Work};

/// The size of the cells that are swept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// Larger where everything is blurred widely; see [`detail`].
    Adaptive,
    /// Those of the picture everywhere.
    Full,
}

impl Resolution {
    /// The names of both.
    pub const NAMES: [(&'static str, Resolution); 2] =
        [("adaptive", Resolution::Adaptive), ("full", Resolution::Full)];
}

/// The choices of the caller.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The opening.
    pub aperture: Aperture,
    /// Number of lens samples for all tiles; `None` chooses it for each tile.
    pub samples: Option<usize>,
    /// The size of the cells that are swept.
    pub resolution: Resolution,
    /// The second stop of the lens, if it clips anything.
    pub second_stop: Option<SecondStop>,
    /// The aberrations of the lens that change where rays land, if it has any.
    pub aberrated: Option<Box<Aberrated>>,
}

impl Settings {
    /// These choices for a thin lens.
    pub fn new(aperture: Aperture, samples: Option<usize>, resolution: Resolution) -> Settings {
        Settings { aperture, samples, resolution, second_stop: None, aberrated: None }
    }

    /// The same choices, and the picture's own cells everywhere.
    pub(crate) fn at_full_resolution(&self) -> Settings {
        Settings { resolution: Resolution::Full, ..self.clone() }
    }

    /// The lens and the opening, adapted to the focus surface, to the second stop and to aberrations.
    pub(crate) fn leaning(&self, imaging: &Imaging, optics: &Optics) -> Result<(Optics, Settings)> {
        // Lens points stay within the unit disc.
        let k = optics.k * imaging.transverse.as_ref().map_or(1.0, Transverse::widest);
        let (lean, stronger) = imaging.surface.leaning(k)?;
        let aperture = self.aperture.leaning(lean);
        let aberrated = imaging.transverse.as_ref().map(|own| Aberrated::new(own.clone(), &aperture));
        let aberrated = aberrated.map(Box::new);
        let settings = Settings { aperture, second_stop: imaging.second_stop, aberrated, ..*self };
        Ok((Optics { k: k * stronger, ..*optics }, settings))
    }

    /// The clipping of the opening that the falloff needs, if there is a second stop.
    pub(crate) fn clip_of(&self, imaging: &Imaging) -> Option<PupilClip> {
        let falls_off = imaging.falloff.is_some_and(|falloff| falloff.optical);
        let second_stop = imaging.second_stop.filter(|_| falls_off);
        second_stop.map(|second_stop| PupilClip::new(second_stop, &self.aperture))
    }
}

/// What rays that met no cell contribute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Missed {
    /// Their colour is unknown: the other rays of the pixel stand in for them.
    Unknown = 0,
    /// They are transparent.
    Nothing = 1,
}

/// The largest shift of any cell, in front of the focus plane or behind it.
pub fn reach_px(scene: &LayeredScene, s_focus: f64) -> f64 {
    (scene.shifts.0 - s_focus).abs().max((scene.shifts.1 - s_focus).abs())
}

/// The largest radius that is rendered in the picture's own cells alone, in pixels.
pub const FULL_RESOLUTION_PX: f64 = 2048.0;

/// Refuses a radius that is too large for the picture's own cells.
pub fn check_full_resolution(reach_px: f64) -> Result<()> {
    if reach_px <= FULL_RESOLUTION_PX {
        return Ok(());
    }
    Err(value_error!(
        "the circles of confusion have radii of up to {reach_px:.0} px; of more than {FULL_RESOLUTION_PX} px they are for \
         device=\"cpu\" and resolution=\"adaptive\", for color of one layer without alpha below 1 and without holdout, for a \
         lens without cat_eye, coma, astigmatism, barn_doors and psf, and have no gradients. Pass max_coc_px to bound the \
         radius, use a smaller aperture, or correct depths that are too near"
    ))
}

/// The plan of one render.
pub struct Plan {
    /// Shift of the focus relative to infinity.
    pub s_focus: f64,
    /// The largest shift, in front of the focus plane or behind it.
    pub reach_px: f64,
    /// The frame with the margin that rays need.
    pub padding: Padding,
    /// The bounds of depth of the padded frame.
    pub bounds: DepthBounds,
    /// The work of each tile.
    pub tiles: Vec<Tile>,
    /// The samples for every count that some tile needs.
    pub sample_sets: BTreeMap<usize, Vec<LensSample>>,
    /// The size at which cells are drawn.
    pub footprint: Footprint,
    /// The blur of tiles in focus.
    pub in_focus: InFocus,
    /// What rays that meet no cell contribute.
    pub missed: Missed,
    /// The aberrations, if the lens has any.
    pub aberrated: Option<Aberrated>,
}

impl Plan {
    /// The plan for one lens, of the tiles with these origins, in a frame with this margin. The output averages `supersample` pixels along each axis,
    /// so correspondingly fewer samples are enough.
    pub fn new(
        scene: &LayeredScene,
        optics: &Optics,
        settings: &Settings,
        supersample: usize,
        (margin, origins): (Margin, Vec<(usize, usize)>),
        simd: Simd,
    ) -> Plan {
        let s_focus = optics.k * optics.d_focus;
        let count_samples = |radius_px: f64, brightness: f32| {
            let count = || lens_samples::count_for(radius_px / supersample as f64, brightness);
            settings.samples.unwrap_or_else(count)
        };
        let area = settings.aperture.relative_area();
        let reach_px = reach_px(scene, s_focus);
        let aberrated = settings.aberrated.as_deref().cloned();
        let reaches = aberrated.as_ref().map(|own| Reaches::new(own, (scene.size.width, scene.size.height)));
        let all = reaches.as_ref().map_or(Bounds::default(), Reaches::all);
        let padding = Padding::new(scene.size.width, scene.size.height, reach_px + all.offset_px, margin);
        let bounds = padded_bounds::padded(&scene.bounds, &padding);
        // The samples draw highlights as well, but for what is taken out of the scene.
        let left = (reach_px + all.offset_px > in_focus::IN_FOCUS_PX).then(|| scene.highlights(simd));
        let left = left.filter(|found| !found.left.iter().all(Contrast::is_even));
        let contrast = left.map(|found| padded_bounds::contrast(&found.left, scene.bounds.across, &padding));
        let inputs = tiles::Inputs {
            padding: &padding,
            codes: &scene.codes,
            bounds: &bounds,
            s_focus,
            second_stop: settings.second_stop.as_ref(),
            reaches: reaches.as_ref(),
            contrast: contrast.as_deref(),
        };
        let tiles = tiles::plan(&inputs, origins, count_samples);
        let sample_sets = sample_sets(&tiles, &settings.aperture);
        let largest_px = reach_px.hypot(all.spread_px);
        let spacing = |t, n| lens_samples::spacing_px(t, area, n);
        let footprint = Footprint::new(largest_px, |t| count_samples(t, 1.0), spacing, reaches);
        let in_focus = InFocus::new(&settings.aperture, s_focus);
        let missed = if scene.opaque { Missed::Unknown } else { Missed::Nothing };
        Plan {
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
        }
    }
}

fn sample_sets(tiles: &[Tile], aperture: &Aperture) -> BTreeMap<usize, Vec<LensSample>> {
    let counts: BTreeSet<usize> = tiles
        .iter()
        .filter_map(|tile| match tile.work {
            Work::Sweep { samples, .. } => Some(samples),
            Work::InFocus | Work::Disc => None,
        })
        .collect();
    counts.into_iter().map(|n| (n, lens_samples::lens_samples(aperture, n))).collect()
}
