//! The GPU path: what carries the plans out on an adapter, through `wgpu` and the shaders in `shaders/`.
//!
//! A method is a file here that uploads its plan and runs a few passes, and a shader for each pass. [`adapters`] says
//! what there is, [`device`] opens one of them, [`commands`] runs passes on it, and [`resident`] keeps a picture there.

pub mod adapters;
mod commands;
mod device;
mod gaussian;
mod process;
mod resident;
mod shader;
mod taps;

pub use commands::{Finished, PassTime};
pub use device::Gpu;
pub use resident::Residence;

use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::optics::Optics;
use crate::picture::Picture;
use crate::render::Method;

/// The methods that have a GPU path.
pub const METHODS: [&str; 2] = ["gaussian", "taps"];

/// The picture through a lens, interleaved, from the adapter that is the `adapter`th of [`adapters::all`].
pub fn render(
    adapter: usize,
    picture: &Picture,
    residence: &Residence,
    optics: &Optics,
    method: &Method,
    cancel: &Cancel,
) -> Result<Finished> {
    let gpu = Gpu::open(adapter)?;
    let work = || {
        let scene = residence.on(&gpu, picture)?;
        let pending = gpu.guarded(|| match method {
            Method::Gaussian(settings) => gaussian::start(&gpu, &scene, optics, settings),
            Method::Taps(settings) => taps::start(&gpu, &scene, optics, settings),
            other => Err(no_path(other.name())),
        })?;
        pending.wait(cancel)
    };
    work().inspect_err(|error| {
        if matches!(error, Error::Device(_)) {
            gpu.retire();
        }
    })
}

/// The refusal of a method that has no GPU path.
pub fn no_path(method: &str) -> Error {
    Error::Device(format!(
        "method={method:?} cannot be computed on a GPU in this version; these can: {}. Use device=\"cpu\" or \
         \"auto\"",
        METHODS.map(|name| format!("{name:?}")).join(", ")
    ))
}
