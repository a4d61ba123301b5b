//! Pictures in the form in which files hold them.

use super::error::Problem;
use half::f16;

/// The relation of a pixel's colour to its alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alpha {
    /// There is no alpha channel.
    None,
    /// Colour is not multiplied by alpha (PNG; "unassociated" in TIFF).
    Straight,
    /// Colour is multiplied by alpha (OpenEXR; "associated" in TIFF).
    Premultiplied,
}

/// The samples of a picture, in the type that they have in the file.
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

/// A picture as it was read: rows from top to bottom, channels interleaved.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of samples per pixel.
    pub channels: usize,
    /// The kind of alpha, which is the last channel if there is one.
    pub alpha: Alpha,
    /// `height * width * channels` samples.
    pub samples: Samples,
    /// What the file holds beside them.
    pub beside: Beside,
}

/// What a file holds beside its pixels.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Beside {
    /// The bytes of an ICC profile.
    pub profile: Option<Vec<u8>>,
    /// The bytes of Exif, from the header of TIFF on.
    pub exif: Option<Vec<u8>>,
    /// How the picture is to be turned and mirrored to be seen, 1 to 8 as in Exif; 1 is as it is.
    pub orientation: u8,
}

/// Borrowed samples that are to be written to an integer or float file.
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
    /// Number of samples per pixel.
    pub channels: usize,
}

impl Shape {
    /// Width and height as the 32-bit numbers that PNG and TIFF store.
    pub(super) fn size_u32(self) -> std::result::Result<(u32, u32), Problem> {
        let narrow = |n: usize| {
            u32::try_from(n).map_err(|_| Problem::Argument(format!("{n} pixels on a side are too many")))
        };
        if self.width == 0 || self.height == 0 {
            return Err(Problem::Argument("an image without pixels cannot be written".into()));
        }
        Ok((narrow(self.width)?, narrow(self.height)?))
    }
}
