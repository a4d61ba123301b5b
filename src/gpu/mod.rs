//! The GPU path, which carries the plans out on an adapter, through `wgpu` and the shaders in `shaders/`.
//!
//! A method is a file here that uploads its plan and runs a few passes, and a shader for each pass. [`adapters`]
//! lists the adapters, of which [`visible`] leaves some, and [`machine`] says why there is none. [`device`] opens one
//! of them, [`commands`] runs passes on it, and [`scene_cache`] keeps a scene there. Passes are [`recorded`] until their
//! [`pipelines`] are compiled. [`mod@submissions`] hands over work in pieces, which are short by [`pace`];
//! [`mod@traffic`] counts them and what goes there and back, and [`idle`] gives spare memory back. [`render`] is the
//! sequence of steps for a picture: [`bands`] splits frames that are too large; [`by_focus`], [`magnify`], [`falloff`]
//! and [`resolve`] are the effects of a lens on whole pictures.

pub mod adapters;
mod bands;
mod by_focus;
mod carried;
mod commands;
mod device;
mod falloff;
mod gaussian;
mod hexagonal;
mod idle;
mod lens;
mod levels;
pub mod machine;
mod magnify;
mod pace;
mod picture;
mod pipelines;
mod poisson;
mod process_local;
mod recorded;
pub(crate) mod render;
mod resolve;
mod scene_cache;
mod shader;
mod sprites;
mod submissions;
mod taps;
#[cfg(test)]
mod tests;
mod traffic;
pub mod visible;

pub use commands::PassTime;
pub use device::{Restrictions, allocated_bytes, release, restrict, submissions};
pub use scene_cache::SceneCache;
pub use traffic::traffic;
