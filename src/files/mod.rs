//! Pictures and depth maps on disk.
//!
//! Every reader checks the size that a header claims against the length of the file before it allocates memory
//! ([`source::check_claim`]). Every writer goes through [`atomic::replace`], so a file under its own name is always
//! complete.

pub mod atomic;
mod error;
mod jpeg;
mod kind;
pub mod openexr;
pub mod pfm;
mod photo;
pub mod png;
pub mod profile;
mod raster;
mod source;
pub mod tiff;

pub use error::{FileError, Problem, Result};
pub use kind::{Kind, kind};
pub use raster::{Alpha, Beside, Pixels, Raster, Samples, Shape};

use image::ImageFormat;
use source::{open, with_path};
use std::path::Path;

/// Reads a file of any format but OpenEXR and NumPy; its first bytes determine the format. A picture that is stored turned
/// or mirrored is refused, for its depth is not, unless the caller turns both (`turned`).
pub fn read_raster(path: &Path, turned: bool) -> Result<Raster> {
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
            Raster { beside: Beside { orientation: orientation @ 2.., .. }, .. } if !turned => {
                Err(Problem::Unsupported {
                    found: format!("a picture to be shown with orientation {orientation}"),
                    accepted: "pictures not turned or mirrored; dofsim.photo turns pictures and depth alike",
                })
            }
            _ => Ok(raster),
        }
    })
}
