//! The scene as sheets of cells: at every pixel, what a ray finds in front and what it finds behind.
//!
//! A cell has a place in depth, a pure colour and, where it covers its pixel in part, a half-plane. Sheets
//! depend on the strength of the lens (`s = k d`) but not on its focus, so a focal stack shares them.

use super::fill::{self, Hidden};
use super::surfaces;
use super::unmix::{Frame, HalfPlane, Mixed, unmix};
use crate::picture::{Layer, Picture, Size};
use rayon::prelude::*;
use std::sync::Arc;

/// One cell a pixel at most.
pub struct Sheet {
    /// Shift of every cell relative to infinity, in pixels; NaN where there is none.
    pub s: Vec<f32>,
    /// Colour of every cell, planar; zero where there is none.
    pub color: Arc<Vec<f32>>,
    /// The cells that cover their pixel in part, by rising index.
    pub partial: Vec<(usize, HalfPlane)>,
    /// Steeper neighbours than [`surfaces::CONNECTED_PX`] that are one surface all the same; see
    /// [`surfaces::links`]. Empty for a sheet whose cells are no plain pixels.
    pub links: Vec<u8>,
}

impl Sheet {
    fn empty(size: Size) -> Sheet {
        Sheet {
            s: vec![f32::NAN; size.pixels()],
            color: Arc::new(vec![0.0; size.pixels() * size.channels]),
            partial: Vec::new(),
            links: Vec::new(),
        }
    }

    fn set(&mut self, size: Size, index: usize, s: f32, color: [f32; 4]) {
        self.s[index] = s;
        let planes = Arc::make_mut(&mut self.color);
        for c in 0..size.channels {
            planes[c * size.pixels() + index] = color[c];
        }
    }
}

/// All sheets of a scene, front to back.
pub struct Sheets {
    /// The frame.
    pub size: Size,
    /// The sheets themselves.
    pub sheets: Vec<Sheet>,
    /// Whether a ray that meets no cell has met something unknown (then the others speak for it) rather than
    /// nothing at all.
    pub opaque: bool,
}

/// The sheets of a picture under a lens of strength `k` pixels per unit of disparity.
pub fn build(picture: &Picture, k: f64) -> Sheets {
    match picture.layers.as_slice() {
        [layer] => from_one_layer(picture.size, layer, k),
        layers => from_layers(picture.size, layers, k),
    }
}

fn scaled(disparity: &[f32], k: f64) -> Vec<f32> {
    disparity.par_iter().map(|&d| (k * f64::from(d)) as f32).collect()
}

/// One layer: edges are unmixed, and what lies hidden behind them is filled in.
///
/// Coverage, if the picture has it, is one more channel: what is transparent is a surface at infinity that
/// happens to have no colour.
fn from_one_layer(size: Size, layer: &Layer, k: f64) -> Sheets {
    let s = scaled(&layer.disparity, k);
    let links = surfaces::links(&s, size.width, size.height);
    let frame = Frame { size, color: &layer.color, s: &s, links: &links };
    let mixed = unmix(&frame);
    if mixed.is_empty() {
        let front = Sheet { color: Arc::clone(&layer.color), s, partial: Vec::new(), links };
        return Sheets { size, sheets: vec![front], opaque: true };
    }

    let mut front =
        Sheet { s: s.clone(), color: Arc::clone(&layer.color), partial: Vec::new(), links: Vec::new() };
    let mut back = Sheet::empty(size);
    for m in &mixed {
        if m.coverage > 0.0 {
            front.set(size, m.index, m.s_front, m.front);
            back.set(size, m.index, m.s_back, m.back);
        } else {
            front.set(size, m.index, m.s_back, m.back);
        }
    }
    front.partial = half_planes(&frame, &mixed);

    let hidden = fill::hidden(&frame, &front.s, &back);
    for Hidden { index, s, color } in hidden {
        back.set(size, index, s, color);
    }
    front.links = links;
    Sheets { size, sheets: vec![front, back], opaque: true }
}

/// Half-planes of the pixels that are mixed in earnest.
fn half_planes(frame: &Frame, mixed: &[Mixed]) -> Vec<(usize, HalfPlane)> {
    let width = frame.size.width;
    let coverage_of = |q: usize, middle: f32| match mixed.binary_search_by_key(&q, |m| m.index) {
        Ok(i) => mixed[i].coverage,
        Err(_) => f32::from(frame.s[q] > middle),
    };
    mixed
        .par_iter()
        .filter(|m| m.coverage > 0.0 && m.coverage < 1.0)
        .map(|m| {
            let (x, y) = (m.index % width, m.index / width);
            let middle = 0.5 * (m.s_front + m.s_back);
            let around = std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    frame
                        .offset(x, y, i as i32 - 1, j as i32 - 1)
                        .map_or(m.coverage, |q| coverage_of(q, middle))
                })
            });
            (m.index, HalfPlane::from_coverage(around, m.index))
        })
        .collect()
}

/// Real layers: coverage is alpha, colours are each surface's own, nothing is invented.
fn from_layers(size: Size, layers: &[Layer], k: f64) -> Sheets {
    let n = size.pixels();
    let alpha = size.channels - 1;
    let sheets = layers
        .iter()
        .map(|layer| {
            let coverage = &layer.color[alpha * n..];
            let mut s = scaled(&layer.disparity, k);
            let links = surfaces::links(&s, size.width, size.height);
            s.iter_mut().zip(coverage).filter(|(_, a)| **a <= 0.0).for_each(|(s, _)| *s = f32::NAN);
            let mut color = Vec::clone(&layer.color);
            color.par_chunks_mut(n).for_each(|plane| {
                for (c, &a) in plane.iter_mut().zip(coverage) {
                    *c = if a > 0.0 { *c / a } else { 0.0 };
                }
            });
            Sheet { s, color: Arc::new(color), partial: layer_half_planes(size, coverage), links }
        })
        .collect();
    let covered = |i: usize| layers.iter().any(|l| l.color[alpha * n + i] >= 1.0);
    Sheets { size, sheets, opaque: (0..n).into_par_iter().all(covered) }
}

fn layer_half_planes(size: Size, coverage: &[f32]) -> Vec<(usize, HalfPlane)> {
    (0..size.pixels())
        .into_par_iter()
        .filter(|&i| coverage[i] > 0.0 && coverage[i] < 1.0)
        .map(|index| {
            let (x, y) = (index % size.width, index / size.width);
            let clamped = |v: usize, d: usize, n: usize| (v + d).saturating_sub(1).min(n - 1);
            let around = std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    coverage[clamped(y, j, size.height) * size.width + clamped(x, i, size.width)]
                })
            });
            (index, HalfPlane::from_coverage(around, index))
        })
        .collect()
}
