//! Holdouts: cells between the layers of a picture that stop the light of what is behind them and have none of their own.
//!
//! The picture is prepared as if there were none, so what it hides is filled as ever. Then each cell of a holdout is put
//! between those of the picture that are nearer and those that are not: a ray that meets it ends there, with nothing.

use super::colors::Colors;
use super::half_plane::HalfPlane;
use super::layer::{Role, SceneLayer};
use crate::memory::Buffer;
use crate::picture::{ChannelGroup, Picture, Size, range};
use rayon::prelude::*;
use std::iter;
use std::sync::Arc;

/// The cells of one holdout.
pub struct Cells {
    /// Shift of every cell relative to infinity, in pixels; NaN where there is no cell.
    pub s: Buffer<f32>,
    /// The cells that cover their pixel only partly, sorted by index.
    pub partial: Vec<(usize, HalfPlane)>,
}

/// Some holdouts' cells between the same two layers of the picture, at most one a pixel.
struct Between {
    s: Buffer<f32>,
    partial: Vec<(usize, HalfPlane)>,
}

/// The layers of a picture with those of its holdouts between them, so that the cells of every pixel are in the order of
/// depth. A holdout as far away as a surface is in front of it.
///
/// What has nothing behind it stops nothing and is left out: what is behind the whole picture; and, if the picture is
/// `opaque`, what is behind the last surface of its pixel, where a ray that slips through between the picture's cells is to
/// meet nothing rather than darkness.
pub fn between(
    picture: &Picture,
    layers: Vec<SceneLayer>,
    opaque: bool,
    holdouts: &[Cells],
) -> Vec<SceneLayer> {
    let size = picture.size;
    if holdouts.is_empty() {
        return layers;
    }
    let farthest = layers.iter().map(|layer| range(&layer.s)[0]).fold(f32::INFINITY, f32::min);
    let place = |i: usize, s: f32| {
        let place = layers.iter().position(|layer| layer.s[i] <= s);
        place.or_else(|| (!opaque && s >= farthest).then_some(layers.len()))
    };
    let mut all: Vec<Vec<Between>> = iter::repeat_with(Vec::new).take(layers.len() + 1).collect();
    let mut partial: Vec<_> = holdouts.iter().map(|holdout| holdout.partial.iter().peekable()).collect();
    let mut cells: Vec<(usize, f32, Option<HalfPlane>)> = Vec::new();
    for i in 0..size.pixels() {
        cells.clear();
        for (holdout, partial) in holdouts.iter().zip(&mut partial) {
            let plane = partial.next_if(|(index, _)| *index == i).map(|(_, plane)| *plane);
            let s = holdout.s[i];
            cells.extend(place(i, s).map(|place| (place, s, plane)));
        }
        cells.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
        for same in cells.chunk_by(|a, b| a.0 == b.0) {
            for (number, (place, s, plane)) in same.iter().enumerate() {
                let layers = &mut all[*place];
                if layers.len() == number {
                    layers.push(Between { s: Buffer::full(size.pixels(), f32::NAN), partial: Vec::new() });
                }
                layers[number].s[i] = *s;
                layers[number].partial.extend(plane.map(|plane| (i, plane)));
            }
        }
    }
    let layer_of = |Between { s, partial }: Between| SceneLayer {
        role: Role::Holdout,
        s: Arc::new(s),
        colors: Colors::of_cells(size, Vec::new()),
        carried: picture.carried.iter().map(|group| Colors::of_cells(group.size, Vec::new())).collect(),
        partial: Arc::new(partial),
        connectivity: Arc::default(),
    };
    let mut layers = layers.into_iter();
    let placed = all.into_iter().flat_map(|holdouts| {
        let holdouts = holdouts.into_iter().map(layer_of).collect::<Vec<_>>();
        holdouts.into_iter().chain(layers.next())
    });
    placed.collect()
}

/// What the pinhole sees of a picture behind its holdouts, in planes.
pub struct Held {
    /// Of the picture itself.
    pub own: Arc<Buffer<f32>>,
    /// Of each group of channels that it carries.
    pub carried: Vec<Buffer<f32>>,
}

impl Held {
    /// Of a picture that carries nothing.
    pub fn of_picture(own: Buffer<f32>) -> Held {
        Held { own: Arc::new(own), carried: Vec::new() }
    }
}

/// What the pinhole sees of a picture whose `layers` have holdouts between them; `None` if they have none.
pub fn seen(picture: &Picture, layers: &[SceneLayer]) -> Option<Held> {
    if layers.iter().all(|layer| layer.role == Role::Surface) {
        return None;
    }
    let coverage = picture.coverage();
    let own: Vec<&[f32]> = picture.layers.iter().map(|layer| &layer.color[..]).collect();
    let own = seen_of(picture.size, (&own, &coverage), layers, |layer, i| layer.colors.at(i));
    let of_group = |(g, group): (usize, &ChannelGroup)| {
        let given: Vec<&[f32]> = group.layers.iter().map(|planes| &planes[..]).collect();
        seen_of(group.size, (&given, &coverage), layers, |layer, i| layer.carried[g].at(i))
    };
    Some(Held { own: Arc::new(own), carried: picture.carried.iter().enumerate().map(of_group).collect() })
}

/// The same of some channels, which are `given` as planes of each layer with its coverage and have the values `at` in cells.
///
/// Pixels without a holdout are those of the picture, bit for bit.
fn seen_of(
    size: Size,
    (given, coverage): (&[&[f32]], &[&[f32]]),
    layers: &[SceneLayer],
    at: impl Fn(&SceneLayer, usize) -> [f32; 4] + Sync,
) -> Buffer<f32> {
    let n = size.pixels();
    let as_given = |i: usize, c: usize| {
        let (mut sum, mut left) = (given[0][c * n + i], 1.0);
        for (before, planes) in coverage.iter().zip(&given[1..]) {
            left *= 1.0 - before[i];
            sum += left * planes[c * n + i];
        }
        sum
    };
    let held = |i: usize, c: usize| {
        let (mut sum, mut left) = (0.0, 1.0);
        for layer in layers.iter().filter(|layer| !layer.s[i].is_nan()) {
            let coverage = layer.half_plane_at(i).map_or(1.0, |plane| plane.coverage());
            sum += left * coverage * at(layer, i)[c];
            left *= 1.0 - coverage;
        }
        sum
    };
    let is_held = |i: usize| layers.iter().any(|layer| layer.role == Role::Holdout && !layer.s[i].is_nan());
    let mut planes = Buffer::unset(size.channels * n);
    for (c, plane) in planes.chunks_mut(n).enumerate() {
        let pixels = plane.par_iter_mut().enumerate();
        pixels.for_each(|(i, v)| *v = if is_held(i) { held(i, c) } else { as_given(i, c) });
    }
    planes
}
