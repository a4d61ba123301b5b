//! The scene as a layered depth image (LDI): for every pixel, the surfaces that a ray meets, front to back.
//!
//! A cell is one surface at one pixel: a depth, an unmixed colour and, where it covers its pixel in part, a
//! half-plane. The layers depend on the strength of the lens (`s = k d`) but not on its focus: a focal stack shares
//! them.

use super::colors::{CellColor, Colors};
use super::depth_bounds::DepthBounds;
use super::depth_codes::DepthCodes;
use super::depth_spans::{self, DepthSpans};
use super::edges;
use super::half_plane::HalfPlane;
use super::highlights::{self, Bright};
use super::inpaint;
use super::layer::SceneLayer;
use super::matting::{FrontLayer, MixedPixel, unmix};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::{Layer, Picture, Size};
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// All layers of a scene, front to back.
pub struct LayeredScene {
    /// The frame.
    pub size: Size,
    /// The layers themselves.
    pub layers: Vec<SceneLayer>,
    /// What a ray that meets no cell has met. If set, it is an unknown surface, and the other rays speak for it;
    /// otherwise it is empty space.
    pub opaque: bool,
    /// Least and greatest shift of all cells, relative to infinity.
    pub shifts: (f64, f64),
    /// How depths are coded.
    pub codes: DepthCodes,
    /// The depths of each layer.
    pub depths: Arc<Vec<DepthSpans>>,
    /// The bounds of depth in the blocks of the frame.
    pub bounds: Arc<DepthBounds>,
    /// The highlights; found when first asked for.
    bright: OnceLock<Arc<Vec<Vec<Bright>>>>,
}

impl LayeredScene {
    fn new(size: Size, layers: Vec<SceneLayer>, opaque: bool, simd: Simd) -> LayeredScene {
        let shifts = depth_spans::shift_range(&layers);
        let codes = DepthCodes::new(shifts);
        let depths: Vec<_> =
            (0..layers.len()).map(|layer| DepthSpans::new(&layers, size, layer, &codes, simd)).collect();
        let bounds = DepthBounds::new(size, &depths, &codes, &layers[0].connectivity, simd);
        let (depths, bounds) = (Arc::new(depths), Arc::new(bounds));
        LayeredScene { size, layers, opaque, shifts, codes, depths, bounds, bright: OnceLock::new() }
    }

    /// The cells of each layer that are highlights.
    pub fn bright(&self, simd: Simd) -> Arc<Vec<Vec<Bright>>> {
        // The search is not done inside the lock: workers that wait for one another there could wait for themselves.
        let found = self.bright.get().map(Arc::clone);
        found.unwrap_or_else(|| {
            let found = Arc::new(highlights::find(self.size, &self.layers, simd));
            Arc::clone(self.bright.get_or_init(|| found))
        })
    }

    /// The same cells with only these channels of their colours.
    pub fn of_channels(&self, channels: &[usize]) -> LayeredScene {
        let of = |layer: &SceneLayer| SceneLayer {
            s: Arc::clone(&layer.s),
            colors: layer.colors.of_channels(channels),
            partial: Arc::clone(&layer.partial),
            connectivity: Arc::clone(&layer.connectivity),
        };
        LayeredScene {
            size: Size { channels: channels.len(), ..self.size },
            layers: self.layers.iter().map(of).collect(),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::clone(&self.depths),
            bounds: Arc::clone(&self.bounds),
            bright: OnceLock::new(),
        }
    }

    /// The same cells in some rows of the frame, which begin with a block and end with one or with the frame.
    /// Everything that was found for the whole frame stays as it is.
    pub fn rows(&self, rows: Range<usize>) -> LayeredScene {
        let width = self.size.width;
        let pixels = rows.start * width..rows.end * width;
        let size = Size { height: rows.len(), ..self.size };
        let of = |layer: &SceneLayer| {
            let partial = layer.partial.iter().filter(|(index, _)| pixels.contains(index));
            let partial = partial.map(|(index, plane)| (index - pixels.start, *plane)).collect();
            let connectivity = if layer.connectivity.is_empty() {
                Vec::new()
            } else {
                layer.connectivity[pixels.clone()].to_vec()
            };
            SceneLayer {
                s: Arc::new(Buffer::from(&layer.s[pixels.clone()])),
                colors: layer.colors.rows(pixels.clone(), size),
                partial: Arc::new(partial),
                connectivity: Arc::new(connectivity),
            }
        };
        let depths = self.depths.iter().map(|depths| DepthSpans {
            lo: Buffer::from(&depths.lo[pixels.clone()]),
            hi: Buffer::from(&depths.hi[pixels.clone()]),
        });
        LayeredScene {
            size,
            layers: self.layers.iter().map(of).collect(),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::new(depths.collect()),
            bounds: Arc::new(self.bounds.rows(rows)),
            bright: OnceLock::new(),
        }
    }
}

/// The layers of a picture, whose first `lights` channels hold light, under a lens of strength `k` pixels per unit of
/// disparity.
pub fn build(picture: &Picture, lights: usize, k: f64, simd: Simd, cancel: &Cancel) -> Result<LayeredScene> {
    match picture.layers.as_slice() {
        [layer] => from_one_layer(picture.size, lights, layer, k, simd, cancel),
        layers => from_layers(picture.size, layers, k, simd, cancel),
    }
}

fn scaled(disparity: &[f32], k: f64) -> Buffer<f32> {
    Buffer::of_each(disparity, |d| (k * f64::from(*d)) as f32)
}

