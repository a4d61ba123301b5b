//! The scene as a layered depth image (LDI): for every pixel, the surfaces that a ray meets, front to back.
//!
//! A cell is one surface at one pixel: a depth, an unmixed colour and, where it covers its pixel in part, a
//! half-plane. The layers depend on the strength of the lens (`s = k d`) but not on its focus: a focal stack shares
//! them.

use super::carried;
use super::coarser::Coarser;
use super::colors::{CellColor, Colors};
use super::depth_bounds::DepthBounds;
use super::depth_codes::DepthCodes;
use super::depth_noise::without_noise;
use super::depth_spans::{self, DepthSpans};
use super::edges::{self, CONNECTED_PX, EDGE};
use super::front_layer::FrontLayer;
use super::half_plane::HalfPlane;
use super::highlights;
use super::holdouts;
use super::inpaint::{self, Hidden, SAME_SURFACE_PX};
use super::layer::{Role, SceneLayer};
use super::matting::{MixedPixel, Separated, unmix};
use super::origins::{self, Origins, Traced};
use super::recipe::Channels;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::{Layer, Picture, Size};
use crate::simd::Simd;
use rayon::prelude::*;
use std::collections::HashSet;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// All layers of a scene, front to back.
pub struct LayeredScene {
    /// The frame.
    pub size: Size,
    /// The layers themselves.
    pub layers: Vec<SceneLayer>,
    /// The number of the picture's first layer; those before it are holdouts.
    pub front: usize,
    /// What the pinhole sees of the picture behind its holdouts, in planes. Without holdouts it sees the picture.
    pub held: Option<Arc<Buffer<f32>>>,
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
    highlights: OnceLock<Arc<highlights::Found>>,
    /// The scene at half the size; made when first asked for.
    coarser: OnceLock<Option<Arc<Coarser>>>,
}

impl LayeredScene {
    fn new(picture: &Picture, surfaces: Surfaces, simd: Simd) -> LayeredScene {
        let held = holdouts::seen(picture, &surfaces.layers).map(Arc::new);
        LayeredScene::of_surfaces(picture.size, surfaces, held, simd)
    }

    /// The scene of these surfaces; `held` is what the pinhole sees of them behind holdouts, if there are any.
    pub(super) fn of_surfaces(
        size: Size,
        Surfaces { layers, opaque }: Surfaces,
        held: Option<Arc<Buffer<f32>>>,
        simd: Simd,
    ) -> LayeredScene {
        let front = layers.iter().take_while(|layer| layer.role == Role::Holdout).count();
        let shifts = depth_spans::shift_range(&layers);
        let codes = DepthCodes::new(shifts);
        let depths: Vec<_> =
            (0..layers.len()).map(|layer| DepthSpans::new(&layers, size, layer, &codes, simd)).collect();
        let bounds = DepthBounds::new(size, &depths, &codes, (front, &layers[front]), simd);
        let (depths, bounds) = (Arc::new(depths), Arc::new(bounds));
        let (highlights, coarser) = (OnceLock::new(), OnceLock::new());
        LayeredScene { size, layers, front, held, opaque, shifts, codes, depths, bounds, highlights, coarser }
    }

    /// The same scene with these highlights.
    pub(super) fn with_highlights(self, found: highlights::Found) -> LayeredScene {
        LayeredScene { highlights: OnceLock::from(Arc::new(found)), ..self }
    }

    /// The scene at half the size; `None` where there is none that shows the same.
    pub fn coarser(&self, simd: Simd) -> Option<Arc<Coarser>> {
        let made = self.coarser.get().cloned();
        made.unwrap_or_else(|| {
            let made = Coarser::new(self, simd).map(Arc::new);
            self.coarser.get_or_init(|| made).clone()
        })
    }

    /// The cells of each layer that are highlights, and what is left of them.
    pub fn highlights(&self, simd: Simd) -> Arc<highlights::Found> {
        // The search is not done inside the lock: workers that wait for one another there could wait for themselves.
        let found = self.highlights.get().map(Arc::clone);
        found.unwrap_or_else(|| {
            let found = Arc::new(highlights::find(self.size, &self.layers, self.front, simd));
            Arc::clone(self.highlights.get_or_init(|| found))
        })
    }

