//! Highlights: the light by which cells outshine their surroundings, whatever is in focus.

use super::colors::{CellColor, Colors};
use super::grid::BLOCK;
use super::layer::SceneLayer;
use crate::picture::Size;
use crate::rows::greater;
use crate::simd::Simd;
use rayon::prelude::*;

/// A cell is a highlight by what it has above this many times its surroundings. At this limit, one lens sample of 512
/// that appears or disappears changes a pixel of the disc by one hundredth of the surroundings.
pub const HIGHLIGHT_RATIO: f32 = 5.0;
/// Number of blocks on each side whose mean is taken for the surroundings.
const AROUND: usize = 2;

/// Number of channels that hold light: the last of two or four is coverage, which has no brightness.
pub fn light_channels(size: Size) -> usize {
    if size.channels == 2 { 1 } else { size.channels.min(3) }
}

/// How bright a colour is: its brightest channel, which is the same for a grey in one channel and in three.
fn brightness(color: &[f32; 4], lights: usize) -> f32 {
    color[..lights].iter().fold(0.0, |most, &v| greater(most, v))
}

/// The part of a colour's light that is above a limit of brightness: 0 up to the limit, and continuous from there on.
fn part_above(color: &[f32; 4], lights: usize, limit: f32) -> f32 {
    let bright = brightness(color, lights);
    if bright > limit { 1.0 - limit / bright } else { 0.0 }
}

/// The light of some cells.
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
    /// The brightest cell.
    brightest: Vec<f32>,
    /// The brightness above which a cell is a highlight.
    limit: Vec<f32>,
}

impl BlockLight {
    /// The surroundings of a layer's cells. A first pass averages all cells, a second pass what is not above the limit
    /// of the first.
    fn new(size: Size, colors: &Colors, simd: Simd) -> BlockLight {
        let (across, down) = (size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
        let lights = light_channels(size);
        let block_row = |scratch: &mut Vec<f32>, by: usize| {
            let mut blocks = vec![(Light::default(), f32::NEG_INFINITY); across];
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
            if all.brightest[b] <= all.limit[b] {
                return all.light[b];
            }
            let mut light = Light::default();
            for color in all.cells(b).map(|i| colors.at(i)) {
                let kept = 1.0 - part_above(&color, lights, all.limit[b]);
                light.add(&Light { sum: color.map(|v| kept * v), cells: 1.0 });
            }
            light
        };
        all.light = (0..across * down).into_par_iter().map(dim).collect();
        all.limit = all.limits();
        all
    }

    /// The mean colour of the blocks around a block, including the block itself.
    fn around(&self, b: usize) -> [f32; 4] {
        let (bx, by) = (b % self.across, b / self.across);
        let columns = bx.saturating_sub(AROUND)..(bx + AROUND + 1).min(self.across);
        let mut light = Light::default();
        for y in by.saturating_sub(AROUND)..(by + AROUND + 1).min(self.down) {
            columns.clone().for_each(|x| light.add(&self.light[y * self.across + x]));
        }
        light.mean()
    }

    /// The brightness limits that follow from the light of the blocks.
    fn limits(&self) -> Vec<f32> {
        let around = |b: usize| brightness(&self.around(b), light_channels(self.size));
        let limit = |b: usize| HIGHLIGHT_RATIO * around(b);
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
fn add_row(row: &[f32], width: usize, lights: usize, blocks: &mut [(Light, f32)]) {
    for (bx, (light, brightest)) in blocks.iter_mut().enumerate() {
        let columns = bx * BLOCK..(bx * BLOCK + BLOCK).min(width);
        light.cells += columns.len() as f32;
        let mut bright = [0.0f32; BLOCK];
        for c in 0..lights {
            let mut sum = 0.0;
            for (bright, v) in bright.iter_mut().zip(&row[c * width..][columns.clone()]) {
                *bright = greater(*bright, *v);
                sum += v;
            }
            light.sum[c] += sum;
        }
        *brightest = bright[..columns.len()].iter().fold(*brightest, |m, &v| if v > m { v } else { m });
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
}

/// Finds the highlights of each layer.
pub fn find(size: Size, layers: &[SceneLayer], simd: Simd) -> Vec<Vec<Bright>> {
    let lights = light_channels(size);
    let front = BlockLight::new(size, &layers[0].colors, simd);
    let of_layer = |(i, layer): (usize, &SceneLayer)| {
        // A layer given by the user has surroundings of its own: the layer in front may be dark, or almost absent.
        let own = (i > 0 && !layer.colors.is_list()).then(|| BlockLight::new(size, &layer.colors, simd));
        let brighter = |b: usize| match &own {
            Some(own) if own.limit[b] > front.limit[b] => own,
            _ => &front,
        };
        let above = |index: usize, color: &[f32; 4]| {
            let b = front.block_of(index);
            part_above(color, lights, brighter(b).limit[b])
        };
        let stands_out = |&index: &usize| above(index, &layer.colors.at(index)) > 0.0;
        let found: Vec<usize> = if layer.colors.is_list() {
            let cells = layer.colors.listed(0..size.pixels()).par_iter().map(|cell| cell.index);
            cells.filter(stands_out).collect()
        } else {
            let brightest = &own.as_ref().unwrap_or(&front).brightest;
            let blocks =
                (0..brightest.len()).into_par_iter().filter(|&b| brightest[b] > brighter(b).limit[b]);
            blocks.flat_map_iter(|b| front.cells(b)).filter(stands_out).collect()
        };
        let bright = |index: usize| {
            let color = layer.colors.at(index);
            let above = above(index, &color);
            let excess: [f32; 4] = std::array::from_fn(|c| if c < lights { above * color[c] } else { 0.0 });
            let area = match layer.partial.binary_search_by_key(&index, |p| p.0) {
                Ok(i) => layer.partial[i].1.area,
                Err(_) => 1.0,
            };
            Bright { index, dim: std::array::from_fn(|c| color[c] - excess[c]), excess, area }
        };
        found.into_iter().map(bright).collect()
    };
    layers.iter().enumerate().map(of_layer).collect()
}
