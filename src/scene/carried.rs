//! The values of cells in the channels that a picture carries. Where the colour of a cell is not that of its pixel, what
//! the picture's colours decide is applied to every channel alike.

use super::colors::{CellColor, Colors};
use super::front_layer::FrontLayer;
use super::inpaint::Hidden;
use super::matting::{MixedPixel, pure_pixels, surfaces};
use super::recipe::PureSource;
use crate::picture::ChannelGroup;
use rayon::prelude::*;

/// The values of both surfaces of every mixed pixel in each of some groups of carried channels: group after group for one
/// pixel, then the next pixel. `frame` has the shifts of which the pixels were separated.
pub fn of_mixed(frame: &FrontLayer, mixed: &[MixedPixel], groups: &[ChannelGroup]) -> Vec<[[f32; 4]; 2]> {
    if groups.is_empty() {
        return Vec::new();
    }
    let of_pixel = |&m: &MixedPixel| {
        let ends = pure_ends(frame, &m);
        groups.iter().map(move |group| {
            let pure = ends.each_ref().map(|pixels| {
                let mut sum = [0.0; 4];
                for &(q, weight) in pixels {
                    sum.iter_mut().zip(group.at(q)).for_each(|(sum, v)| *sum += weight * v);
                }
                sum
            });
            m.recipe.apply(m.coverage, group.weighting, group.at(m.index), pure)
        })
    };
    mixed.par_iter().flat_map_iter(of_pixel).collect()
}

/// The pixels, with their weights, whose mean is the pure value of each surface of a mixed pixel.
pub fn pure_ends(frame: &FrontLayer, m: &MixedPixel) -> [Vec<(usize, f32)>; 2] {
    let (x, y) = (m.index % frame.size.width, m.index / frame.size.width);
    let (s_front, s_back) = surfaces(frame, x, y);
    [(m.recipe.front, s_front), (m.recipe.back, s_back)].map(|(source, s)| {
        let mut pixels = Vec::new();
        match source {
            PureSource::Around => pure_pixels(frame, (x, y), s, |q, _, weight| pixels.push((q, weight))),
            PureSource::Pixel(q) => pixels.push((q as usize, 1.0)),
        }
        let all: f32 = pixels.iter().map(|(_, weight)| weight).sum();
        pixels.iter_mut().for_each(|(_, weight)| *weight /= all);
        pixels
    })
}

/// The values of the cells in front in each group of channels, which were `given` for each pixel.
pub fn in_front(given: Vec<Colors>, mixed: &[MixedPixel], carried: &[[[f32; 4]; 2]]) -> Vec<Colors> {
    let groups = given.len();
    let of_group = |(g, given): (usize, Colors)| {
        let cells = mixed.iter().zip(carried.iter().skip(g).step_by(groups));
        let color = |(m, [front, back]): (&MixedPixel, &[[f32; 4]; 2])| CellColor {
            index: m.index,
            color: if m.coverage > 0.0 { *front } else { *back },
        };
        given.with(cells.map(color).collect())
    };
    given.into_iter().enumerate().map(of_group).collect()
}

/// The values, in group number `g` of the carried channels, of the surfaces behind mixed pixels and of the hidden ones.
pub fn behind(
    group: &ChannelGroup,
    g: usize,
    mixed: &[MixedPixel],
    carried: &[[[f32; 4]; 2]],
    hidden: &[Hidden],
) -> Colors {
    let groups = carried.len() / mixed.len();
    let both = mixed.iter().zip(carried.iter().skip(g).step_by(groups)).filter(|(m, _)| m.coverage > 0.0);
    let both = both.map(|(m, [_, back])| CellColor { index: m.index, color: *back });
    let hidden = hidden.iter().map(|h| CellColor { index: h.index, color: h.carried[g] });
    Colors::of_cells(group.size, both.chain(hidden).collect())
}
