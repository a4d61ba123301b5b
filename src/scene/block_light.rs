//! The light of the blocks of a frame, and how bright a cell has to be there to be a highlight.

use super::colors::Colors;
use super::contrast::{Light, light_channels};
use super::crowding::Crowd;
use super::grid::BLOCK;
use crate::picture::Size;
use crate::rows::greater;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Number of blocks on each side whose mean is taken for the surroundings.
const AROUND: usize = 2;
/// Number of blocks on each side whose bright cells are counted together, 400 pixels in all: a lamp of a hundred pixels is few of
/// these, and a bright wall many.
const COUNTED: usize = 12;

/// The range of `around` on each side of `i`, of `n`.
fn near(i: usize, around: usize, n: usize) -> Range<usize> {
    i.saturating_sub(around)..(i + around + 1).min(n)
}

/// The light of a colour that is above a limit, channel by channel: none up to the limit, and continuous from there on.
pub fn above(color: &[f32; 4], limit: &[f32; 4], lights: usize) -> [f32; 4] {
    std::array::from_fn(|c| if c < lights { (color[c] - limit[c]).max(0.0) } else { 0.0 })
}

/// The light of every block of the frame, for finding the highlights.
pub struct BlockLight {
    pub size: Size,
    across: usize,
    down: usize,
    /// Light of the cells, without what is above the limit.
    pub light: Vec<Light>,
    /// The greatest value of each channel.
    brightest: Vec<[f32; 4]>,
    /// The number of channels that hold light.
    pub lights: usize,
    /// The value of each channel above which a cell is a highlight. Channels do not know of one another.
    pub limit: Vec<[f32; 4]>,
}

impl BlockLight {
    /// The surroundings of a layer's cells. A first pass averages all cells, a second pass what is not above the limit
    /// of the first.
    pub fn new(size: Size, colors: &Colors, simd: Simd) -> BlockLight {
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
        let mut all = BlockLight { size, across, down, light, brightest, lights, limit: Vec::new() };
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
        let columns = near(bx, AROUND, across);
        let rows = near(by, AROUND, self.down);
        rows.flat_map(move |y| columns.clone().map(move |x| y * across + x))
    }

    /// The cells with these colours that are above the limit which is given for each block; the light of the colours is this
    /// one.
    pub fn above(&self, colors: &Colors, limit: impl Fn(usize) -> [f32; 4] + Sync) -> Vec<usize> {
        let is_above = |color: &[f32; 4], b: usize| above(color, &limit(b), self.lights) != [0.0; 4];
        let blocks = (0..self.light.len()).into_par_iter().filter(|&b| is_above(&self.brightest[b], b));
        blocks.flat_map_iter(|b| self.cells(b).filter(move |&i| is_above(&colors.at(i), b))).collect()
    }

    /// The limit of each block, raised where many of these cells are above it.
    pub fn raised(
        &self,
        colors: &Colors,
        bright: &[usize],
        limit: impl Fn(usize) -> [f32; 4] + Sync,
    ) -> Vec<[f32; 4]> {
        let mut crowds: Vec<Crowd> = self.light.iter().map(|light| Crowd::dark(light.cells)).collect();
        for &index in bright {
            let (b, color) = (self.block_of(index), colors.at(index));
            let limit = limit(b);
            let times = (0..self.lights).map(|c| color[c] / limit[c].max(f32::MIN_POSITIVE));
            crowds[b].count(times.fold(1.0, f32::max));
        }
        let (across, down) = (self.across, self.down);
        let in_row = |b: usize| {
            Crowd::united(near(b % across, COUNTED, across).map(|x| &crowds[b / across * across + x]))
        };
        let all = if bright.is_empty() { 0 } else { crowds.len() };
        let in_rows: Vec<Crowd> = (0..all).into_par_iter().map(in_row).collect();
        let of_block = |b: usize| {
            if crowds[b].is_dark() {
                return limit(b);
            }
            let rows = near(b / across, COUNTED, down);
            let raises = Crowd::united(rows.map(|y| &in_rows[y * across + b % across])).raises();
            limit(b).map(|limit| raises * limit)
        };
        (0..crowds.len()).into_par_iter().map(of_block).collect()
    }

    /// The limits that follow from the light of the blocks.
    fn limits(&self) -> Vec<[f32; 4]> {
        let limit = |b: usize| {
            let mut around = Light::default();
            self.blocks_around(b).for_each(|b| around.add(&self.light[b]));
            around.limit()
        };
        (0..self.light.len()).into_par_iter().map(limit).collect()
    }

    /// The block of a cell.
    pub fn block_of(&self, index: usize) -> usize {
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
