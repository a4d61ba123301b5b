//! The GPU path: what carries the plans out on an adapter, through `wgpu` and the shaders in `shaders/`.
//!
//! A method is a file here that uploads its plan and runs a few passes, and a shader for each pass. [`adapters`] says
//! what there is, [`device`] opens one of them, [`commands`] runs passes on it, and [`resident`] keeps a picture there.

pub mod adapters;
mod commands;
mod device;
mod draw;
mod gaussian;
mod hexagonal;
mod lens;
mod levels;
mod poisson;
mod process;
mod resident;
mod resolve;
mod shader;
mod sprites;
mod taps;
#[cfg(test)]
mod tests;

pub use resident::Residence;

use crate::cancel::Cancel;
use crate::cpu::lens::Sheets;
use crate::cpu::simd::Simd;
use crate::error::{Error, Result};
use crate::optics::{Imaging, Optics};
use crate::picture::Picture;
use crate::render::{Method, Rendered};
use commands::{Commands, Pending};
use device::Gpu;
use std::sync::Arc;

/// The methods that have a GPU path.
pub const METHODS: [&str; 7] = ["lens", "poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"];

/// What is rendered.
pub struct Source<'a, S> {
    /// The picture with its disparity.
    pub picture: &'a Picture,
    /// Where it is kept.
    pub residence: &'a Residence,
    /// Prepares the sheets for a lens.
    pub sheets: S,
    /// Pixels of the picture to one of the output, along each axis.
    pub supersample: usize,
}

/// The picture through each of some lenses, interleaved, from the adapter that is the `adapter`th of [`adapters::all`].
/// One picture comes back while the next one is computed.
pub fn render_each<S: Fn(&Optics) -> Result<Arc<Sheets>>>(
    adapter: usize,
    source: &Source<S>,
    optics: &[Optics],
    method: &Method,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Vec<Rendered>> {
    let gpu = Gpu::open(adapter)?;
    let work = || {
        let mut rendered = Vec::with_capacity(optics.len());
        let mut running: Option<Pending> = None;
        for optics in optics {
            let next = start(&gpu, source, optics, method, simd, cancel)?;
            if let Some(before) = running.replace(next) {
                rendered.push(before.wait(cancel)?);
            }
        }
        rendered.extend(running.map(|last| last.wait(cancel)).transpose()?);
        Ok(rendered)
    };
    work().inspect_err(|error| {
        if matches!(error, Error::Device(_)) {
            gpu.retire();
        }
    })
}

/// Begins to compute one picture.
fn start<S: Fn(&Optics) -> Result<Arc<Sheets>>>(
    gpu: &Arc<Gpu>,
    source: &Source<S>,
    optics: &Optics,
    method: &Method,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Pending> {
    let picture = source.residence.picture(gpu, source.picture)?;
    // What takes long on the CPU, and is kept, comes first.
    let prepared = match method {
        Method::Lens(_) => {
            let sheets = (source.sheets)(optics)?;
            let cells = source.residence.cells(gpu, &sheets)?;
            Some((sheets, cells))
        }
        _ => None,
    };
    gpu.guarded(|| {
        let mut commands = Commands::new(gpu);
        let full = match (method, &prepared) {
            (Method::Lens(settings), Some((sheets, cells))) => {
                let input = lens::Input { picture: &picture, sheets, cells, supersample: source.supersample };
                lens::render(&mut commands, &input, optics, settings, simd, cancel)
            }
            (Method::Poisson(settings), _) => poisson::render(&mut commands, &picture, optics, settings),
            (Method::Hexagonal(settings), _) => hexagonal::render(&mut commands, &picture, optics, settings),
            (Method::Levels(settings), _) => levels::render(&mut commands, &picture, optics, settings),
            (Method::Gaussian(settings), _) => gaussian::render(&mut commands, &picture, optics, settings),
            (Method::Taps(settings), _) => taps::render(&mut commands, &picture, optics, settings),
            (Method::Sprites(settings), _) => {
                sprites::render(&mut commands, source.residence, &picture, optics, settings)
            }
            (other, _) => Err(no_path(other.name())),
        }?;
        let output = match source.supersample {
            1 => full,
            n => resolve::box_average(&mut commands, &full, picture.size, n)?,
        };
        commands.submit(&output)
    })
}

/// Refuses methods that have no GPU path, and lenses that those have none for.
pub fn refuse(method: &Method, lens: &Imaging) -> Result<()> {
    if !METHODS.contains(&method.name()) {
        return Err(no_path(method.name()));
    }
    let aberrated = matches!(method, Method::Lens(settings) if settings.aperture.has_sides());
    let beyond = [
        ("an aperture with spherical aberration", aberrated),
        ("a lens with tilt or field_curvature", !lens.surface.is_facing()),
        ("a lens with axial_color", lens.is_axially_chromatic()),
        ("a lens with lateral_color, or one that breathes,", lens.is_magnified()),
        ("a lens with cat_eye", lens.barrel.is_some()),
        ("a lens with vignetting", lens.falloff.is_some()),
    ];
    match beyond.iter().find(|(_, has)| *has) {
        None => Ok(()),
        Some((what, _)) => Err(Error::Device(format!(
            "{what} cannot be computed on a GPU in this version. Use device=\"cpu\" or \"auto\""
        ))),
    }
}

/// The refusal of a method that has no GPU path.
fn no_path(method: &str) -> Error {
    Error::Device(format!(
        "method={method:?} cannot be computed on a GPU in this version; these can: {}. Use device=\"cpu\" or \
         \"auto\"",
        METHODS.map(|name| format!("{name:?}")).join(", ")
    ))
}
