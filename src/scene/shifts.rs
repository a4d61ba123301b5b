//! The shifts of cells, from disparity.

use super::depth_noise::without_noise;
use crate::memory::Buffer;
use crate::picture::{Layer, Size};
use crate::simd::Simd;

/// Disparity as shifts under a lens of strength `k`.
pub fn scaled(disparity: &[f32], k: f64) -> Buffer<f32> {
    Buffer::of_each(disparity, |d| (k * f64::from(*d)) as f32)
}

/// The shifts of a layer's cells; NaN where it covers nothing.
pub fn of_cells(layer: &Layer, coverage: &[f32], size: Size, k: f64, simd: Simd) -> Buffer<f32> {
    let mut s = scaled(&layer.disparity, k);
    s.iter_mut().zip(coverage).filter(|(_, a)| **a <= 0.0).for_each(|(s, _)| *s = f32::NAN);
    without_noise(s, size, simd)
}
