//! The input of the methods that render one layer.

use crate::cancel::Cancel;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::simd::Simd;

/// One layer of a picture, the lens, and how to compute.
pub struct Job<'a> {
    /// Colour and disparity.
    pub front: &'a Layer,
    /// The size of the frame.
    pub size: Size,
    /// The lens.
    pub optics: &'a Optics,
    /// The instruction set.
    pub simd: Simd,
    /// Set by a caller that no longer needs the picture.
    pub cancel: &'a Cancel,
}
