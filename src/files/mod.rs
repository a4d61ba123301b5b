//! Pictures and depth maps on disk.
//!
//! Every reader takes the size that a header claims as a claim. Before memory is set aside for it, it is
//! held against the length of the file ([`check_claim`]). Every writer goes through [`atomic::replace`], so
//! that a file under its own name is always whole.

pub mod atomic;
mod error;
mod kind;
pub mod openexr;
pub mod pfm;
mod photo;
pub mod png;
pub mod tiff;

pub use error::{FileError, Problem, Result};
pub use kind::{Kind, kind};

use half::f16;
use image::ImageFormat;
use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// How the colour of a pixel and its alpha belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alpha {
    /// There is no alpha channel.
    None,
    /// Colour is not multiplied by alpha (PNG; "unassociated" in TIFF).
    Straight,
    /// Colour is multiplied by alpha (OpenEXR; "associated" in TIFF).
    Premultiplied,
}

/// The samples of a picture in the type they have in the file.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 8-bit integers.
    U8(Vec<u8>),
    /// 16-bit integers.
    U16(Vec<u16>),
    /// 32-bit integers.
    U32(Vec<u32>),
    /// Half floats.
    F16(Vec<f16>),
    /// Floats.
    F32(Vec<f32>),
    /// Doubles.
    F64(Vec<f64>),
}

/// A picture as it was read: rows from the top, channels of a pixel side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples in a pixel.
    pub channels: usize,
    /// What the last channel is, if it is alpha.
    pub alpha: Alpha,
    /// `height * width * channels` samples.
    pub samples: Samples,
}

/// Borrowed samples on their way into an integer or float file.
#[derive(Clone, Copy, Debug)]
pub enum Pixels<'a> {
    /// 8-bit integers.
    U8(&'a [u8]),
    /// 16-bit integers.
    U16(&'a [u16]),
    /// Floats.
    F32(&'a [f32]),
}

/// The shape of a picture that is to be written.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples in a pixel.
    pub channels: usize,
}

impl Shape {
    /// Width and height in the 32 bits that PNG and TIFF store them in.
    fn size_u32(self) -> std::result::Result<(u32, u32), Problem> {
        let narrow = |n: usize| {
            u32::try_from(n).map_err(|_| Problem::Argument(format!("{n} pixels on a side are too many")))
        };
        if self.width == 0 || self.height == 0 {
            return Err(Problem::Argument("an image without pixels cannot be written".into()));
        }
        Ok((narrow(self.width)?, narrow(self.height)?))
    }
}

/// Reads a file of any kind but OpenEXR and NumPy's, whichever its first bytes say it is.
pub fn read_raster(path: &Path) -> Result<Raster> {
    let kind = kind(path)?;
    with_path(path, || {
        let raster = match kind {
            Kind::Png => photo::read(open(path)?, ImageFormat::Png),
            Kind::Jpeg => photo::read(open(path)?, ImageFormat::Jpeg),
            Kind::WebP => photo::read(open(path)?, ImageFormat::WebP),
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

/// An open file and its length in bytes.
pub(crate) struct Source {
    reader: BufReader<File>,
    length: u64,
}

fn open(path: &Path) -> std::result::Result<Source, Problem> {
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    if !metadata.is_file() && !metadata.is_dir() {
        return Err(Problem::Unsupported {
            found: "a pipe or a device".into(),
            accepted: "regular files, because pictures are not read front to back",
        });
    }
    Ok(Source { reader: BufReader::with_capacity(1 << 16, file), length: metadata.len() })
}

/// What any file may claim, however short it is: a flat picture compresses almost without limit.
const ALWAYS_ALLOWED: u64 = 256 << 20;

/// The most that deflate, the tightest of the lossless codecs here, makes of one byte, and half as much again.
const EXPANSION: u64 = 1536;

/// Refuses a header that claims more bytes of pixels than a file of this length can hold.
fn check_claim(claimed: u128, length: u64) -> std::result::Result<(), Problem> {
    let most = u128::from(length) * u128::from(EXPANSION) + u128::from(ALWAYS_ALLOWED);
    if claimed > most || usize::try_from(claimed).is_err() {
        return Err(Problem::Oversized { claimed, length });
    }
    Ok(())
}

/// Runs `work`, adds the path to its error and turns a panic inside a decoder into an error.
fn with_path<T>(path: &Path, work: impl FnOnce() -> std::result::Result<T, Problem>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|panic| Err(Problem::from_panic(panic.as_ref())))
        .map_err(|problem| FileError { path: path.to_owned(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_is_held_against_the_length_of_the_file() {
        assert!(check_claim(60_000 * 60_000 * 3, 1024).is_err());
        assert!(check_claim(4096 * 4096 * 16, 1024).is_ok());
        assert!(check_claim(u128::MAX, u64::MAX).is_err());
    }

    #[test]
    fn a_panic_becomes_an_error_that_names_the_file() {
        let error = with_path::<()>(Path::new("a.exr"), || panic!("sample bug")).unwrap_err();
        assert_eq!(error.to_string(), "a.exr: damaged file: the decoder gave up (sample bug)");
    }
}
