//! The values of cells in the channels that a picture carries. Where the colour of a cell is not that of its pixel, what
//! the picture's colours decide is applied to every channel alike.

use super::colors::{CellColor, Colors};
use super::front_layer::FrontLayer;
use super::inpaint::Hidden;
use super::layer::SceneLayer;
use super::matting::{MixedPixel, pure_pixels, two_surfaces};
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
        groups.iter().enumerate().map(move |(g, group)| {
            let pure = ends.each_ref().map(|sources| {
                let mut sum = [0.0; 4];
                for Share { pixel, hidden, weight } in sources {
                    let values = hidden.map_or_else(|| group.at(*pixel), |layer| layer.carried[g].at(*pixel));
                    sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight * v);
                }
                sum
            });
            m.recipe.apply(m.coverage, group.weighting, group.at(m.index), pure)
        })
    };
    mixed.par_iter().flat_map_iter(of_pixel).collect()
}

/// What a pure value is made of: the value of a pixel, or of the cell of a layer that is hidden there.
#[derive(Clone, Copy)]
pub struct Share<'a> {
    pub pixel: usize,
    pub hidden: Option<&'a SceneLayer>,
    pub weight: f32,
}

/// What the pure value of each surface of a mixed pixel is the mean of.
pub fn pure_ends<'a>(frame: &FrontLayer<'a>, m: &MixedPixel) -> [Vec<Share<'a>>; 2] {
    let (x, y) = (m.index % frame.size.width, m.index / frame.size.width);
    let [front, back] = two_surfaces(frame, x, y);
    [(m.recipe.front, front), (m.recipe.back, back)].map(|(source, surface)| {
        let mut shares = Vec::new();
        match (surface.known, source) {
            (Some(known), _) => {
                shares.push(Share { pixel: m.index, hidden: Some(known.layer), weight: 1.0 });
            }
            (None, PureSource::Around) => pure_pixels(frame, (x, y), surface.s, |pixel, hidden, weight| {
                shares.push(Share { pixel, hidden, weight });
            }),
            (None, PureSource::Pixel(q)) => {
                shares.push(Share { pixel: q as usize, hidden: None, weight: 1.0 });
            }
        }
        let all: f32 = shares.iter().map(|share| share.weight).sum();
        shares.iter_mut().for_each(|share| share.weight /= all);
        shares
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

/// The values, in each group of the carried channels, of the surfaces behind mixed pixels and of the hidden ones.
pub fn behind(
    groups: &[ChannelGroup],
    mixed: &[MixedPixel],
    carried: &[[[f32; 4]; 2]],
    hidden: &[Hidden],
) -> Vec<Colors> {
    let of_group = |(g, group): (usize, &ChannelGroup)| {
        let values = mixed.iter().zip(carried.iter().skip(g).step_by(groups.len()));
        let both = values.filter(|(m, _)| m.coverage > 0.0);
        let both = both.map(|(m, [_, back])| CellColor { index: m.index, color: *back });
        let hidden = hidden.iter().map(|h| CellColor { index: h.index, color: h.carried[g] });
        Colors::of_cells(group.size, both.chain(hidden).collect())
    };
    groups.iter().enumerate().map(of_group).collect()
}
