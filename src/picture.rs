//! The input of a render: validated colour and disparity, planar, in `f32`.

use crate::memory::Buffer;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// The size of a frame and the channels of its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colour channels, 1 to 4.
    pub channels: usize,
}

impl Size {
    /// Pixels of the frame.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }
}

/// The surface that the pixels of one layer show.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Linear colour, one plane per channel; premultiplied if the last channel is coverage.
    pub color: Arc<Buffer<f32>>,
    /// Disparity of every pixel.
    pub disparity: Buffer<f32>,
    /// Its least and its greatest value, computed when first needed.
    range: OnceLock<[f32; 2]>,
}

impl Layer {
    /// Colour planes, and the disparity of each pixel.
    pub fn new(color: Arc<Buffer<f32>>, disparity: Buffer<f32>) -> Layer {
        Layer { color, disparity, range: OnceLock::new() }
    }

    /// The least and the greatest disparity.
    pub fn disparity_range(&self) -> [f32; 2] {
        // The search is not done inside the lock: workers that wait for one another there could wait for themselves.
        let found = self.range.get().copied();
        found.unwrap_or_else(|| {
            let found = range(&self.disparity);
            *self.range.get_or_init(|| found)
        })
    }
}

/// The least and the greatest of some values, ignoring NaN; infinity and its negative if there are none.
pub fn range(values: &[f32]) -> [f32; 2] {
    const LANES: usize = 16;
    let lesser = |a: f32, b: f32| if b < a { b } else { a };
    let greater = |a: f32, b: f32| if b > a { b } else { a };
    let of = |values: &[f32]| {
        // Whole arrays are updated from whole arrays, each in a loop of its own: the compiler vectorises this.
        let (blocks, rest) = values.as_chunks::<LANES>();
        let least = blocks
            .iter()
            .fold([f32::INFINITY; LANES], |least, block| std::array::from_fn(|i| lesser(least[i], block[i])));
        let greatest = blocks.iter().fold([f32::NEG_INFINITY; LANES], |greatest, block| {
            std::array::from_fn(|i| greater(greatest[i], block[i]))
        });
        [
            least.iter().chain(rest).copied().fold(f32::INFINITY, lesser),
            greatest.iter().chain(rest).copied().fold(f32::NEG_INFINITY, greater),
        ]
    };
    let both = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    values.par_chunks(1 << 14).map(of).reduce(|| of(&[]), both)
}

/// How a pixel at an edge is divided, as it is known beside its colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownCoverage {
    /// The pixel.
    pub index: usize,
    /// The share of it that the nearer of two surfaces covers.
    pub coverage: f32,
    /// How far that is known, 0 to 1.
    pub trust: f32,
}

/// How the values of a channel are put together from those of its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weighting {
    /// As light: mixed pixels are taken apart so that both parts add up to them, and the blur of drawing at fractions of
    /// a pixel is undone. Some weights are negative.
    Light,
    /// As a mean: no weight is negative.
    Mean,
}

/// Up to four channels that are rendered together. None of them knows of another one.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelGroup {
    /// The frame, with the channels of this group.
    pub size: Size,
    /// How their values are put together.
    pub weighting: Weighting,
    /// For each layer of the picture, one plane for each channel.
    pub layers: Vec<Arc<Buffer<f32>>>,
}

impl ChannelGroup {
    /// The most channels of a group.
    pub const MOST: usize = 4;

    /// The values of a pixel of the first layer; zero for channels that the group does not have.
    pub fn at(&self, index: usize) -> [f32; 4] {
        let n = self.size.pixels();
        std::array::from_fn(|c| if c < self.size.channels { self.layers[0][c * n + index] } else { 0.0 })
    }
}

/// Colour and disparity in layers of one size, front to back.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The frame.
    pub size: Size,
    /// One layer, or several whose last channel is coverage.
    pub layers: Vec<Layer>,
    /// What blocks the light of what is behind it and is not seen itself, in any order. Its only channel is coverage.
    pub holdouts: Arc<Vec<Layer>>,
    /// Coverage of pixels at edges of a picture of one layer, where it is known beside their colours; in the order of
    /// rows.
    pub edges: Arc<Vec<KnownCoverage>>,
    /// Channels that the picture carries, in as many layers.
    pub carried: Arc<Vec<ChannelGroup>>,
}

impl Picture {
    /// The coverage of each of several layers; one layer covers all.
    pub fn coverage(&self) -> Vec<&[f32]> {
        match self.layers.as_slice() {
            [_] => Vec::new(),
            layers => {
                let first = (self.size.channels - 1) * self.size.pixels();
                layers.iter().map(|layer| &layer.color[first..]).collect()
            }
        }
    }

    /// These layers alone.
    pub fn new(size: Size, layers: Vec<Layer>) -> Picture {
        Picture { size, layers, holdouts: Arc::default(), edges: Arc::default(), carried: Arc::default() }
    }

    /// Only these channels, and nothing that is carried.
    pub fn of_channels(&self, channels: &[usize]) -> Picture {
        let n = self.size.pixels();
        let layers = self.layers.iter().map(|layer| {
            let kept: Vec<_> = channels.iter().map(|&c| &layer.color[c * n..][..n]).collect();
            Layer { color: Arc::new(Buffer::concat(&kept)), ..layer.clone() }
        });
        Picture {
            size: Size { channels: channels.len(), ..self.size },
            layers: layers.collect(),
            holdouts: Arc::clone(&self.holdouts),
            edges: Arc::clone(&self.edges),
            carried: Arc::default(),
        }
    }

    /// The same picture with the disparity `map(x, y, d)` in place of every disparity `d`.
    pub fn with_disparity(&self, map: impl Fn(f64, f64, f64) -> f64 + Sync) -> Picture {
        let width = self.size.width;
        let mapped = |layer: &Layer| {
            let mut disparity = layer.disparity.clone();
            disparity.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
                for (x, d) in row.iter_mut().enumerate() {
                    *d = map(x as f64, y as f64, f64::from(*d)) as f32;
                }
            });
            Layer::new(Arc::clone(&layer.color), disparity)
        };
        Picture {
            size: self.size,
            layers: self.layers.iter().map(mapped).collect(),
            holdouts: Arc::new(self.holdouts.iter().map(mapped).collect()),
            edges: Arc::clone(&self.edges),
            carried: Arc::clone(&self.carried),
        }
    }
}

/// The index of the coverage channel in pictures of three colours.
pub(crate) const COVERAGE: usize = 3;

/// The channels that are rendered at the focus of a colour: the colour itself, and coverage, if there is one, because
/// the colour needs it.
pub(crate) fn channels_at(color: usize, channels: usize) -> Vec<usize> {
    if channels > COVERAGE { vec![color, COVERAGE] } else { vec![color] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_leave_out_what_is_none() {
        let mut values: Vec<f32> = (0..40_000).map(|i| ((i * 7919) % 40_000) as f32 - 5.0).collect();
        values[3] = f32::NAN;
        values[39_999] = f32::NAN;
        let plain = values.iter().copied().filter(|v| !v.is_nan());
        let expected = plain.fold((f32::MAX, f32::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)));
        assert_eq!(range(&values), [expected.0, expected.1]);
        assert_eq!(range(&[f32::NAN]), [f32::INFINITY, f32::NEG_INFINITY]);
    }
}
