//! The layers of a picture that is given in layers: coverage is alpha, and colours are each surface's own. What all of them
//! hide is inpainted in one more layer.

use super::carried;
use super::colors::Colors;
use super::depth_spans;
use super::edges::{self, CONNECTED_PX, EDGE};
use super::exits::SAME_SURFACE_PX;
use super::front_layer::FrontLayer;
use super::half_plane::{self, HalfPlane};
use super::highlights::Limits;
use super::inpaint::{self, Hidden};
use super::lamps::{lamps, take_lamps_apart};
use super::layer::{Role, SceneLayer, Surfaces};
use super::origins::{Origins, Traced};
use super::recipe::{Cargo, Channels};
use super::shifts;
use crate::cancel::Cancel;
use crate::error::{Result, value_error};
use crate::memory::Buffer;
use crate::picture::{ChannelGroup, Layer, Picture, Size};
use crate::simd::Simd;
use rayon::prelude::*;
use std::collections::HashSet;
use std::sync::Arc;

/// The layers of a picture whose first `lights` channels hold light, and which is given in layers.
pub fn layers(picture: &Picture, lights: usize, k: f64, simd: Simd, cancel: &Cancel) -> Result<Surfaces> {
    let (size, layers, groups) = (picture.size, &picture.layers[..], &picture.carried[..]);
    let n = size.pixels();
    let alpha = size.channels - 1;
    let mut built = given(picture, k, simd, cancel)?;
    let covered = |i: usize| layers.iter().any(|l| l.color[alpha * n + i] >= 1.0);
    let opaque = (0..n).into_par_iter().all(covered);
    let mut hidden = match Pinhole::new(picture, &built) {
        Some(pinhole) => {
            let groups = seen_channels(groups, &built, &pinhole.seen);
            pinhole.hidden(lights, Channels { groups: &groups, mixed: &[] }, simd, cancel)?
        }
        None => Vec::new(),
    };
    if let Some((front, others)) = without_gaps(picture, &mut built) {
        let (s, connectivity) = (Arc::clone(&front.s), Arc::clone(&front.connectivity));
        let frame = FrontLayer::new(size, lights, &layers[0].color, &s, &connectivity);
        let left = take_lamps_apart(&frame, groups, front, others, cancel)?;
        let taken: HashSet<usize> = left.iter().map(|cell| cell.index).collect();
        hidden.retain(|cell| !taken.contains(&cell.index));
        hidden.extend(left);
    }
    if !hidden.is_empty() {
        let carried = carried::behind(groups, &[], &[], &hidden);
        built.push(SceneLayer::of_cells(size, hidden.iter().map(|h| (h.index, h.s, h.color)), carried));
    }
    Ok(Surfaces { layers: built, opaque })
}

/// Where the colours of these layers come from, of a picture that carries no channels.
pub fn origins(picture: &Picture, lights: usize, k: f64, simd: Simd, cancel: &Cancel) -> Result<Origins> {
    let (size, n) = (picture.size, picture.size.pixels());
    let mut built = given(picture, k, simd, cancel)?;
    if let Some((front, others)) = without_gaps(picture, &mut built) {
        let frame = FrontLayer::new(size, lights, &picture.layers[0].color, &front.s, &front.connectivity);
        let lamps = lamps(&FrontLayer { behind: others, ..frame }, cancel)?;
        if let Some(first) = lamps.first() {
            return Err(value_error!(
                "gradients of layers are for pictures in which no lamp mixes with another surface at the edge of a first \
                 layer without gaps; got {} such pixels, the first at row {}, column {}",
                lamps.len(),
                first.index / size.width,
                first.index % size.width
            ));
        }
    }
    let mut layers: Vec<_> = built.iter().map(|_| Vec::new()).collect();
    if let Some(pinhole) = Pinhole::new(picture, &built) {
        let alpha = &picture.coverage();
        // What goes on behind a pixel is the cell that the pinhole sees there, whose colour is that of what it covers.
        let of_pixel = |i: usize| {
            let layer = usize::from(pinhole.seen[i]?);
            Some(((layer * n + i) as u32, 1.0 / alpha[layer][i]))
        };
        let traced = Traced { pixels: picture.layers.len() * n, of_pixel };
        let hidden = pinhole.hidden(lights, traced, simd, cancel)?;
        layers.push(hidden.into_iter().map(|h| (h.index, h.carried)).collect());
    }
    Ok(Origins { layers, mixed: Vec::new() })
}

