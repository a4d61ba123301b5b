//! What a render starts from: validated colour and disparity, planar, in `f32`.

use rayon::prelude::*;
use std::sync::Arc;

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

/// The surface that every pixel of one layer sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Linear colour, one plane a channel; premultiplied if the last channel is coverage.
    pub color: Arc<Vec<f32>>,
    /// Disparity of every pixel.
    pub disparity: Vec<f32>,
}

impl Layer {
    /// The least and the greatest disparity.
    pub fn disparity_range(&self) -> [f32; 2] {
        const LANES: usize = 16;
        let of = |values: &[f32]| {
            let (mut least, mut greatest) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
            for values in values.chunks(LANES) {
                for ((least, greatest), v) in least.iter_mut().zip(&mut greatest).zip(values) {
                    *least = if v < least { *v } else { *least };
                    *greatest = if v > greatest { *v } else { *greatest };
                }
            }
            [
                least.into_iter().fold(f32::INFINITY, f32::min),
                greatest.into_iter().fold(f32::NEG_INFINITY, f32::max),
            ]
        };
        let both = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        self.disparity.par_chunks(1 << 14).map(of).reduce(|| of(&[]), both)
    }
}

/// Colour and disparity in layers, front to back, of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The frame.
    pub size: Size,
    /// One layer, or several whose last channel is coverage.
    pub layers: Vec<Layer>,
}
