//! Highlights: the light by which cells outshine their surroundings, whatever is in focus.

use super::colors::{CellColor, Colors};
use super::grid::BLOCK;
use super::layer::SceneLayer;
use crate::mirror::mirrored;
use crate::picture::Size;
use crate::rows::greater;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// A cell is a highlight by what it has above this many times its surroundings. At this limit, one lens sample of 512
/// that appears or disappears changes a pixel of the disc by one hundredth of the surroundings.
pub const HIGHLIGHT_RATIO: f32 = 5.0;
/// Where so large a part of all cells is highlights, they are texture rather than lamps, and a cell has to outshine its
/// surroundings twice as much; where there are more, as much more as the square of their part. Of many bright cells each
/// is less of the light that is there, and only as many discs are drawn as a picture has room for.
const MANY: f32 = 1.0 / 64.0;
/// Number of blocks on each side whose mean is taken for the surroundings.
const AROUND: usize = 2;

/// Number of channels that hold light: the last of two or four is coverage, which has no brightness.
pub fn light_channels(size: Size) -> usize {
    if size.channels == 2 { 1 } else { size.channels.min(3) }
}

/// The light of a colour that is above a limit, channel by channel: none up to the limit, and continuous from there on.
fn above(color: &[f32; 4], limit: &[f32; 4], lights: usize) -> [f32; 4] {
    std::array::from_fn(|c| if c < lights { (color[c] - limit[c]).max(0.0) } else { 0.0 })
}

/// The light of some cells. Negative values, as filters leave them, count as much as positive ones.
#[derive(Clone, Copy, Default)]
struct Light {
    sum: [f32; 4],
    cells: f32,
}

impl Light {
    fn add(&mut self, other: &Light) {
        self.sum.iter_mut().zip(other.sum).for_each(|(sum, v)| *sum += v);
        self.cells += other.cells;
    }

    fn mean(&self) -> [f32; 4] {
        self.sum.map(|sum| sum / self.cells.max(1.0))
    }
}

/// The light of every block of the frame, for finding the highlights.
struct BlockLight {
    size: Size,
    across: usize,
    down: usize,
    /// Light of the cells, without what is above the limit.
    light: Vec<Light>,
    /// The greatest value of each channel.
    brightest: Vec<[f32; 4]>,
    /// The value of each channel above which a cell is a highlight. Channels do not know of one another.
    limit: Vec<[f32; 4]>,
}

