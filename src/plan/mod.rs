//! The plans of all methods for one lens: settings, tap tables, weights, tiles and lens samples.
//!
//! A method is a file or a folder; [`magnify`] resizes whole pictures. Nothing here depends on the device that
//! carries the plan out: `cpu` and `gpu` have a file of the same name for each.

pub mod gaussian;
pub mod hexagonal;
pub mod lens;
pub mod levels;
pub mod magnify;
pub mod poisson;
pub mod sprites;
pub mod taps;
