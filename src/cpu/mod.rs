//! The CPU path: what carries the plans out.

pub mod border;
pub mod gaussian;
pub mod lens;
pub mod poisson;
pub mod resolve;
pub mod rows;
pub mod simd;
pub mod taps;