impl BlockLight {
    /// The surroundings of a layer's cells. A first pass averages all cells, a second pass what is not above the limit
    /// of the first.
    fn new(size: Size, colors: &Colors, simd: Simd) -> BlockLight {
        let (across, down) = (size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
        let lights = light_channels(size);
        let block_row = |scratch: &mut Vec<f32>, by: usize| {
            let mut blocks = vec![(Light::default(), [0.0; 4]); across];
            scratch.resize(size.width * size.channels, 0.0);
            for y in by * BLOCK..(by * BLOCK + BLOCK).min(size.height) {
                colors.copy_row(y, 0..size.width, size.width, scratch);
                simd.run(
                    #[inline(always)]
                    || add_row(scratch, size.width, lights, &mut blocks),
                );
            }
            blocks
        };
        let rows: Vec<_> = (0..down).into_par_iter().map_init(Vec::new, block_row).collect();
        let (light, brightest) = rows.into_iter().flatten().unzip();
        let mut all = BlockLight { size, across, down, light, brightest, limit: Vec::new() };
        all.limit = all.limits();
        let dim = |b: usize| {
            if above(&all.brightest[b], &all.limit[b], lights) == [0.0; 4] {
                return all.light[b];
            }
            let mut light = Light::default();
            for color in all.cells(b).map(|i| colors.at(i)) {
                let kept = std::array::from_fn(|c| color[c].min(all.limit[b][c]).abs());
                light.add(&Light { sum: kept, cells: 1.0 });
            }
            light
        };
        all.light = (0..across * down).into_par_iter().map(dim).collect();
        all.limit = all.limits();
        all
    }

    /// The blocks around a block, including the block itself.
    fn blocks_around(&self, b: usize) -> impl Iterator<Item = usize> + use<> {
        let (bx, by, across) = (b % self.across, b / self.across, self.across);
        let columns = bx.saturating_sub(AROUND)..(bx + AROUND + 1).min(across);
        let rows = by.saturating_sub(AROUND)..(by + AROUND + 1).min(self.down);
        rows.flat_map(move |y| columns.clone().map(move |x| y * across + x))
    }

    /// The mean colour of the blocks around a block.
    fn around(&self, b: usize) -> [f32; 4] {
        let mut light = Light::default();
        self.blocks_around(b).for_each(|b| light.add(&self.light[b]));
        light.mean()
    }

    /// For each block, how much more than elsewhere a cell has to outshine its surroundings because there are many that do:
    /// those at the given indices, as far as each does.
    fn crowding(&self, bright: impl Iterator<Item = (usize, f32)>) -> Vec<f32> {
        let mut count = vec![0.0f32; self.light.len()];
        bright.for_each(|(index, share)| count[self.block_of(index)] += share);
        let crowding = |b: usize| {
            let (count, cells) = self
                .blocks_around(b)
                .fold((0.0, 0.0), |(count_of, cells), b| (count_of + count[b], cells + self.light[b].cells));
            1.0 + (count / (MANY * cells)).powi(2)
        };
        (0..self.light.len()).map(crowding).collect()
    }

    /// The limits that follow from the light of the blocks.
    fn limits(&self) -> Vec<[f32; 4]> {
        let limit = |b: usize| self.around(b).map(|around| HIGHLIGHT_RATIO * around);
        (0..self.light.len()).into_par_iter().map(limit).collect()
    }

    /// The block of a cell.
    fn block_of(&self, index: usize) -> usize {
        index / self.size.width / BLOCK * self.across + index % self.size.width / BLOCK
    }

    /// The cells of a block.
    fn cells(&self, b: usize) -> impl Iterator<Item = usize> + use<> {
        let (x0, y0, width) = (b % self.across * BLOCK, b / self.across * BLOCK, self.size.width);
        let x1 = (x0 + BLOCK).min(width);
        (y0..(y0 + BLOCK).min(self.size.height)).flat_map(move |y| y * width + x0..y * width + x1)
    }
}

/// Adds a row of the frame, one channel after another, to the blocks that it crosses.
#[inline(always)]
fn add_row(row: &[f32], width: usize, lights: usize, blocks: &mut [(Light, [f32; 4])]) {
    for (bx, (light, brightest)) in blocks.iter_mut().enumerate() {
        let columns = bx * BLOCK..(bx * BLOCK + BLOCK).min(width);
        light.cells += columns.len() as f32;
        for c in 0..lights {
            let (mut sum, mut most) = (0.0, brightest[c]);
            for v in &row[c * width..][columns.clone()] {
                sum += v.abs();
                most = greater(most, *v);
            }
            light.sum[c] += sum;
            brightest[c] = most;
        }
    }
}

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
        let excess: f32 = self.excess[..lights].iter().sum();
        let light: f32 = (0..lights).map(|c| (self.dim[c] + self.excess[c]).max(0.0)).sum();
        (excess / light.max(f32::MIN_POSITIVE)).min(1.0)
    }
}

/// The highlights of a scene.
pub struct Found {
    /// Those of each layer.
    pub bright: Vec<Vec<Bright>>,
    /// For each block of the frame, how many times as bright as the limit the brightest cell is without what is taken out
    /// of it; 1 where all is.
    pub left: Vec<f32>,
}

impl Found {
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
        let greatest = |columns: &RangeInclusive<usize>, rows: &RangeInclusive<usize>| {
            let rows = rows.clone().map(|y| &self.left[y * across..][columns.clone()]);
            rows.flatten().fold(1.0f32, |most, left| most.max(*left))
        };
        let left = rows.iter().flat_map(|rows| columns.iter().map(move |columns| greatest(columns, rows)));
        Found { bright: self.bright.iter().map(|_| Vec::new()).collect(), left: left.collect() }
    }
}

