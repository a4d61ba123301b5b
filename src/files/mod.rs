//! Pictures and depth maps on disk.
//!
//! Every reader takes the size that a header claims as a claim. Before memory is set aside for it, it is
//! held against the length of the file ([`source::check_claim`]). Every writer goes through [`atomic::replace`], so
//! that a file under its own name is always whole.

pub mod atomic;
mod error;
mod jpeg;
mod kind;
pub mod openexr;
pub mod pfm;
mod photo;
pub mod png;
mod raster;
mod source;
pub mod tiff;

pub use error::{FileError, Problem, Result};
pub use kind::{Kind, kind};
pub use raster::{Alpha, Pixels, Raster, Samples, Shape};

use image::ImageFormat;
use source::{open, with_path};
use std::path::Path;

/// Reads a file of any kind but OpenEXR and NumPy's, whichever its first bytes say it is.
pub fn read_raster(path: &Path) -> Result<Raster> {
    let kind = kind(path)?;
    with_path(path, || {
        let raster = match kind {
            Kind::Png => photo::read(open(path)?, ImageFormat::Png),
            Kind::Jpeg => jpeg::read(open(path)?),
            Kind::WebP => photo::read_webp(open(path)?),
            Kind::Bmp => photo::read(open(path)?, ImageFormat::Bmp),
            Kind::Hdr => photo::read(open(path)?, ImageFormat::Hdr),
            Kind::Tiff => tiff::read(open(path)?),
            Kind::Pfm => pfm::read(open(path)?),
            Kind::Exr | Kind::Npy | Kind::Npz => Err(Problem::Unsupported {
                found: format!("a file of kind {}", kind.name()),
                accepted: "PNG, JPEG, WebP, BMP, Radiance HDR, TIFF or PFM",
            }),
        }?;
        match raster {
            Raster { width: 0, .. } | Raster { height: 0, .. } => {
                Err(Problem::Damaged("it has no pixels".into()))
            }
            _ => Ok(raster),
        }
    })
}