    /// The same cells with only these channels of their colours, and without carried ones.
    pub fn of_channels(&self, channels: &[usize]) -> LayeredScene {
        let n = self.size.pixels();
        let of = |layer: &SceneLayer| SceneLayer {
            role: layer.role,
            s: Arc::clone(&layer.s),
            colors: layer.colors.of_channels(channels),
            carried: Vec::new(),
            partial: Arc::clone(&layer.partial),
            connectivity: Arc::clone(&layer.connectivity),
        };
        LayeredScene {
            size: Size { channels: channels.len(), ..self.size },
            layers: self.layers.iter().map(of).collect(),
            front: self.front,
            held: self.held.as_ref().map(|held| {
                let kept: Vec<_> = channels.iter().map(|&c| &held[c * n..][..n]).collect();
                Arc::new(Buffer::concat(&kept))
            }),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::clone(&self.depths),
            bounds: Arc::clone(&self.bounds),
            highlights: OnceLock::new(),
            coarser: OnceLock::new(),
        }
    }

    /// The same cells, without carried channels, in some rows of the frame, which begin with a block and end with one or
    /// with the frame. Everything that was found for the whole frame stays as it is.
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
                role: layer.role,
                s: Arc::new(Buffer::from(&layer.s[pixels.clone()])),
                colors: layer.colors.rows(pixels.clone(), size),
                carried: Vec::new(),
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
            front: self.front,
            held: self.held.as_ref().map(|held| {
                let kept = held.chunks(self.size.pixels()).map(|plane| &plane[pixels.clone()]);
                Arc::new(Buffer::concat(&kept.collect::<Vec<_>>()))
            }),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::new(depths.collect()),
            bounds: Arc::new(self.bounds.rows(rows)),
            highlights: OnceLock::new(),
            coarser: OnceLock::new(),
        }
    }
}

/// The layers of a picture, whose first `lights` channels hold light, under a lens of strength `k` pixels per unit of
/// disparity.
pub fn build(picture: &Picture, lights: usize, k: f64, simd: Simd, cancel: &Cancel) -> Result<LayeredScene> {
    let mut surfaces = match picture.layers.as_slice() {
        [layer] => from_one_layer(picture, layer, lights, k, simd, cancel),
        layers => from_layers(picture.size, lights, layers, k, simd, cancel),
    }?;
    let holdouts = picture.holdouts.iter().map(|holdout| {
        cancel.check()?;
        Ok(holdouts::Cells {
            s: shifts_of_cells(holdout, &holdout.color, picture.size, k, simd),
            partial: layer_half_planes(picture.size, &holdout.color),
        })
    });
    let holdouts = holdouts.collect::<Result<Vec<_>>>()?;
    surfaces.layers = holdouts::between(picture.size, surfaces.layers, surfaces.opaque, &holdouts);
    Ok(LayeredScene::new(picture, surfaces, simd))
}

/// The layers of a picture alone.
pub(super) struct Surfaces {
    pub layers: Vec<SceneLayer>,
    /// See [`LayeredScene::opaque`].
    pub opaque: bool,
}

fn scaled(disparity: &[f32], k: f64) -> Buffer<f32> {
    Buffer::of_each(disparity, |d| (k * f64::from(*d)) as f32)
}

/// The shifts of a layer's cells; NaN where it covers nothing.
fn shifts_of_cells(layer: &Layer, coverage: &[f32], size: Size, k: f64, simd: Simd) -> Buffer<f32> {
    let mut s = scaled(&layer.disparity, k);
    s.iter_mut().zip(coverage).filter(|(_, a)| **a <= 0.0).for_each(|(s, _)| *s = f32::NAN);
    without_noise(s, size, simd)
}

