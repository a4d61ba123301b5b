//! Highlights: the light by which cells outshine their surroundings, whatever is in focus.

use super::block_light::{BlockLight, above};
use super::colors::{CellColor, Colors, picked};
use super::contrast::{Contrast, HIGHLIGHT_RATIO, light_channels};
use super::grid::BLOCK;
use super::layer::SceneLayer;
use crate::mirror::mirrored;
use crate::picture::Size;
use crate::rows::{greater, mix};
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::{Range, RangeInclusive};

/// A highlight, whatever is in focus.
#[derive(Clone, Copy)]
pub struct Bright {
    pub index: usize,
    /// Its colour without the light by which it outshines its surroundings.
    pub dim: [f32; 4],
    /// That light.
    pub excess: [f32; 4],
    /// The part of the pixel that the cell covers.
    pub area: f32,
}

impl Bright {
    /// The cell with this part of the light.
    pub fn with(&self, part: f32) -> CellColor {
        CellColor { index: self.index, color: std::array::from_fn(|c| self.dim[c] + part * self.excess[c]) }
    }

    /// The part of its light that outshines the surroundings, over all of the `lights` first channels.
    pub fn outshining(&self, lights: usize) -> f32 {
        let color = std::array::from_fn(|c| self.dim[c] + self.excess[c]);
        outshining(&color, &self.excess, lights)
    }
}

/// The highlights of a scene.
pub struct Found {
    /// Those of each layer.
    pub bright: Vec<Vec<Bright>>,
    /// The contrast of what they leave, for each block of the frame.
    pub left: Vec<Contrast>,
}

impl Found {
    /// Those in some rows of a frame of this size, which begin with a block and end with one or with the frame.
    pub fn rows(&self, rows: Range<usize>, size: Size) -> Found {
        let across = size.width.div_ceil(BLOCK);
        let first = rows.start * size.width;
        let pixels = first..rows.end * size.width;
        let in_rows = |bright: &Vec<Bright>| {
            let bright = bright.iter().filter(|bright| pixels.contains(&bright.index));
            bright.map(|bright| Bright { index: bright.index - first, ..*bright }).collect()
        };
        let blocks = rows.start / BLOCK * across..rows.end.div_ceil(BLOCK) * across;
        Found { bright: self.bright.iter().map(in_rows).collect(), left: self.left[blocks].to_vec() }
    }

    /// Those in these channels alone.
    pub fn of_channels(&self, channels: &[usize]) -> Found {
        let of_layer = |bright: &Vec<Bright>| {
            let bright = bright.iter().filter(|bright| channels.iter().any(|&c| bright.excess[c] != 0.0));
            let own = bright.map(|b| {
                let picked = |color| picked(color, channels, 0.0);
                Bright { dim: picked(b.dim), excess: picked(b.excess), ..*b }
            });
            own.collect()
        };
        let left = self.left.iter().map(|left| left.of_channels(channels)).collect();
        Found { bright: self.bright.iter().map(of_layer).collect(), left }
    }

    /// What is left in a scene of half the size from which the bright cells have been taken out; `size` is that of this
    /// one, whose mirror image the other may show as well.
    pub fn coarser(&self, size: Size, coarse: Size) -> Found {
        let across = size.width.div_ceil(BLOCK);
        // The blocks that each block of the coarser scene shows.
        let shown = |n: usize, coarse: usize| -> Vec<RangeInclusive<usize>> {
            let block = |b: usize| {
                let own = (2 * b * BLOCK..2 * (b + 1) * BLOCK).map(|i| mirrored(i as i64, n).0 / BLOCK);
                let (first, last) = own.fold((usize::MAX, 0), |(lo, hi), b| (lo.min(b), hi.max(b)));
                first..=last
            };
            (0..coarse.div_ceil(BLOCK)).map(block).collect()
        };
        let [columns, rows] = [shown(size.width, coarse.width), shown(size.height, coarse.height)];
        let united = |columns: &RangeInclusive<usize>, rows: &RangeInclusive<usize>| {
            let rows = rows.clone().map(|y| &self.left[y * across..][columns.clone()]);
            Contrast::united(rows.flatten())
        };
        let left = rows.iter().flat_map(|rows| columns.iter().map(move |columns| united(columns, rows)));
        Found { bright: self.bright.iter().map(|_| Vec::new()).collect(), left: left.collect() }
    }
}

