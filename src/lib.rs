//! Depth of field as a real lens would have taken it.

pub mod aperture;
pub mod cancel;
pub mod color;
pub mod cpu;
pub mod depth;
pub mod device;
pub mod error;
pub mod files;
pub mod gpu;
mod memory;
pub mod optics;
pub mod picture;
pub mod plan;
#[cfg(feature = "python")]
mod python;
pub mod render;
pub mod views;
