//! The layers of a picture of one layer: edges are unmixed, and the disocclusions behind them are inpainted.

use super::carried;
use super::colors::Colors;
use super::depth_noise::without_noise;
use super::edges;
use super::front_layer::FrontLayer;
use super::inpaint;
use super::layer::{Role, SceneLayer, Surfaces};
use super::matting::{Separated, unmix};
use super::mixed_cells::{half_planes, split};
use super::origins::{self, Origins, Traced};
use super::recipe::Channels;
use super::shifts;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::{Layer, Picture, Size};
use crate::simd::Simd;
use std::sync::Arc;

/// The layers of a picture of one layer: edges are unmixed, and the disocclusions behind them are inpainted.
///
/// Coverage, if the picture has it, is a channel that is carried along: a transparent pixel is a surface at infinity
/// that happens to have no colour.
pub fn layers(
    picture: &Picture,
    layer: &Layer,
    lights: usize,
    k: f64,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Surfaces> {
    let (size, groups) = (picture.size, &picture.carried[..]);
    let surface = FrontSurface::new(size, layer, k, simd);
    let frame = surface.frame(picture, layer, lights);
    let colors = Colors::new(size, Arc::clone(&layer.color));
    let mixed = unmix(&frame, Separated::All, cancel)?;
    let given = || groups.iter().map(|group| Colors::new(group.size, Arc::clone(&group.layers[0]))).collect();
    if mixed.is_empty() {
        let FrontSurface { s, connectivity } = surface;
        let front = SceneLayer {
            role: Role::Surface,
            s: Arc::new(s),
            colors,
            carried: given(),
            partial: Arc::default(),
            connectivity: Arc::new(connectivity),
        };
        return Ok(Surfaces { layers: vec![front], opaque: true });
    }
    let partial = half_planes(&frame, &mixed);
    let values = carried::of_mixed(&frame, &mixed, groups);
    let hidden = inpaint::hidden(&frame, &surface.s, &mixed, Channels { groups, mixed: &values }, cancel)?;

    let FrontSurface { mut s, connectivity } = surface;
    let (front_colors, both) = split(&mixed, &mut s);
    let back = both.iter().map(|m| (m.index, m.s_back, m.back));
    let back = back.chain(hidden.iter().map(|h| (h.index, h.s, h.color)));
    let back = SceneLayer::of_cells(size, back, carried::behind(groups, &mixed, &values, &hidden));
    let front = SceneLayer {
        role: Role::Surface,
        s: Arc::new(s),
        colors: colors.with(front_colors),
        carried: carried::in_front(given(), &mixed, &values),
        partial: Arc::new(partial),
        connectivity: Arc::new(connectivity),
    };
    Ok(Surfaces { layers: vec![front, back], opaque: true })
}

/// Where the colours of the layers of a picture of one layer come from, which [`layers`] makes under the same lens.
pub fn origins(picture: &Picture, lights: usize, k: f64, simd: Simd, cancel: &Cancel) -> Result<Origins> {
    let layer = &picture.layers[0];
    let surface = FrontSurface::new(picture.size, layer, k, simd);
    let frame = surface.frame(picture, layer, lights);
    let mixed = unmix(&frame, Separated::All, cancel)?;
    if mixed.is_empty() {
        return Ok(Origins::default());
    }
    let of_mixed = origins::of_mixed(&frame, &mixed);
    let hidden = inpaint::hidden(&frame, &surface.s, &mixed, Traced { mixed: &of_mixed }, cancel)?;
    let mut origins = Origins::default();
    for (m, [front, back]) in mixed.iter().zip(of_mixed) {
        // As in `split`.
        if m.coverage > 0.0 {
            origins.front.push((m.index, front));
            origins.behind.push((m.index, back));
        } else {
            origins.front.push((m.index, back));
        }
    }
    origins.behind.extend(hidden.into_iter().map(|h| (h.index, h.carried)));
    Ok(origins)
}

/// The visible surface of a picture of one layer.
struct FrontSurface {
    s: Buffer<f32>,
    connectivity: Vec<u8>,
}

impl FrontSurface {
    fn new(size: Size, layer: &Layer, k: f64, simd: Simd) -> FrontSurface {
        let s = without_noise(shifts::scaled(&layer.disparity, k), size, simd);
        let connectivity = edges::connectivity(&s, size.width, size.height);
        FrontSurface { s, connectivity }
    }

    fn frame<'a>(&'a self, picture: &'a Picture, layer: &'a Layer, lights: usize) -> FrontLayer<'a> {
        let FrontSurface { s, connectivity } = self;
        let known = &picture.edges;
        FrontLayer { known, ..FrontLayer::new(picture.size, lights, &layer.color, s, connectivity) }
    }
}