/// How bright the pixels of a picture may be without highlights.
pub struct Limits {
    light: BlockLight,
    raised: Vec<[f32; 4]>,
}

impl Limits {
    /// Those of a picture with these colours.
    pub fn new(size: Size, colors: &Colors, simd: Simd) -> Limits {
        let light = BlockLight::new(size, colors, simd);
        let limit = |b: usize| light.limit[b];
        let raised = light.raised(colors, &light.above(colors, limit), limit);
        Limits { light, raised }
    }

    /// The part of the light of a pixel's colour that goes on beside it: all of it up to the limit. Twice as bright and more, it is
    /// a highlight, which ends there, and what goes on are its surroundings, from which the limit was taken.
    pub fn going_on(&self, color: &[f32; 4], index: usize) -> f32 {
        let excess = above(color, &self.raised[self.light.block_of(index)], self.light.lights);
        if excess == [0.0; 4] {
            return 1.0;
        }
        let outshining = outshining(color, &excess, self.light.lights);
        (1.0 - outshining) * mix(1.0, HIGHLIGHT_RATIO.recip(), (2.0 * outshining).min(1.0))
    }
}

/// The part of the light of a colour that this excess is, over all of the `lights` first channels.
fn outshining(color: &[f32; 4], excess: &[f32; 4], lights: usize) -> f32 {
    let excess: f32 = excess[..lights].iter().sum();
    let light: f32 = color[..lights].iter().map(|v| v.max(0.0)).sum();
    (excess / light.max(f32::MIN_POSITIVE)).min(1.0)
}

/// Finds the highlights of each layer; `front` is the number of the picture's first.
pub fn find(size: Size, layers: &[SceneLayer], front: usize, simd: Simd) -> Found {
    let lights = light_channels(size);
    let (first, front) = (front, BlockLight::new(size, &layers[front].colors, simd));
    let mut left: Vec<Contrast> = front.light.iter().copied().map(Contrast::even).collect();
    let of_layer = |(i, layer): (usize, &SceneLayer)| {
        // A layer given by the user has surroundings of its own: the layer in front may be dark, or almost absent.
        let own = (i > first && !layer.colors.is_list()).then(|| BlockLight::new(size, &layer.colors, simd));
        let limit = |b: usize| match &own {
            Some(own) => std::array::from_fn(|c| greater(own.limit[b][c], front.limit[b][c])),
            None => front.limit[b],
        };
        let found: Vec<usize> = if layer.colors.is_list() {
            let is_above = |cell: &&CellColor| {
                above(&cell.color, &limit(front.block_of(cell.index)), lights) != [0.0; 4]
            };
            let cells = layer.colors.listed(0..size.pixels()).par_iter();
            cells.filter(is_above).map(|cell| cell.index).collect()
        } else {
            own.as_ref().unwrap_or(&front).above(&layer.colors, limit)
        };
        let raised = front.raised(&layer.colors, &found, limit);
        let bright = |index: usize| {
            let color = layer.colors.at(index);
            let excess = above(&color, &raised[front.block_of(index)], lights);
            let area = layer.half_plane_at(index).map_or(1.0, |plane| plane.coverage());
            Bright { index, dim: std::array::from_fn(|c| color[c] - excess[c]), excess, area }
        };
        let bright: Vec<Bright> = found.into_iter().map(bright).collect();
        for Bright { index, dim, .. } in &bright {
            let b = front.block_of(*index);
            left[b].take_in(std::array::from_fn(|c| if c < lights { dim[c] } else { 0.0 }), limit(b));
        }
        bright.into_iter().filter(|bright| bright.excess != [0.0; 4]).collect()
    };
    Found { bright: layers.iter().enumerate().map(of_layer).collect(), left }
}

