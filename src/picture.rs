//! What a render starts from: validated colour and disparity, planar, in `f32`.

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

/// Colour and disparity in layers, front to back, of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The frame.
    pub size: Size,
    /// One layer, or several whose last channel is coverage.
    pub layers: Vec<Layer>,
}
