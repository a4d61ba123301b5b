//! Contrast: how far single cells, with what highlights leave of their light, outshine what is around.

use super::colors::picked;
use crate::picture::Size;
use std::array::from_fn;

/// A cell is a highlight by what it has above this many times its surroundings. At this limit, one lens sample of 512
/// that appears or disappears changes a pixel of the disc by one hundredth of the surroundings.
pub const HIGHLIGHT_RATIO: f32 = 5.0;

/// Number of channels that hold light: the last of two or four is coverage, which has no brightness.
pub fn light_channels(size: Size) -> usize {
    if size.channels == 2 { 1 } else { size.channels.min(3) }
}

/// The light of some cells. Negative values, as filters leave them, count as much as positive ones.
#[derive(Clone, Copy, Default)]
pub struct Light {
    pub sum: [f32; 4],
    pub cells: f32,
}

impl Light {
    pub fn add(&mut self, other: &Light) {
        self.sum.iter_mut().zip(other.sum).for_each(|(sum, v)| *sum += v);
        self.cells += other.cells;
    }

    /// The value of each channel above which a cell among these is a highlight.
    pub fn limit(&self) -> [f32; 4] {
        self.sum.map(|sum| HIGHLIGHT_RATIO * (sum / self.cells.max(1.0)))
    }
}

/// The contrast of some blocks.
#[derive(Clone, Copy)]
pub struct Contrast {
    /// The light of the first layer's cells, without highlights.
    pub light: Light,
    /// The brightest of all cells that are above the limit where they are, and how many times as bright as that limit they
    /// are at the most; channel by channel, without what is taken out of them.
    brightest: [f32; 4],
    times: [f32; 4],
}

impl Contrast {
    /// That of blocks with this light, in which no cell is above the limit.
    pub fn even(light: Light) -> Contrast {
        Contrast { light, brightest: [0.0; 4], times: [1.0; 4] }
    }

    /// Takes in a cell that is left with a colour where this is the limit.
    pub fn take_in(&mut self, color: [f32; 4], limit: [f32; 4]) {
        self.brightest = from_fn(|c| self.brightest[c].max(color[c]));
        self.times = from_fn(|c| self.times[c].max(color[c] / limit[c].max(f32::MIN_POSITIVE)));
    }

    /// That of all of these blocks.
    pub fn united<'a>(blocks: impl Iterator<Item = &'a Contrast>) -> Contrast {
        let mut all = Contrast::even(Light::default());
        blocks.for_each(|block| all.unite(block));
        all
    }

    /// Takes in other blocks.
    fn unite(&mut self, other: &Contrast) {
        self.light.add(&other.light);
        self.brightest = from_fn(|c| self.brightest[c].max(other.brightest[c]));
        self.times = from_fn(|c| self.times[c].max(other.times[c]));
    }

    /// That in these channels alone.
    pub fn of_channels(&self, channels: &[usize]) -> Contrast {
        Contrast {
            light: Light { sum: picked(self.light.sum, channels, 0.0), ..self.light },
            brightest: picked(self.brightest, channels, 0.0),
            times: picked(self.times, channels, 1.0),
        }
    }

    /// Whether no cell is above the limit.
    pub fn is_even(&self) -> bool {
        self.times == [1.0; 4]
    }

    /// How many times as bright as a highlight begins to be a cell is at the most, where the lens mixes it with all that has
    /// this limit: what is dark around it may be little of that. At least 1.
    pub fn times(&self, limit: [f32; 4]) -> f32 {
        let times = |c: usize| self.times[c].min(self.brightest[c] / limit[c].max(f32::MIN_POSITIVE));
        (0..4).map(times).fold(1.0, f32::max)
    }
}
