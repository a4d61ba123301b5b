//! What the methods of one layer are given.

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
    /// Set by a caller who does not want the picture any more.
    pub cancel: &'a Cancel,
}