/// Finds the highlights of each layer; `front` is the number of the picture's first.
pub fn find(size: Size, layers: &[SceneLayer], front: usize, simd: Simd) -> Found {
    let lights = light_channels(size);
    let (first, front) = (front, BlockLight::new(size, &layers[front].colors, simd));
    let of_layer = |(i, layer): (usize, &SceneLayer)| {
        // A layer given by the user has surroundings of its own: the layer in front may be dark, or almost absent.
        let own = (i > first && !layer.colors.is_list()).then(|| BlockLight::new(size, &layer.colors, simd));
        let limit = |b: usize| match &own {
            Some(own) => std::array::from_fn(|c| greater(own.limit[b][c], front.limit[b][c])),
            None => front.limit[b],
        };
        let stands_out =
            |index: usize, color: &[f32; 4]| above(color, &limit(front.block_of(index)), lights) != [0.0; 4];
        let found: Vec<usize> = if layer.colors.is_list() {
            let cells = layer.colors.listed(0..size.pixels()).par_iter();
            cells.filter(|cell| stands_out(cell.index, &cell.color)).map(|cell| cell.index).collect()
        } else {
            let brightest = &own.as_ref().unwrap_or(&front).brightest;
            let blocks = (0..brightest.len()).into_par_iter();
            let blocks = blocks.filter(|&b| above(&brightest[b], &limit(b), lights) != [0.0; 4]);
            blocks
                .flat_map_iter(|b| front.cells(b))
                .filter(|&index| stands_out(index, &layer.colors.at(index)))
                .collect()
        };
        // How many times as bright as the limit each is.
        let times = |index: usize| {
            let (color, limit) = (layer.colors.at(index), limit(front.block_of(index)));
            (0..lights).map(|c| color[c] / limit[c].max(f32::MIN_POSITIVE)).fold(1.0, f32::max)
        };
        let found: Vec<(usize, f32)> = found.into_iter().map(|index| (index, times(index))).collect();
        // From nothing at the limit to all from twice as much on.
        let crowding = front.crowding(found.iter().map(|&(index, times)| (index, (times - 1.0).min(1.0))));
        let mut left = vec![1.0f32; crowding.len()];
        for &(index, times) in &found {
            let b = front.block_of(index);
            left[b] = left[b].max(times.min(crowding[b]));
        }
        let excess = |index: usize| {
            let b = front.block_of(index);
            above(&layer.colors.at(index), &limit(b).map(|limit| crowding[b] * limit), lights)
        };
        let found = found.into_iter().map(|(index, _)| (index, excess(index)));
        let found = found.filter(|(_, excess)| *excess != [0.0; 4]);
        let bright = |(index, excess): (usize, [f32; 4])| {
            let color = layer.colors.at(index);
            let area = layer.half_plane_at(index).map_or(1.0, |plane| plane.coverage());
            Bright { index, dim: std::array::from_fn(|c| color[c] - excess[c]), excess, area }
        };
        (found.map(bright).collect(), left)
    };
    let (bright, left): (Vec<_>, Vec<_>) = layers.iter().enumerate().map(of_layer).unzip();
    let most = |b: usize| left.iter().fold(1.0f32, |most, left| most.max(left[b]));
    Found { bright, left: (0..front.light.len()).map(most).collect() }
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
    fn found(hidden: impl Fn(usize, usize) -> Option<f32>) -> (Vec<Bright>, Vec<f32>) {
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
        assert!((left[across + 3] - 6.0).abs() < 1e-3 && left[across + 1] == 1.0, "{left:?}");
        // A lamp among it is one, and keeps nearly all of its light.
        let (lamps, _) =
            found(|x, y| if (60..63).contains(&x) && (40..43).contains(&y) { Some(2e3) } else { band(x) });
        assert_eq!(lamps.len(), 9);
        assert!(lamps.iter().all(|lamp| lamp.excess[0] > 0.95 * 2e3));
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