/// The first layer and the others, if the first one has no gaps: it is a picture.
fn without_gaps<'a>(
    picture: &Picture,
    built: &'a mut [SceneLayer],
) -> Option<(&'a mut SceneLayer, &'a mut [SceneLayer])> {
    let whole = picture.coverage()[0].iter().all(|a| *a >= 1.0);
    built.split_first_mut().filter(|_| whole)
}

/// The layers as they are given.
fn given(picture: &Picture, k: f64, simd: Simd, cancel: &Cancel) -> Result<Vec<SceneLayer>> {
    let (size, groups) = (picture.size, &picture.carried[..]);
    let first = (size.channels - 1) * size.pixels();
    let build = |(number, layer): (usize, &Layer)| {
        cancel.check()?;
        let coverage = &layer.color[first..];
        let mut known = shifts::scaled(&layer.disparity, k);
        let s = shifts::of_cells(layer, coverage, size, k, simd);
        // Where there is no cell, the depth that is given for it tells whether a surface ends.
        known.iter_mut().zip(&*s).filter(|(_, s)| !s.is_nan()).for_each(|(known, s)| *known = *s);
        let connectivity = edges::connectivity(&known, size.width, size.height);
        let mut color = Buffer::clone(&layer.color);
        divide_by_coverage(&mut color, coverage);
        Ok(SceneLayer {
            role: Role::Surface,
            s: Arc::new(s),
            colors: Colors::new(size, Arc::new(color)),
            carried: carried_by(groups, number, coverage),
            partial: Arc::new(half_plane::of_layer(size, coverage)),
            connectivity: Arc::new(connectivity),
        })
    };
    picture.layers.iter().enumerate().map(build).collect()
}

/// What the pinhole sees of layers, as a picture of one.
///
/// Where it sees through all layers it sees a surface without coverage, which lies behind every other and is none of them.
/// What continues that is empty space, and stays it.
struct Pinhole<'a> {
    picture: &'a Picture,
    built: &'a [SceneLayer],
    /// The layer that each pixel sees.
    seen: Vec<Option<u16>>,
    s: Vec<f32>,
    /// The shift of empty space.
    nowhere: f32,
    connectivity: Vec<u8>,
}

