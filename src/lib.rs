//! Depth of field as a real lens would have taken it.

pub mod aperture;
pub mod cancel;
pub mod carried;
pub mod clipped;
pub mod color;
mod cpu;
pub mod deep;
pub mod depth;
pub mod device;
pub mod error;
pub mod files;
mod gpu;
pub mod matte;
mod memory;
pub mod method;
mod mirror;
mod noise;
pub mod optics;
pub mod picture;
pub mod plan;
#[cfg(feature = "python")]
mod python;
pub mod refine;
pub mod renderer;
mod rows;
mod scene;
pub mod simd;
pub mod views;
