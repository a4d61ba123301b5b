//! The sprites of a range of steps, on a device.

use crate::error::Result;
use crate::gpu::device::Gpu;
use crate::gpu::shader::shared;
use crate::plan::sprites::{self as plan, Settings, step};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Sprites per step: for even and odd columns of even rows, then of odd rows.
const OF_STEP: usize = 4;

/// Number of steps that are made together.
const MORE: i32 = 16;

shared! {
    #[derive(Default)]
    pub struct Sprite {
        left: i32,
        top: i32,
        across: u32,
        down: u32,
        first: u32,
    }
}

/// The sprites of all steps in a range.
pub struct Table {
    settings: Settings,
    steps: RangeInclusive<i32>,
    heads: Vec<Sprite>,
    pub sprites: wgpu::Buffer,
    pub weights: wgpu::Buffer,
}

impl Table {
    /// The sprites of these steps, and of some more steps that another focus may need.
    pub fn new(gpu: &Gpu, settings: &Settings, steps: &RangeInclusive<i32>) -> Result<Table> {
        let (first, last) = (steps.start().div_euclid(MORE), steps.end().div_euclid(MORE));
        let largest = step(settings.max_coc_px() as f32);
        let steps = (MORE * first).max(-largest)..=(MORE * (last + 1)).min(largest);
        // Steps below the threshold are not drawn.
        let least = step(settings.threshold_px() as f32);
        let made: Vec<Vec<plan::Sprite>> = steps
            .clone()
            .into_par_iter()
            .map(|step| if step.abs() < least { Vec::new() } else { settings.sprites(step).into() })
            .collect();
        let (mut heads, mut weights) = (Vec::with_capacity(OF_STEP * made.len()), Vec::new());
        for sprites in &made {
            heads.extend(sprites.iter().map(|sprite| {
                let first = weights.len() as u32;
                weights.extend_from_slice(&sprite.weights);
                let (across, down) = (sprite.across as u32, sprite.down() as u32);
                Sprite { left: sprite.left, top: sprite.top, across, down, first }
            }));
            if sprites.is_empty() {
                heads.extend([Sprite::default(); OF_STEP]);
            }
        }
        let sprites = gpu.upload("the sprites", &heads)?;
        let weights = gpu.upload("the weights of sprites", &weights)?;
        Ok(Table { settings: settings.clone(), steps, heads, sprites, weights })
    }

    /// Whether the table contains these steps.
    pub fn holds(&self, settings: &Settings, steps: &RangeInclusive<i32>) -> bool {
        self.settings == *settings && self.steps.contains(steps.start()) && self.steps.contains(steps.end())
    }

    /// The index of a step.
    pub fn number(&self, step: i32) -> usize {
        (step - self.steps.start()) as usize
    }

    /// Number of pixels of the picture that the largest sprite of some steps reaches; even.
    pub fn reach(&self, steps: &RangeInclusive<i32>) -> usize {
        let own = OF_STEP * self.number(*steps.start())..OF_STEP * (self.number(*steps.end()) + 1);
        let reach_of = |s: &Sprite| {
            let (right, bottom) = (s.left + s.across as i32, s.top + s.down as i32);
            2 * (1 - s.left).max(1 - s.top).max(right).max(bottom)
        };
        self.heads[own].iter().map(reach_of).max().unwrap_or(0) as usize
    }
}

/// The disparities at which one radius step ends and the next begins, for all steps of a range from near to far. For
/// each step but the nearest, its first disparity is below its boundary.
pub fn boundaries(
    [least, greatest]: [f32; 2],
    steps: &RangeInclusive<i32>,
    step_at: impl Fn(f32) -> i32 + Sync,
) -> Vec<f32> {
    let boundary = |step: i32| {
        // The least disparity, among all numbers that `f32` can represent, that is no farther than this step.
        let (mut below, mut at) = (ordered(least), ordered(greatest));
        while at - below > 1 {
            let middle = below + (at - below) / 2;
            if step_at(unordered(middle)) <= step { at = middle } else { below = middle }
        }
        unordered(at)
    };
    (*steps.start()..*steps.end()).into_par_iter().map(boundary).collect()
}

/// Maps numbers to integers with the same order.
fn ordered(v: f32) -> i64 {
    let bits = i64::from(v.to_bits() & 0x7fff_ffff);
    if v.is_sign_negative() { -bits } else { bits }
}

/// The inverse of [`ordered`].
fn unordered(i: i64) -> f32 {
    f32::from_bits(i.unsigned_abs() as u32).copysign(if i < 0 { -1.0 } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boundaries_separate_the_steps_exactly() {
        let range = [-0.7f32, 0.9];
        let step_at = |d: f32| step((-17.3 * (f64::from(d) - 0.123)) as f32);
        let steps = step_at(range[1])..=step_at(range[0]);
        let boundaries = boundaries(range, &steps, step_at);
        assert_eq!(boundaries.len() as i32, steps.end() - steps.start());
        let looked_up = |d: f32| steps.start() + boundaries.partition_point(|b| d < *b) as i32;
        for i in 0..100_000 {
            let d = range[0] + (range[1] - range[0]) * i as f32 / 1e5;
            assert_eq!(looked_up(d), step_at(d), "{d}");
        }
        for b in &boundaries {
            for d in [b.next_down(), *b] {
                assert_eq!(looked_up(d), step_at(d), "{d}");
            }
        }
    }
}
