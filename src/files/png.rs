//! PNG with 8 and 16 bits a sample.

use super::{Alpha, Pixels, Problem, Raster, Result, Samples, Shape, Source, atomic, check_claim};
use ::png::{BitDepth, ColorType, Decoder, DecodingError, Encoder, EncodingError, Limits, Transformations};
use std::path::Path;

pub(super) fn read(source: Source) -> std::result::Result<Raster, Problem> {
    let length = source.length;
    let mut decoder = Decoder::new(source.reader);
    // Palettes, one to four bits and transparent colours become whole channels; 16 bits stay 16.
    decoder.set_transformations(Transformations::EXPAND);
    let info = decoder.read_header_info()?;
    let (width, height) = (info.width as usize, info.height as usize);
    let claimed = width as u128 * height as u128 * 8;
    check_claim(claimed, length)?;
    // The claim is plausible by now; the decoder's own bound must not be the tighter one.
    decoder.set_limits(Limits { bytes: usize::MAX });

    let mut reader = decoder.read_info()?;
    let (color, depth) = reader.output_color_type();
    let size = reader
        .output_buffer_size()
        .ok_or_else(|| Problem::Damaged("its size does not fit into memory".into()))?;
    let mut bytes = vec![0; size];
    reader.next_frame(&mut bytes)?;

    let (channels, alpha) = match color {
        ColorType::Grayscale => (1, Alpha::None),
        ColorType::GrayscaleAlpha => (2, Alpha::Straight),
        ColorType::Rgb => (3, Alpha::None),
        ColorType::Rgba => (4, Alpha::Straight),
        ColorType::Indexed => return Err(Problem::Damaged("its palette is missing".into())),
    };
    let samples = match depth {
        BitDepth::Sixteen => {
            Samples::U16(bytes.as_chunks().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect())
        }
        _ => Samples::U8(bytes),
    };
    Ok(Raster { width, height, channels, alpha, samples })
}

/// Writes 1 to 4 channels of 8 or 16 bits, marked as sRGB, alpha straight.
pub fn write(path: &Path, pixels: Pixels<'_>, shape: Shape) -> Result<()> {
    atomic::replace(path, |writer| {
        let (width, height) = shape.size_u32()?;
        let mut encoder = Encoder::new(writer, width, height);
        encoder.set_color(match shape.channels {
            1 => ColorType::Grayscale,
            2 => ColorType::GrayscaleAlpha,
            3 => ColorType::Rgb,
            4 => ColorType::Rgba,
            n => return Err(Problem::Argument(format!("PNG holds 1 to 4 channels, not {n}"))),
        });
        encoder.set_source_srgb(::png::SrgbRenderingIntent::Perceptual);
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
    })
}

impl From<DecodingError> for Problem {
    fn from(error: DecodingError) -> Self {
        match error {
            DecodingError::IoError(error) => error.into(),
            other => Self::Damaged(other.to_string()),
        }
    }
}

impl From<EncodingError> for Problem {
    fn from(error: EncodingError) -> Self {
        match error {
            EncodingError::IoError(error) => error.into(),
            other => Self::Argument(other.to_string()),
        }
    }
}