/// The layers of a picture of one layer: edges are unmixed, and the disocclusions behind them are inpainted.
///
/// Coverage, if the picture has it, is a channel that is carried along: a transparent pixel is a surface at infinity
/// that happens to have no colour.
fn from_one_layer(
    size: Size,
    lights: usize,
    layer: &Layer,
    k: f64,
    simd: Simd,
    cancel: &Cancel,
) -> Result<LayeredScene> {
    let mut s = scaled(&layer.disparity, k);
    let connectivity = edges::connectivity(&s, size.width, size.height);
    let colors = Colors::new(size, Arc::clone(&layer.color));
    let frame = FrontLayer { size, lights, color: &layer.color, s: &s, connectivity: &connectivity };
    let mixed = unmix(&frame, cancel)?;
    if mixed.is_empty() {
        let front = SceneLayer {
            s: Arc::new(s),
            colors,
            partial: Arc::default(),
            connectivity: Arc::new(connectivity),
        };
        return Ok(LayeredScene::new(size, vec![front], true, simd));
    }
    let partial = half_planes(&frame, &mixed);
    let hidden = inpaint::hidden(&frame, &mixed, cancel)?;

    // A mixed pixel has both surfaces. If its coverage turns out to be zero, it belongs to the surface behind alone.
    let (both, behind): (Vec<MixedPixel>, Vec<MixedPixel>) = mixed.iter().partition(|m| m.coverage > 0.0);
    let own = |index: usize, color: [f32; 4]| CellColor { index, color };
    let front_colors = both.iter().map(|m| own(m.index, m.front));
    let front_colors = front_colors.chain(behind.iter().map(|m| own(m.index, m.back))).collect();
    let back_colors = both.iter().map(|m| own(m.index, m.back));
    let back_colors = back_colors.chain(hidden.iter().map(|h| own(h.index, h.color))).collect();

    both.iter().for_each(|m| s[m.index] = m.s_front);
    behind.iter().for_each(|m| s[m.index] = m.s_back);
    let mut back_s = Buffer::full(size.pixels(), f32::NAN);
    both.iter().for_each(|m| back_s[m.index] = m.s_back);
    hidden.iter().for_each(|h| back_s[h.index] = h.s);

    let front = SceneLayer {
        s: Arc::new(s),
        colors: colors.with(front_colors),
        partial: Arc::new(partial),
        connectivity: Arc::new(connectivity),
    };
    let colors = Colors::of_cells(size, back_colors);
    let back =
        SceneLayer { s: Arc::new(back_s), colors, partial: Arc::default(), connectivity: Arc::default() };
    Ok(LayeredScene::new(size, vec![front, back], true, simd))
}

/// Half-planes of the pixels whose coverage is neither 0 nor 1.
fn half_planes(frame: &FrontLayer, mixed: &[MixedPixel]) -> Vec<(usize, HalfPlane)> {
    let (width, height) = (frame.size.width, frame.size.height);
    let first_from = |index: usize| mixed.partition_point(|m| m.index < index);
    let starts: Vec<usize> = (0..=height).into_par_iter().map(|y| first_from(y * width)).collect();
    let row = |y: usize| {
        let row_of = |y: usize| &mixed[starts[y]..starts[y + 1]];
        // The rows above, here and below, each without the pixels too far left to be neighbours of any pixel still to
        // come.
        let mut rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(row_of);
        let mut planes = Vec::new();
        for m in row_of(y) {
            let x = m.index % width;
            for row in &mut rows {
                let left = row.iter().take_while(|q| q.index % width + 1 < x).count();
                *row = &row[left..];
            }
            if m.coverage <= 0.0 || m.coverage >= 1.0 {
                continue;
            }
            let middle = 0.5 * (m.s_front + m.s_back);
            let coverage_of = |j: usize, q: usize| {
                let own = rows[j].iter().take(3).find(|other| other.index == q);
                own.map_or_else(|| f32::from(frame.s[q] > middle), |own| own.coverage)
            };
            let around = std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    let q = frame.offset(x, y, i as i32 - 1, j as i32 - 1);
                    q.map_or(m.coverage, |q| coverage_of(j, q))
                })
            });
            planes.push((m.index, HalfPlane::from_coverage(around, m.index)));
        }
        planes
    };
    (0..height).into_par_iter().flat_map_iter(row).collect()
}

/// Layers given by the user: coverage is alpha, colours are each surface's own, and nothing is inpainted.
fn from_layers(size: Size, layers: &[Layer], k: f64, simd: Simd, cancel: &Cancel) -> Result<LayeredScene> {
    let n = size.pixels();
    let alpha = size.channels - 1;
    let built = layers
        .iter()
        .map(|layer| {
            cancel.check()?;
            let coverage = &layer.color[alpha * n..];
            let mut s = scaled(&layer.disparity, k);
            let connectivity = edges::connectivity(&s, size.width, size.height);
            s.iter_mut().zip(coverage).filter(|(_, a)| **a <= 0.0).for_each(|(s, _)| *s = f32::NAN);
            let mut color = Buffer::clone(&layer.color);
            color.par_chunks_mut(n).for_each(|plane| {
                for (c, &a) in plane.iter_mut().zip(coverage) {
                    *c = if a > 0.0 { *c / a } else { 0.0 };
                }
            });
            let partial = layer_half_planes(size, coverage);
            let colors = Colors::new(size, Arc::new(color));
            Ok(SceneLayer {
                s: Arc::new(s),
                colors,
                partial: Arc::new(partial),
                connectivity: Arc::new(connectivity),
            })
        })
        .collect::<Result<Vec<_>>>()?;
    let covered = |i: usize| layers.iter().any(|l| l.color[alpha * n + i] >= 1.0);
    let opaque = (0..n).into_par_iter().all(covered);
    Ok(LayeredScene::new(size, built, opaque, simd))
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
