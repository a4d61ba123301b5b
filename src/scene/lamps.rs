//! Lamps at the edges of given layers.

use super::carried;
use super::colors::CellColor;
use super::exits::SAME_SURFACE_PX;
use super::front_layer::FrontLayer;
use super::inpaint::Hidden;
use super::layer::SceneLayer;
use super::matting::{MixedPixel, Separated, unmix};
use super::mixed_cells::{half_planes, split};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::ChannelGroup;
use std::sync::Arc;

/// Takes the pixels of a first layer apart that mix a lamp and another surface: what one pixel has too much of a surface its
/// neighbour has too little of, but a lamp would be seen at the other one's depth. What of the surfaces behind is in none of
/// the other layers is put there in the order of depth. Returns the cells for which there was no room.
pub fn take_lamps_apart(
    frame: &FrontLayer,
    groups: &[ChannelGroup],
    front: &mut SceneLayer,
    others: &mut [SceneLayer],
    cancel: &Cancel,
) -> Result<Vec<Hidden>> {
    let frame = &FrontLayer { behind: others, ..*frame };
    let mixed = lamps(frame, cancel)?;
    let carried = carried::of_mixed(frame, &mixed, groups);
    let mut s = Buffer::clone(&front.s);
    front.partial = Arc::new(half_planes(frame, &mixed));
    let (colors, _) = split(&mixed, &mut s);
    (front.s, front.colors) = (Arc::new(s), front.colors.with(colors));
    front.carried = carried::in_front(std::mem::take(&mut front.carried), &mixed, &carried);
    let of_pixel = |i: usize| carried[i * groups.len()..][..groups.len()].iter().map(|[_, back]| *back);
    let behind = mixed.iter().enumerate().filter(|(_, m)| m.coverage > 0.0).map(|(i, m)| Behind {
        index: m.index,
        s: m.s_back,
        covered: m.coverage,
        values: Values { color: m.back, carried: of_pixel(i).collect() },
    });
    let behind: Vec<Behind> = behind.collect();
    Ok(sorted_in(others, behind))
}

/// The pixels of a first layer that mix a lamp and another surface.
pub fn lamps(frame: &FrontLayer, cancel: &Cancel) -> Result<Vec<MixedPixel>> {
    unmix(frame, Separated::lamps(frame), cancel)
}

/// The colour of a cell, and its values in each group of carried channels.
struct Values {
    color: [f32; 4],
    carried: Vec<[f32; 4]>,
}

impl Values {
    /// Those of the cell of a layer.
    fn of(layer: &SceneLayer, index: usize) -> Values {
        let carried = layer.carried.iter().map(|values| values.at(index)).collect();
        Values { color: layer.colors.at(index), carried }
    }

    /// A mean of two cells, of which the other one counts for `share`.
    fn mixed(&self, other: &Values, share: f32) -> Values {
        let mean = |own: [f32; 4], other: [f32; 4]| {
            std::array::from_fn(|c| (1.0 - share) * own[c] + share * other[c])
        };
        let carried = self.carried.iter().zip(&other.carried).map(|(own, other)| mean(*own, *other));
        Values { color: mean(self.color, other.color), carried: carried.collect() }
    }
}

/// The surface behind a mixed pixel.
struct Behind {
    index: usize,
    s: f32,
    /// How much of it the surface in front covers.
    covered: f32,
    values: Values,
}

/// Puts the surfaces behind mixed pixels into layers, in the order of depth, where those do not have them. Returns the cells
/// for which there was no room: of each pixel the last one.
fn sorted_in(layers: &mut [SceneLayer], behind: Vec<Behind>) -> Vec<Hidden> {
    let mut left = Vec::new();
    let mut changes: Vec<Vec<(usize, Values)>> = layers.iter().map(|_| Vec::new()).collect();
    let mut shifts: Vec<Buffer<f32>> = layers.iter().map(|layer| Buffer::clone(&layer.s)).collect();
    for Behind { index, s, covered, values } in behind {
        let is_there = |layer: &SceneLayer| (layer.s[index] - s).abs() < SAME_SURFACE_PX;
        if let Some(layer) = layers.iter().position(is_there) {
            // The pinhole sees a part of this cell, and so light that no sample at the pixel's centre may have met.
            if !layers[layer].covers_partly(index) {
                let hidden = Values::of(&layers[layer], index);
                changes[layer].push((index, values.mixed(&hidden, covered)));
            }
            continue;
        }
        let nearer = layers.iter().rposition(|layer| layer.s[index] > s);
        let first = nearer.map_or(0, |layer| layer + 1);
        let mut cell = Some((s, values));
        // Cells that cover their pixel in part keep their place.
        if !layers[first..].iter().any(|layer| layer.covers_partly(index)) {
            for layer in first..layers.len() {
                let Some((s, values)) = cell else { break };
                let old = layers[layer].s[index];
                cell = (!old.is_nan()).then(|| (old, Values::of(&layers[layer], index)));
                shifts[layer][index] = s;
                changes[layer].push((index, values));
            }
        }
        left.extend(cell.map(|(s, Values { color, carried })| Hidden { index, s, color, carried }));
    }
    for ((layer, shifts), changes) in layers.iter_mut().zip(shifts).zip(changes) {
        let listed = |of: &dyn Fn(&Values) -> [f32; 4]| {
            changes.iter().map(|(index, values)| CellColor { index: *index, color: of(values) }).collect()
        };
        layer.s = Arc::new(shifts);
        layer.colors = layer.colors.with(listed(&|values| values.color));
        for (g, colors) in layer.carried.iter_mut().enumerate() {
            *colors = colors.with(listed(&|values| values.carried[g]));
        }
    }
    left
}
