//! Pictures in the common formats, read by the `image` crate: PNG, WebP, BMP and Radiance HDR.

use super::error::Problem;
use super::raster::{Alpha, Beside, Raster, Samples};
use super::source::{Source, check_claim};
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use std::io::{Read, Seek};

const ACCEPTED: &str = "grey, grey with alpha, RGB and RGBA pictures";

/// The most that what is not pixels may take, beside the length of the file: more than any profile, and than a row.
const BESIDE_PIXELS: u64 = 64 << 20;

pub(super) fn read(source: Source, format: ImageFormat) -> Result<Raster, Problem> {
    let length = source.length;
    let mut reader = ImageReader::with_format(source.reader, format);
    // The decoders' own limits are meant for uploads; here the header's claim is checked against the length of the
    // file. Everything that is not pixels, such as a colour profile, has this bound.
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(BESIDE_PIXELS.saturating_add(length));
    reader.limits(limits);
    let mut decoder = reader.into_decoder()?;
    let refuse = |found: String| Problem::Unsupported { found, accepted: ACCEPTED };
    check_claim(u128::from(decoder.total_bytes()), length)?;
    let beside = Beside {
        profile: decoder.icc_profile()?,
        exif: decoder.exif_metadata()?,
        orientation: decoder.orientation()?.to_exif(),
    };

    let (width, height) = decoder.dimensions();
    let (channels, alpha) = match decoder.color_type() {
        ColorType::L8 | ColorType::L16 => (1, Alpha::None),
        ColorType::La8 | ColorType::La16 => (2, Alpha::Straight),
        ColorType::Rgb8 | ColorType::Rgb16 | ColorType::Rgb32F => (3, Alpha::None),
        ColorType::Rgba8 | ColorType::Rgba16 | ColorType::Rgba32F => (4, Alpha::Straight),
        other => return Err(refuse(format!("{other:?}"))),
    };
    let samples = match DynamicImage::from_decoder(decoder)? {
        DynamicImage::ImageLuma8(image) => Samples::U8(image.into_raw()),
        DynamicImage::ImageLumaA8(image) => Samples::U8(image.into_raw()),
        DynamicImage::ImageRgb8(image) => Samples::U8(image.into_raw()),
        DynamicImage::ImageRgba8(image) => Samples::U8(image.into_raw()),
        DynamicImage::ImageLuma16(image) => Samples::U16(image.into_raw()),
        DynamicImage::ImageLumaA16(image) => Samples::U16(image.into_raw()),
        DynamicImage::ImageRgb16(image) => Samples::U16(image.into_raw()),
        DynamicImage::ImageRgba16(image) => Samples::U16(image.into_raw()),
        DynamicImage::ImageRgb32F(image) => Samples::F32(image.into_raw()),
        DynamicImage::ImageRgba32F(image) => Samples::F32(image.into_raw()),
        other => return Err(refuse(format!("{:?}", other.color()))),
    };
    Ok(Raster { width: width as usize, height: height as usize, channels, alpha, samples, beside })
}

/// Reads WebP. The decoder does not notice where the end of a lossy picture is missing.
pub(super) fn read_webp(mut source: Source) -> Result<Raster, Problem> {
    // A word, then the length of what follows.
    let mut start = [0; 8];
    source.reader.read_exact(&mut start)?;
    source.reader.rewind()?;
    let claimed = u32::from_le_bytes([start[4], start[5], start[6], start[7]]);
    if u64::from(claimed) + start.len() as u64 > source.length {
        return Err(Problem::Damaged("it ends too early".into()));
    }
    read(source, ImageFormat::WebP)
}

impl From<ImageError> for Problem {
    fn from(error: ImageError) -> Self {
        match error {
            ImageError::IoError(error) => error.into(),
            ImageError::Unsupported(what) => {
                Self::Unsupported { found: what.to_string(), accepted: ACCEPTED }
            }
            other => Self::Damaged(other.to_string()),
        }
    }
}
