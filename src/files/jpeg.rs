//! JPEG, read strictly: what is missing is not made up.
//!
//! A decoder that shows pictures paints grey where the data end, and goes on after data that make no sense. Here both
//! are errors. JPEG has no checksum, so that a changed byte whose codes still make sense cannot be told from a picture.

use super::error::Problem;
use super::raster::{Alpha, Beside, Raster, Samples};
use super::source::{Source, check_claim};
use image::metadata::Orientation;
use std::io::Read;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

pub(super) fn read(mut source: Source) -> Result<Raster, Problem> {
    let mut bytes = Vec::new();
    source.reader.read_to_end(&mut bytes)?;
    check_end(&bytes)?;

    // Headers may have bytes between them that mean nothing; the picture itself may not.
    let sides = DecoderOptions::default().set_max_width(usize::MAX).set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&bytes), sides.set_strict_mode(false));
    decoder.decode_headers()?;
    let exif = decoder.exif().cloned();
    let orientation = exif.as_ref().and_then(|exif| Orientation::from_exif_chunk(exif));
    let orientation = orientation.unwrap_or(Orientation::NoTransforms).to_exif();
    let beside = Beside { profile: decoder.icc_profile(), exif, orientation };
    let (Some((width, height)), Some(stored)) = (decoder.dimensions(), decoder.input_colorspace()) else {
        return Err(Problem::Damaged("there is no picture in it".into()));
    };
    let (space, channels) = match stored {
        ColorSpace::Luma => (ColorSpace::Luma, 1),
        _ => (ColorSpace::RGB, 3),
    };
    let count = width as u128 * height as u128 * channels as u128;
    check_claim(count, source.length)?;
    let mut samples = vec![0; width * height * channels];
    decoder.set_options(sides.set_strict_mode(true).jpeg_set_out_colorspace(space));
    decoder.decode_into(&mut samples)?;
    Ok(Raster { width, height, channels, alpha: Alpha::None, samples: Samples::U8(samples), beside })
}

/// Refuses a file that stops before the marker that ends its picture.
fn check_end(bytes: &[u8]) -> Result<(), Problem> {
    const END: u8 = 0xd9;
    let cut = || Problem::Damaged("it ends too early".into());
    // The first marker begins the picture, and has no segment.
    let mut at = 2;
    loop {
        // A marker is 0xff and a byte. Coded data have 0xff before a zero and in restarts; more of them are filling.
        let rest = bytes.get(at..).ok_or_else(cut)?;
        at += rest.iter().position(|&byte| byte == 0xff).ok_or_else(cut)? + 1;
        match *bytes.get(at).ok_or_else(cut)? {
            END => return Ok(()),
            0x00 | 0x01 | 0xd0..=0xd8 | 0xff => (),
            _ => match bytes.get(at + 1..at + 3) {
                Some(&[high, low]) => at += 1 + usize::from(u16::from_be_bytes([high, low])),
                _ => return Err(cut()),
            },
        }
    }
}

impl From<DecodeErrors> for Problem {
    fn from(error: DecodeErrors) -> Self {
        match error {
            DecodeErrors::Unsupported(what) => Self::Unsupported {
                found: format!("{what:?}"),
                accepted: "baseline and progressive JPEG of 8 bits, coded by Huffman",
            },
            DecodeErrors::ExhaustedData => Self::Damaged("it ends too early".into()),
            other => Self::Damaged(format!("{other:?}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_is_found_behind_segments_and_coded_data() {
        // A thumbnail in a segment has an end of its own.
        let whole = b"\xff\xd8\xff\xe1\0\x06\xff\xd8\xff\xd9\xff\xda\0\x02data\xff\0\xff\xd3data\xff\xff\xd9";
        assert!(check_end(whole).is_ok());
        for length in 0..whole.len() {
            assert!(check_end(&whole[..length]).is_err(), "{length}");
        }
    }
}
