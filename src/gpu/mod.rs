//! The GPU path: what carries the plans out on an adapter, through `wgpu` and the shaders in `shaders/`.
//!
//! A method is a file here that uploads its plan and runs a few passes, and a shader for each pass. [`adapters`] says
//! what there is, [`device`] opens one of them, [`commands`] runs passes on it, and [`resident`] keeps a picture there.

pub mod adapters;
mod commands;
mod device;
mod gaussian;
mod lens;
mod process;
mod resident;
mod shader;
mod taps;

pub use commands::{Finished, PassTime};
pub use device::Gpu;
pub use resident::Residence;

use crate::cancel::Cancel;
use crate::cpu::lens::Sheets;
use crate::cpu::simd::Simd;
use crate::error::{Error, Result};
use crate::optics::Optics;
use crate::picture::Picture;
use crate::render::Method;
use std::sync::Arc;

/// The methods that have a GPU path.
pub const METHODS: [&str; 3] = ["lens", "gaussian", "taps"];

/// What is rendered.
pub struct Source<'a, S> {
    /// The picture with its disparity.
    pub picture: &'a Picture,
    /// Where it is kept.
    pub residence: &'a Residence,
    /// Prepares the sheets for the lens, if they are needed.
    pub sheets: S,
    /// Pixels of the picture to one of the output, along each axis.
    pub supersample: usize,
}

/// The picture through a lens, interleaved, from the adapter that is the `adapter`th of [`adapters::all`].
pub fn render(
    adapter: usize,
    source: Source<impl FnOnce() -> Result<Arc<Sheets>>>,
    optics: &Optics,
    method: &Method,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Finished> {
    let gpu = Gpu::open(adapter)?;
    let Source { residence, supersample, .. } = source;
    let work = || {
        let picture = residence.picture(&gpu, source.picture)?;
        let pending = match method {
            Method::Lens(settings) => {
                let sheets = (source.sheets)()?;
                let cells = residence.cells(&gpu, &sheets)?;
                let input = lens::Input { picture: &picture, sheets: &sheets, cells: &cells, supersample };
                gpu.guarded(|| lens::start(&gpu, &input, optics, settings, simd, cancel))
            }
            Method::Gaussian(settings) => gpu.guarded(|| gaussian::start(&gpu, &picture, optics, settings)),
            Method::Taps(settings) => gpu.guarded(|| taps::start(&gpu, &picture, optics, settings)),
            other => Err(no_path(other.name())),
        }?;
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
