//! Writes parts of named channels as scan lines.

use super::parallel::for_each_parallel;
use crate::files::atomic;
use crate::files::error::{Problem, Result};
use ::exr::block::chunk::Chunk;
use ::exr::block::writer::ChunksWriter;
use ::exr::block::{BlockIndex, UncompressedBlock, enumerate_ordered_header_block_indices};
use ::exr::math::Vec2;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{ChannelDescription, Compression, LineOrder, SampleType, Text};
use ::exr::meta::header::{Header, ImageAttributes};
use half::f16;
use std::path::Path;
use std::sync::OnceLock;

/// Borrowed samples of one channel.
#[derive(Clone, Copy, Debug)]
pub enum Values<'a> {
    /// Half floats.
    F16(&'a [f16]),
    /// Floats.
    F32(&'a [f32]),
    /// 32-bit integers.
    U32(&'a [u32]),
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Self::F16(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::U32(v) => v.len(),
        }
    }
}

/// One channel of a part.
#[derive(Clone, Debug)]
pub struct Channel<'a> {
    /// Its full name, including the names of its layers, separated by dots.
    pub name: String,
    /// Its samples, rows from top to bottom.
    pub values: Values<'a>,
}

/// One part of a file.
#[derive(Clone, Debug)]
pub struct Layer<'a> {
    /// Its name; required if there is more than one part.
    pub name: Option<String>,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Its channels, in any order.
    pub channels: Vec<Channel<'a>>,
}

/// The lossless compression with this name.
pub fn compression(name: &str) -> std::result::Result<Compression, Problem> {
    match name {
        "none" => Ok(Compression::Uncompressed),
        "rle" => Ok(Compression::RLE),
        "zips" => Ok(Compression::ZIP1),
        "zip" => Ok(Compression::ZIP16),
        "piz" => Ok(Compression::PIZ),
        _ => Err(Problem::Argument(format!(
            "compression {name:?} is not one of \"none\", \"rle\", \"zips\", \"zip\", \"piz\""
        ))),
    }
}

/// Writes a file of one or more parts.
pub fn write(path: &Path, mut layers: Vec<Layer<'_>>, compression: Compression) -> Result<()> {
    atomic::replace(path, |writer| {
        for layer in &mut layers {
            // The format requires channels to be sorted by the bytes of their names.
            layer.channels.sort_by(|a, b| a.name.as_bytes().cmp(b.name.as_bytes()));
        }
        let headers = headers(&layers, compression)?;
        let blocks: Vec<_> = enumerate_ordered_header_block_indices(&headers).collect();
        let coded: Vec<OnceLock<Chunk>> = blocks.iter().map(|_| OnceLock::new()).collect();
        for_each_parallel(blocks.len(), |i| {
            let index = blocks[i].1;
            let data = layers[index.layer].bytes(index);
            let chunk = UncompressedBlock { index, data }.compress_to_chunk(&headers)?;
            coded[i].get_or_init(|| chunk);
            Ok(())
        })?;

        ::exr::block::write(writer, headers.into(), true, |_, writer| {
            for ((index, _), chunk) in blocks.into_iter().zip(coded) {
                if let Some(chunk) = chunk.into_inner() {
                    writer.write_chunk(index, chunk)?;
                }
            }
            Ok(())
        })?;
        Ok(())
    })
}

impl Layer<'_> {
    /// The samples of a block of whole rows; each row holds one channel after another.
    fn bytes(&self, index: BlockIndex) -> Vec<u8> {
        let top = index.pixel_position.y();
        let mut bytes = Vec::new();
        for y in top..top + index.pixel_size.height() {
            let row = y * self.width..(y + 1) * self.width;
            for channel in &self.channels {
                match channel.values {
                    Values::F16(v) => bytes.extend(v[row.clone()].iter().flat_map(|v| v.to_ne_bytes())),
                    Values::F32(v) => bytes.extend(v[row.clone()].iter().flat_map(|v| v.to_ne_bytes())),
                    Values::U32(v) => bytes.extend(v[row.clone()].iter().flat_map(|v| v.to_ne_bytes())),
                }
            }
        }
        bytes
    }
}

fn headers(layers: &[Layer<'_>], compression: Compression) -> std::result::Result<Vec<Header>, Problem> {
    let first = layers.first().ok_or_else(|| Problem::Argument("there is no part to write".into()))?;
    layers
        .iter()
        .map(|layer| {
            if layer.width == 0 || layer.height == 0 {
                return Err(Problem::Argument("an image without pixels cannot be written".into()));
            }
            if layer.channels.iter().any(|channel| channel.values.len() != layer.width * layer.height) {
                return Err(Problem::Argument("the channels of a part differ in size".into()));
            }
            let channels =
                layer.channels.iter().map(describe).collect::<std::result::Result<_, Problem>>()?;
            let name = layer.name.as_deref().map(ascii).transpose()?;
            let mut header = Header::new(Text::default(), Vec2(layer.width, layer.height), channels)
                .with_encoding(compression, BlockDescription::ScanLines, LineOrder::Increasing)
                // All parts of a file share one display window.
                .with_shared_attributes(ImageAttributes::with_size(Vec2(first.width, first.height)));
            header.own_attributes.layer_name = name;
            Ok(header)
        })
        .collect()
}

fn describe(channel: &Channel<'_>) -> std::result::Result<ChannelDescription, Problem> {
    Ok(ChannelDescription {
        name: ascii(&channel.name)?,
        sample_type: match channel.values {
            Values::F16(_) => SampleType::F16,
            Values::F32(_) => SampleType::F32,
            Values::U32(_) => SampleType::U32,
        },
        // Tells lossy codecs how to quantise; these are lossless.
        quantize_linearly: false,
        sampling: Vec2(1, 1),
    })
}

fn ascii(name: &str) -> std::result::Result<Text, Problem> {
    match Text::new_or_none(name) {
        Some(text) if name.is_ascii() && !name.is_empty() => Ok(text),
        _ => Err(Problem::Argument(format!("the name {name:?} is not plain ASCII"))),
    }
}
