//! TIFF with integer and float samples.

use super::atomic;
use super::error::{Problem, Result};
use super::raster::{Alpha, Beside, Pixels, Raster, Samples, Shape};
use super::source::{Source, check_claim};
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::encoder::colortype::{
    ColorType as Encoding, Gray8, Gray16, Gray32Float, RGB8, RGB16, RGB32Float,
};
use ::tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffValue};
use ::tiff::tags::{ExtraSamples, Tag};
use ::tiff::{ColorType, TiffError};
use std::io::{Seek, Write};
use std::path::Path;

const ACCEPTED: &str = "grey, grey with alpha, RGB and RGBA TIFF, samples of 8, 16 or 32 bits unsigned or 16, \
                        32 or 64 bits float";

/// Reads the first picture of a file.
pub(super) fn read(source: Source) -> std::result::Result<Raster, Problem> {
    let length = source.length;
    let mut decoder = Decoder::new(source.reader)?;
    let (width, height) = decoder.dimensions()?;
    let (width, height) = (width as usize, height as usize);
    let color = decoder.colortype()?;
    let refuse = |found: String| Problem::Unsupported { found, accepted: ACCEPTED };

    let beside = Beside {
        profile: match decoder.find_tag(Tag::IccProfile)? {
            Some(bytes) => Some(bytes.into_u8_vec()?),
            None => None,
        },
        exif: None,
        orientation: decoder.find_tag_unsigned::<u8>(Tag::Orientation)?.unwrap_or(1),
    };
    let channels = match color {
        ColorType::Gray(_) => 1,
        ColorType::GrayA(_) => 2,
        ColorType::RGB(_) => 3,
        ColorType::RGBA(_) => 4,
        ColorType::Multiband { num_samples: n @ 1..=4, .. } => usize::from(n),
        other => return Err(refuse(format!("{other:?}"))),
    };
    let bits = color.bit_depth();
    if !bits.is_multiple_of(8) {
        // The decoder does not unpack such samples.
        return Err(refuse(format!("samples of {bits} bits")));
    }
    let claimed = decoder.image_buffer_layout()?.complete_len;
    check_claim(claimed as u128, length)?;
    // The claim has been checked by now; the decoder's own limit must not be the tighter one.
    let mut limits = Limits::default();
    limits.decoding_buffer_size = claimed;
    limits.intermediate_buffer_size = claimed.max(limits.intermediate_buffer_size);
    let mut decoder = decoder.with_limits(limits);

    let mut decoded = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut decoded)?;
    let planes = layout.planes;
    let samples = match decoded {
        DecodingResult::U8(v) => Samples::U8(interleave(v, planes)),
        DecodingResult::U16(v) => Samples::U16(interleave(v, planes)),
        DecodingResult::U32(v) => Samples::U32(interleave(v, planes)),
        DecodingResult::F16(v) => Samples::F16(interleave(v, planes)),
        DecodingResult::F32(v) => Samples::F32(interleave(v, planes)),
        DecodingResult::F64(v) => Samples::F64(interleave(v, planes)),
        DecodingResult::U64(_) => return Err(refuse("64-bit integers".into())),
        DecodingResult::I8(_) | DecodingResult::I16(_) | DecodingResult::I32(_) | DecodingResult::I64(_) => {
            return Err(refuse("signed integers".into()));
        }
    };
    let alpha = match (channels, extra_samples(&mut decoder)?) {
        (2 | 4, Some(kind)) if kind == ExtraSamples::AssociatedAlpha.to_u16() => Alpha::Premultiplied,
        (2 | 4, _) => Alpha::Straight,
        _ => Alpha::None,
    };
    Ok(Raster { width, height, channels, alpha, samples, beside })
}

fn extra_samples<R: std::io::Read + Seek>(
    decoder: &mut Decoder<R>,
) -> std::result::Result<Option<u16>, Problem> {
    let kinds = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples)?;
    Ok(kinds.and_then(|kinds| kinds.first().copied()))
}

/// Interleaves planes that follow one another.
fn interleave<T: Copy>(samples: Vec<T>, planes: usize) -> Vec<T> {
    if planes < 2 {
        return samples;
    }
    let area = samples.len() / planes;
    (0..area).flat_map(|i| (0..planes).map(move |plane| plane * area + i)).map(|i| samples[i]).collect()
}

/// Writes 1 to 4 channels, compressed with deflate, and the profile that they are in.
pub fn write(
    path: &Path,
    pixels: Pixels<'_>,
    shape: Shape,
    alpha: Alpha,
    profile: Option<&[u8]>,
) -> Result<()> {
    atomic::replace(path, |writer| match (pixels, shape.channels) {
        (Pixels::U8(v), 1 | 2) => encode::<_, Gray8>(writer, v, shape, alpha, profile),
        (Pixels::U8(v), 3 | 4) => encode::<_, RGB8>(writer, v, shape, alpha, profile),
        (Pixels::U16(v), 1 | 2) => encode::<_, Gray16>(writer, v, shape, alpha, profile),
        (Pixels::U16(v), 3 | 4) => encode::<_, RGB16>(writer, v, shape, alpha, profile),
        (Pixels::F32(v), 1 | 2) => encode::<_, Gray32Float>(writer, v, shape, alpha, profile),
        (Pixels::F32(v), 3 | 4) => encode::<_, RGB32Float>(writer, v, shape, alpha, profile),
        (_, n) => Err(Problem::Argument(format!("TIFF holds 1 to 4 channels here, not {n}"))),
    })
}

fn encode<W: Write + Seek, C: Encoding>(
    writer: W,
    samples: &[C::Inner],
    shape: Shape,
    alpha: Alpha,
    profile: Option<&[u8]>,
) -> std::result::Result<(), Problem>
where
    [C::Inner]: TiffValue,
{
    let (width, height) = shape.size_u32()?;
    let mut encoder = TiffEncoder::new(writer)?.with_compression(Compression::Deflate(DeflateLevel::Fast));
    let mut image = encoder.new_image::<C>(width, height)?;
    if let Some(profile) = profile {
        image.encoder().write_tag(Tag::IccProfile, profile)?;
    }
    if shape.channels.is_multiple_of(2) {
        image.extra_samples(&[match alpha {
            Alpha::Premultiplied => ExtraSamples::AssociatedAlpha,
            Alpha::Straight => ExtraSamples::UnassociatedAlpha,
            Alpha::None => ExtraSamples::Unspecified,
        }])?;
    }
    image.write_data(samples)?;
    Ok(())
}

impl From<TiffError> for Problem {
    fn from(error: TiffError) -> Self {
        match error {
            TiffError::IoError(error) => error.into(),
            TiffError::UnsupportedError(what) => {
                Self::Unsupported { found: what.to_string(), accepted: ACCEPTED }
            }
            other => Self::Damaged(other.to_string()),
        }
    }
}
