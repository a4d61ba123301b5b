//! The CPU path, which carries out the plans. [`render`] is the sequence of steps for a picture; a method is a file
//! or a folder.

pub mod adjoint;
mod enlarge;
mod falloff;
mod gaussian;
mod hexagonal;
mod job;
mod lens;
mod levels;
mod magnify;
mod padded_rows;
mod poisson;
pub mod render;
mod resolve;
mod sprites;
mod taps;
mod tiles;