#[cfg(test)]
mod tests {
    use super::super::layer::Role;
    use super::*;
    use crate::memory::Buffer;
    use std::sync::Arc;

    const SIZE: Size = Size { width: 160, height: 96, channels: 3 };

    fn layer(colors: Colors) -> SceneLayer {
        SceneLayer {
            role: Role::Surface,
            s: Arc::new(std::iter::repeat_n(0.0, SIZE.pixels()).collect()),
            colors,
            carried: Vec::new(),
            partial: Arc::default(),
            connectivity: Arc::default(),
        }
    }

    /// A dark object, 120 pixels wide, before a grey wall, and cells that it hides.
    fn found(hidden: impl Fn(usize, usize) -> Option<f32>) -> (Vec<Bright>, Vec<Contrast>) {
        let gray = |i: usize| if i % SIZE.width < 120 { 0.01 } else { 0.3 };
        let planes: Buffer<f32> = (0..3 * SIZE.pixels()).map(|i| gray(i % SIZE.pixels())).collect();
        let cell = |index: usize| {
            let color = hidden(index % SIZE.width, index / SIZE.width)?;
            Some(CellColor { index, color: [color, color, color, 0.0] })
        };
        let cells: Vec<CellColor> = (0..SIZE.pixels()).filter_map(cell).collect();
        let layers = [layer(Colors::new(SIZE, Arc::new(planes))), layer(Colors::of_cells(SIZE, cells))];
        let Found { bright, left } = find(SIZE, &layers, 0, Simd::PORTABLE);
        let [front, hidden] = bright.try_into().unwrap_or_else(|_| panic!());
        assert!(front.is_empty());
        (hidden, left)
    }

    #[test]
    fn a_wall_that_a_dark_object_hides_is_no_lamp() {
        let band = |x: usize| (48..80).contains(&x).then_some(0.3);
        let (lamps, left) = found(|x, _| band(x));
        assert!(lamps.is_empty());
        // It is six times as bright as the limit of five times the dark object.
        let across = SIZE.width / BLOCK;
        let [beside, hiding] = [across + 1, across + 3].map(|b| left[b].times([0.05; 4]));
        assert!((hiding - 6.0).abs() < 1e-3 && beside == 1.0, "{hiding} {beside}");
        // Where half of the light that the lens mixes is the wall's, it does not even stand out.
        assert_eq!(left[across + 3].times([5.0 * 0.155; 4]), 1.0);
        // A lamp among it is one, and keeps nearly all of its light.
        let (lamps, _) =
            found(|x, y| if (60..63).contains(&x) && (40..43).contains(&y) { Some(2e3) } else { band(x) });
        assert_eq!(lamps.len(), 9);
        assert!(lamps.iter().all(|lamp| lamp.excess[0] > 0.95 * 2e3));
    }

    #[test]
    fn a_lamp_on_a_wall_that_is_hardly_too_bright_is_drawn() {
        let lamp = |x: usize, y: usize| (60..62).contains(&x) && (40..42).contains(&y);
        let (lamps, _) = found(|x, y| (48..80).contains(&x).then_some(if lamp(x, y) { 1.0 } else { 0.07 }));
        assert_eq!(lamps.len(), 4);
        assert!(lamps.iter().all(|lamp| lamp.excess[0] > 0.8), "{}", lamps[0].excess[0]);
    }

    #[test]
    fn the_light_of_lamps_changes_smoothly_with_their_number() {
        let light = |n: usize| {
            let (all, _) = found(|x, y| {
                (x < 100 && y < 80 && x % 4 == 0 && y % 4 == 0 && x / 4 + y / 4 * 25 < n).then_some(1.0)
            });
            all.iter().map(|lamp| f64::from(lamp.excess[0])).sum::<f64>()
        };
        // Few stand out whole, and many not at all; one more of them takes little of the others' light.
        let lights: Vec<f64> = (0..500).step_by(4).map(light).collect();
        assert!((lights[1] / 4.0 - 0.95).abs() < 0.01, "{}", lights[1]);
        assert!(lights.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 6.0), "{lights:?}");
    }
}
