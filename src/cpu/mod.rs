//! The CPU path.

pub mod lens;
pub mod resolve;
pub mod simd;