/// The layers of a picture of one layer: edges are unmixed, and the disocclusions behind them are inpainted.
///
/// Coverage, if the picture has it, is a channel that is carried along: a transparent pixel is a surface at infinity
/// that happens to have no colour.
fn from_one_layer(
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
    let given = || groups.iter().map(|group| Colors::new(group.size, Arc::clone(&group.planes))).collect();
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
    let mut back = layer_of_cells(size, back.chain(hidden.iter().map(|h| (h.index, h.s, h.color))));
    let of_groups = groups.iter().enumerate();
    back.carried = of_groups.map(|(g, group)| carried::behind(group, g, &mixed, &values, &hidden)).collect();
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

/// Where the colours of the layers of a picture of one layer come from, which [`build`] makes under the same lens.
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
        let s = without_noise(scaled(&layer.disparity, k), size, simd);
        let connectivity = edges::connectivity(&s, size.width, size.height);
        FrontSurface { s, connectivity }
    }

    fn frame<'a>(&'a self, picture: &'a Picture, layer: &'a Layer, lights: usize) -> FrontLayer<'a> {
        let FrontSurface { s, connectivity } = self;
        let known = &picture.edges;
        FrontLayer { known, ..FrontLayer::new(picture.size, lights, &layer.color, s, connectivity) }
    }
}

/// Gives mixed pixels the shifts of their surfaces in front. Returns these surfaces' colours, and the pixels that have both
/// surfaces.
fn split(mixed: &[MixedPixel], s: &mut [f32]) -> (Vec<CellColor>, Vec<MixedPixel>) {
    // A mixed pixel has both surfaces. If its coverage turns out to be zero, it belongs to the surface behind alone.
    let (both, behind): (Vec<MixedPixel>, Vec<MixedPixel>) = mixed.iter().partition(|m| m.coverage > 0.0);
    let own = |index: usize, color: [f32; 4]| CellColor { index, color };
    let colors = both.iter().map(|m| own(m.index, m.front));
    let colors = colors.chain(behind.iter().map(|m| own(m.index, m.back))).collect();
    both.iter().for_each(|m| s[m.index] = m.s_front);
    behind.iter().for_each(|m| s[m.index] = m.s_back);
    (colors, both)
}

/// Takes the pixels of a first layer apart that mix a lamp and another surface: what one pixel has too much of a surface its
/// neighbour has too little of, but a lamp would be seen at the other one's depth. What of the surfaces behind is in none of
/// the other layers is put there in the order of depth. Returns the cells for which there was no room.
fn take_lamps_apart(
    frame: &FrontLayer,
    front: &mut SceneLayer,
    others: &mut [SceneLayer],
    cancel: &Cancel,
) -> Result<Vec<Hidden>> {
    let mixed = unmix(&FrontLayer { behind: others, ..*frame }, Separated::lamps(frame), cancel)?;
    let mut s = Buffer::clone(&front.s);
    front.partial = Arc::new(half_planes(frame, &mixed));
    let (colors, both) = split(&mixed, &mut s);
    (front.s, front.colors) = (Arc::new(s), front.colors.with(colors));
    Ok(sorted_in(others, &both))
}

