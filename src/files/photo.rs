//! Pictures in the common formats, read by the `image` crate: PNG, JPEG, WebP, BMP and Radiance HDR.

use super::error::Problem;
use super::raster::{Alpha, Raster, Samples};
use super::source::{Source, check_claim};
use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

const ACCEPTED: &str = "grey, grey with alpha, RGB and RGBA pictures, not turned or mirrored";

pub(super) fn read(source: Source, format: ImageFormat) -> Result<Raster, Problem> {
    let length = source.length;
    let mut reader = ImageReader::with_format(source.reader, format);
    // The decoders' own limits are meant for uploads; here the header's claim is checked against the length of the
    // file.
    reader.limits(Limits::no_limits());
    let mut decoder = reader.into_decoder()?;
    let refuse = |found: String| Problem::Unsupported { found, accepted: ACCEPTED };
    check_claim(u128::from(decoder.total_bytes()), length)?;
    let orientation = decoder.orientation()?;
    if orientation != Orientation::NoTransforms {
        return Err(refuse(format!("a picture to be shown with orientation {}", orientation.to_exif())));
    }

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
    Ok(Raster { width: width as usize, height: height as usize, channels, alpha, samples })
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
