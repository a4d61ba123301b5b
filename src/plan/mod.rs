//! What to do, worked out before any pixel is looked at: settings, tap tables, weights and thresholds.
//!
//! A file a method, and one for what is done to whole pictures. Nothing here depends on where the plan is carried out;
//! `cpu` has a file of the same name for each.

pub mod gaussian;
pub mod hexagonal;
pub mod lens;
pub mod levels;
pub mod magnify;
pub mod poisson;
pub mod sprites;
pub mod taps;