impl Pinhole<'_> {
    /// `None` if nothing that the pinhole sees hides anything else.
    fn new<'a>(picture: &'a Picture, built: &'a [SceneLayer]) -> Option<Pinhole<'a>> {
        let (size, n) = (picture.size, picture.size.pixels());
        let alpha = picture.coverage();
        let nowhere = depth_spans::shift_range(built).0 as f32 - 2.0 * SAME_SURFACE_PX;
        // How much a cell counts as what is seen. What light passes through does not hide what is behind it, which goes on
        // there: fully from half of the light on.
        let hides = |layer: usize, i: usize| {
            let whole = alpha[layer][i];
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
            (0..alpha.len()).position(half_covered).map(|layer| layer as u16)
        };
        let seen: Vec<Option<u16>> = (0..n).into_par_iter().map(seen_at).collect();
        let s_of =
            |(i, seen): (usize, &Option<u16>)| seen.map_or(nowhere, |layer| built[usize::from(layer)].s[i]);
        let s: Vec<f32> = seen.par_iter().enumerate().map(s_of).collect();
        let connectivity = edges::connectivity(&s, size.width, size.height);
        let hides_some = connectivity.par_iter().any(|c| c & EDGE != 0);
        hides_some.then_some(Pinhole { picture, built, seen, s, nowhere, connectivity })
    }

    /// What is hidden behind the last surface of each pixel: what the pinhole sees around it continues there, as behind a
    /// single layer. Nothing is found where the layers already have it, nor behind what is only partly there: that is no
    /// surface which hides all.
    fn hidden<K: Cargo>(
        &self,
        lights: usize,
        cargo: K,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<Vec<Hidden<K::Load>>> {
        let Pinhole { picture, built, seen, s, nowhere, connectivity } = self;
        let (size, n) = (picture.size, picture.size.pixels());
        let alpha = picture.coverage();
        let color = Arc::new(planes_of(size, seen, |layer, i| built[layer].colors.at(i)));
        let farthest = |i: usize, least: f32| {
            let cells = (0..built.len()).filter(|&layer| alpha[layer][i] >= least);
            cells.map(|layer| built[layer].s[i]).fold(f32::INFINITY, f32::min)
        };
        let last = |i: usize| Some(farthest(i, 1.0)).filter(|s| s.is_finite()).unwrap_or(*nowhere);
        let last: Vec<f32> = (0..n).into_par_iter().map(last).collect();
        let frame = FrontLayer::new(size, lights, &color, s, connectivity);
        let limits = Limits::new(size, &Colors::new(size, Arc::clone(&color)), simd);
        let found = inpaint::hidden(&frame, &last, &[], &limits, cargo, cancel)?;
        let is_new =
            |h: &Hidden<K::Load>| h.color[size.channels - 1] > 0.0 && h.s <= last[h.index] - CONNECTED_PX;
        // Cells that are only partly there keep their place in front.
        let behind = |h: Hidden<K::Load>| Hidden { s: h.s.min(farthest(h.index, f32::MIN_POSITIVE)), ..h };
        Ok(found.into_iter().filter(is_new).map(behind).collect())
    }
}

/// What the cells of a layer carry: what pixels hold of them is of the part that they cover.
fn carried_by(groups: &[ChannelGroup], layer: usize, coverage: &[f32]) -> Vec<Colors> {
    let of_group = |group: &ChannelGroup| {
        let mut values = Buffer::clone(&group.layers[layer]);
        divide_by_coverage(&mut values, coverage);
        Colors::new(group.size, Arc::new(values))
    };
    groups.iter().map(of_group).collect()
}

/// Whether dividing by a pixel's coverage changes what the pixel has.
pub fn is_divided(coverage: f32) -> bool {
    coverage > 0.0 && coverage != 1.0
}

/// Divides the planes of a layer by its coverage; nothing is left where it covers nothing.
fn divide_by_coverage(planes: &mut [f32], coverage: &[f32]) {
    planes.par_chunks_mut(coverage.len()).for_each(|plane| {
        for (c, &a) in plane.iter_mut().zip(coverage) {
            *c = if a > 0.0 { *c / a } else { 0.0 };
        }
    });
}

/// The same groups of channels, of a picture of one layer that has the values of `layers` at each pixel: of the one with this
/// number, or none.
fn seen_channels(
    groups: &[ChannelGroup],
    layers: &[SceneLayer],
    number: &[Option<u16>],
) -> Vec<ChannelGroup> {
    let of_group = |(g, group): (usize, &ChannelGroup)| {
        let planes = planes_of(group.size, number, |layer, i| layers[layer].carried[g].at(i));
        ChannelGroup { layers: vec![Arc::new(planes)], ..*group }
    };
    groups.iter().enumerate().map(of_group).collect()
}

/// Planes of the values that pixels have in the layers of these numbers; zero where there is none.
fn planes_of(
    size: Size,
    number: &[Option<u16>],
    at: impl Fn(usize, usize) -> [f32; 4] + Sync,
) -> Buffer<f32> {
    let n = size.pixels();
    let mut planes = Buffer::unset(size.channels * n);
    for (c, plane) in planes.chunks_mut(n).enumerate() {
        plane.par_iter_mut().zip(number).enumerate().for_each(|(i, (v, number))| {
            *v = number.map_or(0.0, |layer| at(usize::from(layer), i)[c]);
        });
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::super::layered::{LayeredScene, build};
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
