//! Pictures of one scene with what took them.

use super::camera::Camera;
use crate::memory::Buffer;
use crate::picture::Size;

/// Colours that differ by no more than this part of them agree: what noise and resampling leave between two pictures of
/// one thing.
pub const AGREES: f32 = 1.0 / 32.0;

/// One picture of a scene.
pub struct View {
    /// Colour planes, linear and premultiplied.
    pub color: Buffer<f32>,
    /// Channels of the colour.
    pub channels: usize,
    /// The inverse of `z` at every pixel.
    pub disparity: Buffer<f32>,
    /// By how many pixels, to the right and down, the point at every pixel is away from it in the picture of the reference
    /// when that is taken; 0 or NaN where that is not known.
    pub flow: Option<[Buffer<f32>; 2]>,
    /// What took it.
    pub camera: Camera,
}

impl View {
    /// The colour of a pixel.
    pub fn color_at(&self, index: usize) -> [f32; 4] {
        let n = self.disparity.len();
        std::array::from_fn(|c| if c < self.channels { self.color[c * n + index] } else { 0.0 })
    }
}

/// Pictures of one scene and one size.
pub struct Views {
    /// Their size.
    pub size: Size,
    /// How many channels, the first ones, hold light.
    pub lights: usize,
    /// The pictures.
    pub views: Vec<View>,
    /// The number of the one that is to be rendered.
    pub reference: usize,
}
