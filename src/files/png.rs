//! PNG with 8 and 16 bits per sample, marked as sRGB, which the `image` crate does not support.

use super::atomic;
use super::error::{Problem, Result};
use super::raster::{Pixels, Shape};
use ::png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Info};
use std::borrow::Cow;
use std::io::Write;
use std::path::Path;

/// Writes 1 to 4 channels of 8 or 16 bits with straight alpha, marked as sRGB or with the profile that they are in.
pub fn write(path: &Path, pixels: Pixels<'_>, shape: Shape, profile: Option<&[u8]>) -> Result<()> {
    atomic::replace(path, |writer| encode(writer, pixels, shape, profile, Compression::default()))
}

/// The bytes of such a file, compressed quickly: meant for a screen, not for storage.
pub fn bytes(pixels: Pixels<'_>, shape: Shape) -> std::result::Result<Vec<u8>, Problem> {
    let mut bytes = Vec::new();
    encode(&mut bytes, pixels, shape, None, Compression::Fast)?;
    Ok(bytes)
}

fn encode(
    writer: impl Write,
    pixels: Pixels<'_>,
    shape: Shape,
    profile: Option<&[u8]>,
    compression: Compression,
) -> std::result::Result<(), Problem> {
    let (width, height) = shape.size_u32()?;
    let mut info = Info::with_size(width, height);
    info.icc_profile = profile.map(Cow::Borrowed);
    let mut encoder = Encoder::with_info(writer, info)?;
    encoder.set_color(match shape.channels {
        1 => ColorType::Grayscale,
        2 => ColorType::GrayscaleAlpha,
        3 => ColorType::Rgb,
        4 => ColorType::Rgba,
        n => return Err(Problem::Argument(format!("PNG holds 1 to 4 channels, not {n}"))),
    });
    encoder.set_compression(compression);
    // A file has one of the two.
    if profile.is_none() {
        encoder.set_source_srgb(::png::SrgbRenderingIntent::Perceptual);
    }
    match pixels {
        Pixels::U8(samples) => {
            encoder.set_depth(BitDepth::Eight);
            let mut image = encoder.write_header()?;
            image.write_image_data(samples)?;
            image.finish()?;
        }
        Pixels::U16(samples) => {
            encoder.set_depth(BitDepth::Sixteen);
            let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_be_bytes()).collect();
            let mut image = encoder.write_header()?;
            image.write_image_data(&bytes)?;
            image.finish()?;
        }
        Pixels::F32(_) => {
            return Err(Problem::Argument("PNG holds 8- and 16-bit integers, not floats".into()));
        }
    }
    Ok(())
}

impl From<EncodingError> for Problem {
    fn from(error: EncodingError) -> Self {
        match error {
            EncodingError::IoError(error) => error.into(),
            other => Self::Argument(other.to_string()),
        }
    }
}
