//! Writes parts of named channels as scan lines.

use super::parallel::for_each_parallel;
use super::read::Attributes;
use crate::files::atomic;
use crate::files::error::{Problem, Result};
use ::exr::block::chunk::Chunk;
use ::exr::block::writer::ChunksWriter;
use ::exr::block::{BlockIndex, UncompressedBlock, enumerate_ordered_header_block_indices};
use ::exr::math::Vec2;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{ChannelDescription, Compression, LineOrder, SampleType, Text};
use ::exr::meta::header::{Header, ImageAttributes, LayerAttributes, standard_names};
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
    /// The part of another file whose attributes it has, if it has such.
    pub like: usize,
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

/// The attributes of another file's parts, and where parts begin in its display window.
pub type Kept<'a> = (&'a [Attributes], Option<(i32, i32)>);

/// Writes a file of one or more parts; with the attributes of another file's parts if they are given, and where the parts
/// begin in that one's display window.
pub fn write(
    path: &Path,
    mut layers: Vec<Layer<'_>>,
    compression: Compression,
    attributes: Option<Kept>,
) -> Result<()> {
    atomic::replace(path, |writer| {
        for layer in &mut layers {
            // The format requires channels to be sorted by the bytes of their names.
            layer.channels.sort_by(|a, b| a.name.as_bytes().cmp(b.name.as_bytes()));
        }
        let mut headers = headers(&layers, compression)?;
        if let Some((attributes, corner)) = attributes {
            for (header, layer) in headers.iter_mut().zip(&layers) {
                let own = attributes.get(layer.like).ok_or_else(|| {
                    Problem::Argument(format!("there is no part {} to take attributes from", layer.like))
                })?;
                own.set(header, corner);
            }
        }
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

impl Attributes {
    /// Gives a new part these attributes, but for those that only the old pixels had.
    ///
    /// Where the part begins in the old display window is given by `corner`; without it, the part has a display window of
    /// its own.
    fn set(&self, header: &mut Header, corner: Option<(i32, i32)>) {
        let display_window = match corner {
            Some(_) => self.shared.display_window,
            None => header.shared_attributes.display_window,
        };
        let (x, y) = corner.unwrap_or_default();
        header.shared_attributes =
            ImageAttributes { display_window, pixel_aspect: self.pixel_aspect(), ..self.shared.clone() };
        header.own_attributes = LayerAttributes {
            layer_name: header.own_attributes.layer_name.take(),
            layer_position: Vec2(x, y),
            screen_window_width: self.own.screen_window_width.max(0.0),
            // A small picture of the old pixels, and names of channels that are not here.
            preview: None,
            multi_view_names: None,
            view_name: None,
            deep_image_state: None,
            original_data_window: None,
            ..self.own.clone()
        };
        // What cannot be written is left out: a standard name with another type, as some programs write it, a name that is
        // there twice, and values that the format does not allow.
        let data_window = header.data_window();
        let is_standard = |name: &Text| standard_names::ALL.contains(&name.as_slice());
        let (shared, own) = (&mut header.shared_attributes.other, &mut header.own_attributes.other);
        shared.retain(|name, value| !is_standard(name) && value.validate(false, data_window, true).is_ok());
        own.retain(|name, value| {
            !is_standard(name)
                && !shared.contains_key(name)
                && value.validate(false, data_window, true).is_ok()
        });
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
