//! Portable float maps: three lines of text, then floats, rows from bottom to top.

use super::atomic;
use super::error::{Problem, Result};
use super::raster::{Alpha, Beside, Raster, Samples, Shape};
use super::source::{Source, check_claim};
use std::io::{BufRead, Read, Write};
use std::path::Path;

/// The length of the longest number in a PFM header; a file without white space is not a PFM file.
const LONGEST_WORD: usize = 32;

pub(super) fn read(mut source: Source) -> std::result::Result<Raster, Problem> {
    let reader = &mut source.reader;
    let mut header_length = 0;
    let mut word = || {
        let (word, read) = next_word(reader)?;
        header_length += read as u64;
        Ok::<_, Problem>(word)
    };
    let channels = match word()?.as_str() {
        "PF" => 3,
        "Pf" => 1,
        other => {
            return Err(Problem::Unsupported {
                found: format!("a PFM header \"{other}\""),
                accepted: "PF (colour) and Pf (grey)",
            });
        }
    };
    let width: usize = number(&word()?, "width")?;
    let height: usize = number(&word()?, "height")?;
    let scale: f64 = number(&word()?, "scale")?;
    if width == 0 || height == 0 || scale == 0.0 || !scale.is_finite() {
        return Err(Problem::Damaged(format!("width {width}, height {height}, scale {scale}")));
    }

    // The floats are stored uncompressed, so the size must match exactly.
    let count = (width as u128) * (height as u128) * channels as u128;
    check_claim(count * 4, source.length)?;
    if count * 4 > u128::from(source.length - header_length) {
        return Err(Problem::Oversized { claimed: count * 4, length: source.length });
    }
    let row = width * channels;
    let mut bytes = vec![0; row * 4];
    let mut samples = vec![0.0; row * height];
    for samples in samples.chunks_exact_mut(row).rev() {
        reader.read_exact(&mut bytes)?;
        for (sample, bytes) in samples.iter_mut().zip(bytes.as_chunks().0) {
            *sample = if scale < 0.0 { f32::from_le_bytes(*bytes) } else { f32::from_be_bytes(*bytes) };
        }
    }
    Ok(Raster {
        width,
        height,
        channels,
        alpha: Alpha::None,
        samples: Samples::F32(samples),
        beside: Beside::default(),
    })
}

/// The next word and the number of bytes read, including the one white space after it.
fn next_word(reader: &mut impl BufRead) -> std::result::Result<(String, usize), Problem> {
    let (mut word, mut read) = (String::new(), 0);
    for byte in reader.bytes() {
        let byte = byte?;
        read += 1;
        if byte == b'\r' {
            return Err(Problem::Damaged(
                "its lines end in CR LF, as after a transfer as text, which changes the floats too".into(),
            ));
        }
        match (byte.is_ascii_whitespace(), word.is_empty()) {
            (true, true) => (),
            (true, false) => return Ok((word, read)),
            (false, _) => word.push(char::from(byte)),
        }
        if word.len() > LONGEST_WORD {
            break;
        }
    }
    Err(Problem::Damaged("the PFM header is not four words".into()))
}

fn number<T: std::str::FromStr>(word: &str, name: &str) -> std::result::Result<T, Problem> {
    word.parse().map_err(|_| Problem::Damaged(format!("the PFM header gives \"{word}\" as its {name}")))
}

/// Writes 1 or 3 channels of floats, little-endian.
pub fn write(path: &Path, pixels: &[f32], shape: Shape) -> Result<()> {
    atomic::replace(path, |writer| {
        shape.size_u32()?;
        let magic = match shape.channels {
            1 => "Pf",
            3 => "PF",
            n => return Err(Problem::Argument(format!("PFM holds 1 or 3 channels, not {n}"))),
        };
        write!(writer, "{magic}\n{} {}\n-1.0\n", shape.width, shape.height)?;
        for row in pixels.chunks_exact(shape.width * shape.channels).rev() {
            for sample in row {
                writer.write_all(&sample.to_le_bytes())?;
            }
        }
        Ok(())
    })
}