/// Puts the surfaces behind mixed pixels into layers, in the order of depth, where those do not have them. Returns the cells
/// for which there was no room: of each pixel the last one.
fn sorted_in(layers: &mut [SceneLayer], mixed: &[MixedPixel]) -> Vec<Hidden> {
    let mut left = Vec::new();
    let mut colors = vec![Vec::new(); layers.len()];
    let mut shifts: Vec<Buffer<f32>> = layers.iter().map(|layer| Buffer::clone(&layer.s)).collect();
    for m in mixed {
        let is_there = |layer: &SceneLayer| (layer.s[m.index] - m.s_back).abs() < SAME_SURFACE_PX;
        if let Some(layer) = layers.iter().position(is_there) {
            // The pinhole sees a part of this cell, and so light that no sample at the pixel's centre may have met.
            if !layers[layer].covers_partly(m.index) {
                let hidden = layers[layer].colors.at(m.index);
                let seen = 1.0 - m.coverage;
                let color = std::array::from_fn(|c| seen * m.back[c] + m.coverage * hidden[c]);
                colors[layer].push(CellColor { index: m.index, color });
            }
            continue;
        }
        let nearer = layers.iter().rposition(|layer| layer.s[m.index] > m.s_back);
        let first = nearer.map_or(0, |layer| layer + 1);
        let mut cell = Some((m.s_back, m.back));
        // Cells that cover their pixel in part keep their place.
        if !layers[first..].iter().any(|layer| layer.covers_partly(m.index)) {
            for layer in first..layers.len() {
                let Some((s, color)) = cell else { break };
                let old = layers[layer].s[m.index];
                cell = (!old.is_nan()).then(|| (old, layers[layer].colors.at(m.index)));
                shifts[layer][m.index] = s;
                colors[layer].push(CellColor { index: m.index, color });
            }
        }
        left.extend(cell.map(|(s, color)| Hidden { index: m.index, s, color, carried: Vec::new() }));
    }
    for ((layer, shifts), colors) in layers.iter_mut().zip(shifts).zip(colors) {
        (layer.s, layer.colors) = (Arc::new(shifts), layer.colors.with(colors));
    }
    left
}

