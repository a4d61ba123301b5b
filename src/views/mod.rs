//! Layers behind a picture, of what other views of the scene saw: neighbouring frames, a stereo pair, a light field.
//!
//! In the order of the work: [`camera`] maps pixels of one view to another, and [`motion`] carries along what moves.
//! [`source`] finds the pixels of a view that see what the reference does not, [`lamps`] those that do so in part, and
//! [`trust`] says how far they are to be trusted. [`fragments`] resamples them onto the reference's pixels, and [`merge`]
//! makes surfaces of them.

pub mod axes;
pub mod camera;
mod depth_map;
mod evidence;
mod fragments;
mod lamps;
mod merge;
mod motion;
mod source;
mod trust;
mod view;

use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::scene::edges;
use depth_map::DepthMap;
use fragments::Canvas;
use rayon::prelude::*;
use source::Source;

pub use merge::Cell;
pub use view::{View, Views};

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// The largest number of hidden surfaces at a pixel.
    pub surfaces: usize,
    /// Pixels of blur to a unit of disparity, if what the lens sees is all that is asked for.
    pub lens_k: Option<f64>,
}

/// Rows of the reference that a worker takes at a time. What all views see of them is all that it keeps.
const ROWS: usize = 16;
/// A lens sees no farther behind a silhouette than the difference in shift; the margin allows for rounding.
const MARGIN_PX: f32 = 2.0;

/// The surfaces that the reference does not see: for each place in the order of depth, the pixels that have one.
pub fn hidden(views: &Views, settings: &Settings, cancel: &Cancel) -> Result<Vec<Vec<Cell>>> {
    let Size { width, height, .. } = views.size;
    let reference = &views.views[views.reference];
    let seen = DepthMap { width, height, disparity: &reference.disparity };
    let mut sources = Vec::new();
    for (i, view) in views.views.iter().enumerate() {
        // Parallax of a baseline is the blur of a lens as large: both are a shift by the disparity.
        let parallax = view.camera.baseline(&reference.camera) * reference.camera.focal_px();
        let k = settings.lens_k.map_or(parallax, |lens| lens.max(parallax));
        // From one place all is seen alike, but for what moves.
        if i != views.reference && (parallax > 0.0 || (view.flow.is_some() && k > 0.0)) {
            let map = DepthMap { width, height, disparity: &view.disparity };
            sources.push(Source::new(
                view,
                reference,
                (map, seen),
                (k as f32, views.size, views.lights),
                cancel,
            )?);
        }
    }
    let in_reach = InReach::new(&seen, settings.lens_k);
    let visible = |index: usize, disparity: f32| in_reach.sees(index, disparity);
    let bands: Vec<usize> = (0..height).step_by(ROWS).collect();
    let band = |first: &usize| {
        cancel.check()?;
        let canvas = Canvas { rows: *first..(first + ROWS).min(height), reference: seen, visible: &visible };
        let mut fragments = Vec::new();
        sources.iter().for_each(|source| fragments::draw(source, &canvas, &mut fragments));
        merge::sort(&mut fragments);
        let mut layers = vec![Vec::new(); settings.surfaces];
        let cells = merge::surfaces(&fragments).filter_map(|surface| {
            let cell = merge::merged(surface, views.lights)?;
            // What moves was elsewhere when the others looked.
            let moved = surface.iter().any(|fragment| fragment.moved);
            (moved || merge::is_there(&cell, &seen, &sources)).then_some(cell)
        });
        for cell in cells {
            let is_free =
                |layer: &&mut Vec<Cell>| layer.last().is_none_or(|last: &Cell| last.index < cell.index);
            if let Some(layer) = layers.iter_mut().find(is_free) {
                layer.push(cell);
            }
        }
        Ok(layers)
    };
    let bands = bands.par_iter().map(band).collect::<Result<Vec<_>>>()?;
    let mut layers = vec![Vec::new(); settings.surfaces];
    for band in bands {
        layers.iter_mut().zip(band).for_each(|(all, own)| all.extend(own));
    }
    layers.retain(|layer| !layer.is_empty());
    Ok(layers)
}

/// What a lens sees behind the reference's silhouettes.
struct InReach<'a> {
    seen: DepthMap<'a>,
    /// Pixels of blur to a unit of disparity, and the distance of each pixel to a silhouette.
    lens: Option<(f32, Vec<u8>)>,
}

impl InReach<'_> {
    fn new<'a>(seen: &DepthMap<'a>, lens_k: Option<f64>) -> InReach<'a> {
        let lens = lens_k.map(|k| {
            let s = Buffer::of_each(seen.disparity, |d| (k * f64::from(*d)) as f32);
            let connectivity = edges::connectivity(&s, seen.width, seen.height);
            (k as f32, edges::distance_to_edges(&connectivity, seen.width))
        });
        InReach { seen: *seen, lens }
    }

    /// Whether the lens can see a point at this disparity behind a pixel.
    fn sees(&self, index: usize, disparity: f32) -> bool {
        self.lens.as_ref().is_none_or(|(k, distance)| {
            // Distances are exact below the largest one.
            let reach =
                (k * (self.seen.disparity[index] - disparity) + MARGIN_PX).min(f32::from(edges::FAR_PX));
            f32::from(distance[index]) <= reach
        })
    }
}
