//! The CPU path: what carries the plans out.

pub mod border;
pub mod enlarge;
pub mod falloff;
pub mod gaussian;
pub mod hexagonal;
pub mod lens;
pub mod levels;
pub mod magnify;
pub mod poisson;
pub mod resolve;
pub mod rows;
pub mod simd;
pub mod sprites;
pub mod taps;
pub mod tiles;