/// The layer that has only these cells: the pixel, the shift and the colour of each.
fn layer_of_cells(size: Size, cells: impl Iterator<Item = (usize, f32, [f32; 4])>) -> SceneLayer {
    let mut shifts = Buffer::full(size.pixels(), f32::NAN);
    let colors = cells.map(|(index, s, color)| {
        shifts[index] = s;
        CellColor { index, color }
    });
    let colors = Colors::of_cells(size, colors.collect());
    SceneLayer {
        role: Role::Surface,
        s: Arc::new(shifts),
        colors,
        carried: Vec::new(),
        partial: Arc::default(),
        connectivity: Arc::default(),
    }
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

/// Layers given by the user: coverage is alpha, and colours are each surface's own. What all of them hide is inpainted
/// in one more layer.
fn from_layers(
    size: Size,
    lights: usize,
    layers: &[Layer],
    k: f64,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Surfaces> {
    let n = size.pixels();
    let alpha = size.channels - 1;
    let mut built = layers
        .iter()
        .map(|layer| {
            cancel.check()?;
            let coverage = &layer.color[alpha * n..];
            let mut known = scaled(&layer.disparity, k);
            let s = shifts_of_cells(layer, coverage, size, k, simd);
            // Where there is no cell, the depth that is given for it tells whether a surface ends.
            known.iter_mut().zip(&*s).filter(|(_, s)| !s.is_nan()).for_each(|(known, s)| *known = *s);
            let connectivity = edges::connectivity(&known, size.width, size.height);
            let mut color = Buffer::clone(&layer.color);
            color.par_chunks_mut(n).for_each(|plane| {
                for (c, &a) in plane.iter_mut().zip(coverage) {
                    *c = if a > 0.0 { *c / a } else { 0.0 };
                }
            });
            let partial = layer_half_planes(size, coverage);
            let colors = Colors::new(size, Arc::new(color));
            Ok(SceneLayer {
                role: Role::Surface,
                s: Arc::new(s),
                colors,
                carried: Vec::new(),
                partial: Arc::new(partial),
                connectivity: Arc::new(connectivity),
            })
        })
        .collect::<Result<Vec<_>>>()?;
    let covered = |i: usize| layers.iter().any(|l| l.color[alpha * n + i] >= 1.0);
    let opaque = (0..n).into_par_iter().all(covered);
    let mut hidden = hidden_by_all(size, lights, layers, &built, cancel)?;
    // A first layer without gaps is a picture.
    if layers[0].color[alpha * n..].iter().all(|a| *a >= 1.0)
        && let Some((front, others)) = built.split_first_mut()
    {
        let (s, connectivity) = (Arc::clone(&front.s), Arc::clone(&front.connectivity));
        let frame = FrontLayer::new(size, lights, &layers[0].color, &s, &connectivity);
        let left = take_lamps_apart(&frame, front, others, cancel)?;
        let taken: HashSet<usize> = left.iter().map(|cell| cell.index).collect();
        hidden.retain(|cell| !taken.contains(&cell.index));
        hidden.extend(left);
    }
    if !hidden.is_empty() {
        built.push(layer_of_cells(size, hidden.iter().map(|h| (h.index, h.s, h.color))));
    }
    Ok(Surfaces { layers: built, opaque })
}

/// What is hidden behind the last surface of each pixel: what the pinhole sees around it continues there, as behind a
/// single layer. Nothing is found where the layers already have it, nor behind what is only partly there: that is no
/// surface which hides all.
///
/// Where the pinhole sees through all layers it sees a surface without coverage, which lies behind every other and is
/// none of them. What continues that is empty space, and stays it.
fn hidden_by_all(
    size: Size,
    lights: usize,
    layers: &[Layer],
    built: &[SceneLayer],
    cancel: &Cancel,
) -> Result<Vec<Hidden>> {
    let (n, alpha) = (size.pixels(), size.channels - 1);
    let nowhere = depth_spans::shift_range(built).0 as f32 - 2.0 * SAME_SURFACE_PX;
    let coverage = |layer: usize, i: usize| layers[layer].color[alpha * n + i];
    // How much a cell counts as what is seen. What light passes through does not hide what is behind it, which goes on
    // there: fully from half of the light on.
    let hides = |layer: usize, i: usize| {
        let whole = coverage(layer, i);
        if whole <= 0.0 || whole >= 1.0 {
            return whole;
        }
        let half_plane = |plane: HalfPlane| plane.area * (2.0 * plane.opacity - 1.0).max(0.0);
        built[layer].half_plane_at(i).map_or(whole, half_plane)
    };
    // The pinhole sees the first layer with which half of the pixel is covered.
    let seen_at = |i: usize| {
        let mut left = 1.0;
        let half_covered = |layer: usize| {
            left *= 1.0 - hides(layer, i);
            left <= 0.5
        };
        (0..layers.len()).position(half_covered).map(|layer| layer as u16)
    };
    let seen: Vec<Option<u16>> = (0..n).into_par_iter().map(seen_at).collect();
    let s_of =
        |(i, seen): (usize, &Option<u16>)| seen.map_or(nowhere, |layer| built[usize::from(layer)].s[i]);
    let s: Vec<f32> = seen.par_iter().enumerate().map(s_of).collect();
    let connectivity = edges::connectivity(&s, size.width, size.height);
    if connectivity.par_iter().all(|c| c & EDGE == 0) {
        return Ok(Vec::new());
    }
    let mut color = Buffer::unset(size.channels * n);
    for (c, plane) in color.chunks_mut(n).enumerate() {
        plane.par_iter_mut().zip(&seen).enumerate().for_each(|(i, (own, seen))| {
            *own = seen.map_or(0.0, |layer| built[usize::from(layer)].colors.at(i)[c]);
        });
    }

    let farthest = |i: usize, least: f32| {
        let cells = (0..built.len()).filter(|&layer| coverage(layer, i) >= least);
        cells.map(|layer| built[layer].s[i]).fold(f32::INFINITY, f32::min)
    };
    let last = |i: usize| Some(farthest(i, 1.0)).filter(|s| s.is_finite()).unwrap_or(nowhere);
    let last: Vec<f32> = (0..n).into_par_iter().map(last).collect();
    let frame = FrontLayer::new(size, lights, &color, &s, &connectivity);
    let found = inpaint::hidden(&frame, &last, &[], Channels { groups: &[], mixed: &[] }, cancel)?;
    let is_new = |h: &Hidden| h.color[alpha] > 0.0 && h.s <= last[h.index] - CONNECTED_PX;
    // Cells that are only partly there keep their place in front.
    let behind = |h: Hidden| Hidden { s: h.s.min(farthest(h.index, f32::MIN_POSITIVE)), ..h };
    Ok(found.into_iter().filter(is_new).map(behind).collect())
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
            (index, HalfPlane::of_layer(around, index))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 48, height: 32, channels: 4 };
    const WALL: f32 = 0.0;

    fn is_bar(i: usize) -> bool {
        (20..28).contains(&(i % SIZE.width))
    }

    /// A layer of grey surfaces: at each pixel its disparity, gray and coverage.
    fn layer(at: impl Fn(usize) -> (f32, f32, f32)) -> Layer {
        let n = SIZE.pixels();
        let color = |i: usize| {
            let (_, gray, coverage) = at(i % n);
            if i / n == 3 { coverage } else { gray * coverage }
        };
        Layer::new(
            Arc::new((0..4 * n).map(color).collect::<Buffer<f32>>()),
            (0..n).map(|i| at(i).0).collect::<Buffer<f32>>(),
        )
    }

    fn built(layers: Vec<Layer>) -> LayeredScene {
        build(&Picture::new(SIZE, layers), 3, 1.0, Simd::PORTABLE, &Cancel::default()).unwrap()
    }

    /// A bar of shift 12 before a wall, or before nothing.
    fn front(wall: f32) -> Layer {
        layer(move |i| if is_bar(i) { (12.0, 0.9, 1.0) } else { (WALL, 0.2, wall) })
    }

    fn back_of_bar() -> Layer {
        layer(|i| (11.0, 0.9, f32::from(is_bar(i))))
    }

    #[test]
    fn what_the_last_surface_hides_is_filled_behind_it() {
        let scene = built(vec![front(1.0), back_of_bar()]);
        let [_, _, filled] = scene.layers.as_slice() else { panic!("{} layers", scene.layers.len()) };
        for i in 0..SIZE.pixels() {
            if is_bar(i) {
                assert_eq!((filled.s[i], filled.colors.at(i)[3]), (WALL, 1.0));
                assert!((filled.colors.at(i)[0] - 0.2).abs() < 1e-6);
            } else {
                assert!(filled.s[i].is_nan());
            }
        }
    }

    #[test]
    fn nothing_is_filled_before_a_wall_that_is_given() {
        // The wall of the second layer is sloped: beside the bar it is farther away than behind it.
        let slope = |i: usize| WALL - 0.1 * (i % SIZE.width).abs_diff(24) as f32;
        let sloped = layer(move |i| if is_bar(i) { (12.0, 0.9, 1.0) } else { (slope(i), 0.2, 1.0) });
        let wall = layer(move |i| (slope(i), 0.2, 1.0));
        assert_eq!(built(vec![sloped, wall.clone()]).layers.len(), 2);
        assert_eq!(built(vec![front(1.0), back_of_bar(), layer(|_| (WALL, 0.2, 1.0))]).layers.len(), 3);
    }

    #[test]
    fn what_light_passes_through_does_not_hide_the_wall() {
        // Less than half of the light passes through both panes.
        let pane = |s: f32| layer(move |_| (s, 0.5, 0.4));
        let scene = built(vec![pane(30.0), pane(29.0), front(1.0), back_of_bar()]);
        let filled = |scene: &LayeredScene| scene.layers.last().unwrap().s.to_vec();
        let cells = |s: &[f32]| s.iter().filter(|s| !s.is_nan()).count();
        let (seen_through, bare) = (filled(&scene), filled(&built(vec![front(1.0), back_of_bar()])));
        assert_eq!(cells(&seen_through), cells(&bare));
        assert!(seen_through.iter().zip(&bare).all(|(a, b)| a == b || a.is_nan() && b.is_nan()));
    }

    #[test]
    fn empty_space_stays_empty() {
        assert_eq!(built(vec![front(0.0), back_of_bar()]).layers.len(), 2);
        // A speck of wall beside the bar does not outweigh the empty space around it.
        let speck = layer(|i| {
            if is_bar(i) { (12.0, 0.9, 1.0) } else { (WALL, 0.2, f32::from(i == 16 * SIZE.width + 28)) }
        });
        let scene = built(vec![speck, back_of_bar()]);
        let filled = scene.layers.get(2).map_or(0, |layer| layer.s.iter().filter(|s| !s.is_nan()).count());
        assert!(filled < SIZE.pixels() / 100, "{filled}");
    }
}
