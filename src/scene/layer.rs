//! One layer of a [layered scene](super::layered).

use super::colors::Colors;
use super::half_plane::HalfPlane;
use crate::memory::Buffer;
use std::sync::Arc;

/// One cell a pixel at most. The layers of single channels share all but the colours.
pub struct SceneLayer {
    /// Shift of every cell relative to infinity, in pixels; NaN where there is none.
    pub s: Arc<Buffer<f32>>,
    /// Colour of every cell; zero where there is none.
    pub colors: Colors,
    /// The cells that cover their pixel in part, by rising index.
    pub partial: Arc<Vec<(usize, HalfPlane)>>,
    /// Which neighbours are one surface, however steep; see [`connectivity`](super::edges::connectivity). Empty for a layer whose cells are no plain pixels.
    pub connectivity: Arc<Vec<u8>>,
}
