//! The CPU path: what carries the plans out. [`render`] is the way of a picture; a method is a file, or a folder.

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
