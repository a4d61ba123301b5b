//! The layers of a picture of one layer: edges are unmixed, and the disocclusions behind them are inpainted.

use super::carried;
use super::colors::Colors;
use super::depth_noise::without_noise;
use super::edges;
use super::front_layer::FrontLayer;
use super::half_plane::HalfPlane;
use super::highlights::Limits;
use super::inpaint::{self, Hidden};
use super::lamp_ends::end_lamps;
use super::layer::{Role, SceneLayer, Surfaces};
use super::matting::{MixedPixel, Separated, unmix};
use super::mixed_cells::{half_planes, split};
use super::origins::{self, Origins, Traced, number_of_mixed};
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
    let mut mixed = unmix(&frame, Separated::All, cancel)?;
    let given = groups.iter().map(|group| Colors::new(group.size, Arc::clone(&group.layers[0]))).collect();
    if mixed.is_empty() {
        return Ok(surface.alone(picture, given));
    }
    let limits = limits(picture, simd);
    end_lamps(&mut mixed, &frame, &limits);
    let values = carried::of_mixed(&frame, &mixed, groups);
    let channels = Channels { groups, mixed: &values };
    let hidden = inpaint::hidden(&frame, &surface.s, &mixed, &limits, channels, cancel)?;
    let partial = half_planes(&frame, &mixed);
    let in_front = carried::in_front(given, &mixed, &values);
    let behind = carried::behind(groups, &mixed, &values, &hidden);
    Ok(surface.separated(picture, (&mixed, partial), &hidden, [in_front, behind]))
}

/// The same layers of a picture that carries no channels, and where their colours come from.
pub fn layers_with_origins(
    picture: &Picture,
    lights: usize,
    k: f64,
    simd: Simd,
    cancel: &Cancel,
) -> Result<(Surfaces, Origins)> {
    let layer = &picture.layers[0];
    let surface = FrontSurface::new(picture.size, layer, k, simd);
    let frame = surface.frame(picture, layer, lights);
    let mut mixed = unmix(&frame, Separated::All, cancel)?;
    if mixed.is_empty() {
        return Ok((surface.alone(picture, Vec::new()), Origins::default()));
    }
    let limits = limits(picture, simd);
    end_lamps(&mut mixed, &frame, &limits);
    let of_mixed = origins::of_mixed(&frame, &mixed);
    let pixels = picture.size.pixels();
    let traced = Traced { pixels, of_pixel: |q| Some((q as u32, 1.0)) };
    let hidden = inpaint::hidden(&frame, &surface.s, &mixed, &limits, traced, cancel)?;
    let partial = half_planes(&frame, &mixed);
    let surfaces = surface.separated(picture, (&mixed, partial), &hidden, [Vec::new(), Vec::new()]);
    let (mut in_front, mut behind) = (Vec::new(), Vec::new());
    for (i, m) in mixed.iter().enumerate() {
        let surface = |surface| (m.index, vec![(number_of_mixed(pixels, i, surface), 1.0)]);
        // As in `split`.
        if m.coverage > 0.0 {
            in_front.push(surface(0));
            behind.push(surface(1));
        } else {
            in_front.push(surface(1));
        }
    }
    behind.extend(hidden.into_iter().map(|h| (h.index, h.carried)));
    Ok((surfaces, Origins { layers: vec![in_front, behind], mixed: of_mixed }))
}

/// How bright its pixels may be without highlights.
fn limits(picture: &Picture, simd: Simd) -> Limits {
    Limits::new(picture.size, &Colors::new(picture.size, Arc::clone(&picture.layers[0].color)), simd)
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

    /// The only layer of a scene in which no pixel shows two surfaces. It carries `carried`.
    fn alone(self, picture: &Picture, carried: Vec<Colors>) -> Surfaces {
        let colors = Colors::new(picture.size, Arc::clone(&picture.layers[0].color));
        Surfaces { layers: vec![self.with(colors, carried, Vec::new())], opaque: true }
    }

    /// The surfaces in front and behind, of mixed pixels and hidden ones. They carry `carried`.
    fn separated<L>(
        mut self,
        picture: &Picture,
        (mixed, partial): (&[MixedPixel], Vec<(usize, HalfPlane)>),
        hidden: &[Hidden<L>],
        [in_front, behind]: [Vec<Colors>; 2],
    ) -> Surfaces {
        let size = picture.size;
        let (front_colors, both) = split(mixed, &mut self.s);
        let back = both.iter().map(|m| (m.index, m.s_back, m.back));
        let back = back.chain(hidden.iter().map(|h| (h.index, h.s, h.color)));
        let back = SceneLayer::of_cells(size, back, behind);
        let colors = Colors::new(size, Arc::clone(&picture.layers[0].color)).with(front_colors);
        Surfaces { layers: vec![self.with(colors, in_front, partial), back], opaque: true }
    }

    /// The layer of this surface.
    fn with(self, colors: Colors, carried: Vec<Colors>, partial: Vec<(usize, HalfPlane)>) -> SceneLayer {
        SceneLayer {
            role: Role::Surface,
            s: Arc::new(self.s),
            colors,
            carried,
            partial: Arc::new(partial),
            connectivity: Arc::new(self.connectivity),
        }
    }
}
