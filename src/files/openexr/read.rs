//! Reads selected channels of one part.

use super::parallel::for_each_parallel;
use crate::files::error::{Problem, Result};
use crate::files::raster::{Alpha, Beside, Raster, Samples};
use crate::files::source::{check_claim, open, with_path};
use ::exr::block::UncompressedBlock;
use ::exr::block::chunk::{Chunk, CompressedBlock};
use ::exr::compression::Compression;
use ::exr::math::Vec2;
use ::exr::meta::MetaData;
use ::exr::meta::attribute::{IntegerBounds, SampleType, Text};
use ::exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use half::f16;
use std::collections::HashSet;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: i32,
    /// First row.
    pub y: i32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl From<IntegerBounds> for Window {
    fn from(bounds: IntegerBounds) -> Self {
        let Vec2(x, y) = bounds.position;
        let Vec2(width, height) = bounds.size;
        Self { x, y, width, height }
    }
}

/// The description of one of a file's parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its name; the only part of a file needs none.
    pub name: Option<String>,
    /// The names of its channels, sorted by the format.
    pub channels: Vec<String>,
    /// The types of their samples: "half", "float" or "uint".
    pub sample_types: Vec<&'static str>,
    /// The pixels that are stored.
    pub data_window: Window,
    /// The pixels that are meant to be seen.
    pub display_window: Window,
    /// The width of a pixel over its height, on a screen that shows the picture undistorted.
    pub pixel_aspect: f32,
}

/// What a file says beside its pixels: windows, chromaticities, comments, and what programs added of their own.
#[derive(Clone)]
pub struct Attributes {
    pub(super) shared: ImageAttributes,
    pub(super) own: LayerAttributes,
}

/// The rectangle of pixels that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// The display window: stored pixels outside it are left out, and missing pixels are filled.
    Display,
    /// The data window: all stored pixels.
    Data,
}

impl Attributes {
    /// The width of a pixel over its height.
    pub(super) fn pixel_aspect(&self) -> f32 {
        pixel_aspect(self.shared.pixel_aspect)
    }
}

/// The aspect that a file claims for its pixels; 1 for what the format does not allow.
fn pixel_aspect(claimed: f32) -> f32 {
    if (1e-6..=1e6).contains(&claimed) { claimed } else { 1.0 }
}

/// Lists the parts of a file.
pub fn parts(path: &Path) -> Result<Vec<Part>> {
    with_path(path, || {
        let reader = ::exr::block::read(open(path)?.reader, false)?;
        Ok(reader.headers().iter().map(Part::of).collect())
    })
}

/// Describes the first deep part that has a channel of the name `needed`, with its number; `None` if there is none.
pub fn deep_part(path: &Path, needed: &str) -> Result<Option<(usize, Part)>> {
    with_path(path, || {
        let headers = MetaData::read_from_unbuffered(open(path)?.reader, false)?.headers;
        let deep = headers.iter().enumerate().filter(|(_, header)| header.deep);
        let mut parts = deep.map(|(number, header)| (number, Part::of(header)));
        Ok(parts.find(|(_, part)| part.channels.iter().any(|name| name == needed)))
    })
}

impl Part {
    fn of(header: &Header) -> Part {
        let channels = &header.channels.list;
        Part {
            name: header.own_attributes.layer_name.as_ref().map(text),
            channels: channels.iter().map(|channel| text(&channel.name)).collect(),
            sample_types: channels.iter().map(|channel| name_of(channel.sample_type)).collect(),
            data_window: header.data_window().into(),
            display_window: header.shared_attributes.display_window.into(),
            pixel_aspect: pixel_aspect(header.shared_attributes.pixel_aspect),
        }
    }
}

fn name_of(sample_type: SampleType) -> &'static str {
    match sample_type {
        SampleType::F16 => "half",
        SampleType::F32 => "float",
        SampleType::U32 => "uint",
    }
}

/// Reads what each part of a file says beside its pixels.
pub fn attributes(path: &Path) -> Result<Vec<Attributes>> {
    with_path(path, || {
        let of = |header: &Header| Attributes {
            shared: header.shared_attributes.clone(),
            own: header.own_attributes.clone(),
        };
        // Flat files are read as their pixels are, which also checks what they say; deep ones cannot be.
        let meta = MetaData::read_from_unbuffered(open(path)?.reader, false)?;
        if meta.requirements.has_deep_data {
            return Ok(meta.headers.iter().map(of).collect());
        }
        let reader = ::exr::block::read(open(path)?.reader, false)?;
        Ok(reader.headers().iter().map(of).collect())
    })
}

/// Reads channels of one part as floats, interleaved in the given order.
///
/// Half samples are represented exactly, unsigned ones up to 2^24. Pixels of the display window that the file does
/// not store become `fill`.
pub fn read(path: &Path, part: usize, channels: &[String], view: View, fill: f32) -> Result<Raster> {
    with_path(path, || {
        let source = open(path)?;
        let length = source.length;
        let reader = ::exr::block::read(source.reader, false)?;
        let header = reader
            .headers()
            .get(part)
            .ok_or_else(|| Problem::Argument(format!("there is no part {part}")))?
            .clone();
        let layout = Layout::new(&header, channels)?;
        let data = Window::from(header.data_window());
        let frame = match view {
            View::Display => Window::from(header.shared_attributes.display_window),
            View::Data => data,
        };
        let stored = area(data) * layout.bytes_per_pixel as u128;
        let wanted = area(frame) * channels.len() as u128 * 4;
        check_claim(stored.max(wanted), length)?;

        let chunks = reader
            .filter_chunks(false, |_, tile, block| block.layer == part && tile.level_index == Vec2(0, 0))?;
        let count = chunks.len();
        let meta = ::exr::block::reader::ChunksReader::meta_data(&chunks).clone();
        let chunks = Mutex::new(chunks);
        let picture = Mutex::new(Picture {
            data,
            frame,
            channels: channels.len(),
            samples: vec![fill; frame.width * frame.height * channels.len()],
            seen: HashSet::with_capacity(count),
        });
        for_each_parallel(count, |_| {
            let Some(chunk) = lock(&chunks).next() else {
                return Err(Problem::Damaged("blocks of pixels are missing".into()));
            };
            let chunk = chunk?;
            check_dwa(&chunk, &header)?;
            let block = UncompressedBlock::decompress_chunk(chunk, &meta, false)?;
            if block.index.layer != part || block.index.level != Vec2(0, 0) {
                return Err(Problem::Damaged("a block of pixels is not where the file says".into()));
            }
            lock(&picture).insert(&block, &layout)
        })?;
        let picture = picture.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(Raster {
            width: frame.width,
            height: frame.height,
            channels: channels.len(),
            alpha: Alpha::Premultiplied,
            samples: Samples::F32(picture.samples),
            beside: Beside::default(),
        })
    })
}

/// Refuses sizes inside a DWA block that are larger than its pixels can need.
///
/// Such a block begins with eleven 64-bit numbers: a version, then sizes. The decoder trusts all of them when it
/// allocates memory. Blocks are encoded in squares of 8 x 8 samples, so even a single pixel may need 64.
fn check_dwa(chunk: &Chunk, header: &Header) -> std::result::Result<(), Problem> {
    const NUMBERS: usize = 11;
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => return Ok(()),
    };
    let tile = header.get_block_data_indices(&chunk.compressed_block)?;
    let section = Window::from(header.get_absolute_block_pixel_coordinates(tile)?);
    if bytes.len() as u128 == area(section) * header.channels.bytes_per_pixel as u128 {
        // A block that compression would not have made shorter is stored uncompressed.
        return Ok(());
    }
    let most = 64 * header.max_block_byte_size() as u64 + 4096;
    match bytes.as_chunks().0.iter().take(NUMBERS).find(|number| u64::from_le_bytes(**number) > most) {
        Some(_) => Err(Problem::Damaged("a DWA block claims more than its pixels need".into())),
        None => Ok(()),
    }
}

/// A thread that panicked has already made the call fail; the other threads only have to end.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn area(window: Window) -> u128 {
    window.width as u128 * window.height as u128
}

/// The format stores bytes; names in other alphabets are UTF-8 by custom.
fn text(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

/// The positions of the wanted channels in a row of a block, which holds one channel after another.
struct Layout {
    /// For each wanted channel: bytes per pixel of all channels before it, and its type.
    wanted: Vec<(usize, SampleType)>,
    bytes_per_pixel: usize,
}

impl Layout {
    fn new(header: &Header, names: &[String]) -> std::result::Result<Self, Problem> {
        let list = &header.channels.list;
        let wanted = names
            .iter()
            .map(|name| {
                let index = list
                    .iter()
                    .position(|channel| text(&channel.name) == *name)
                    .ok_or_else(|| Problem::Argument(format!("there is no channel {name:?}")))?;
                let before = list[..index].iter().map(|c| c.sample_type.bytes_per_sample()).sum();
                Ok((before, list[index].sample_type))
            })
            .collect::<std::result::Result<_, Problem>>()?;
        Ok(Self { wanted, bytes_per_pixel: header.channels.bytes_per_pixel })
    }
}

/// The picture while its blocks are read.
struct Picture {
    data: Window,
    frame: Window,
    channels: usize,
    samples: Vec<f32>,
    seen: HashSet<Vec2<usize>>,
}

impl Picture {
    fn insert(&mut self, block: &UncompressedBlock, layout: &Layout) -> std::result::Result<(), Problem> {
        if !self.seen.insert(block.index.pixel_position) {
            return Err(Problem::Damaged("a block of pixels is stored twice, another one never".into()));
        }
        let Vec2(columns, _) = block.index.pixel_size;
        // Top left of the block in the frame. Windows are 32-bit, so 64 bits hold every difference.
        let left = i64::from(self.data.x) - i64::from(self.frame.x) + block.index.pixel_position.x() as i64;
        let top = i64::from(self.data.y) - i64::from(self.frame.y) + block.index.pixel_position.y() as i64;
        let first = (-left).clamp(0, columns as i64) as usize;
        let last = (self.frame.width as i64 - left).clamp(first as i64, columns as i64) as usize;

        for (row, bytes) in block.data.chunks_exact(columns * layout.bytes_per_pixel).enumerate() {
            let y = top + row as i64;
            if first == last || y < 0 || y >= self.frame.height as i64 {
                continue;
            }
            let x = (left + first as i64) as usize;
            let start = (y as usize * self.frame.width + x) * self.channels;
            let pixels = &mut self.samples[start..start + (last - first) * self.channels];
            for (channel, &(before, kind)) in layout.wanted.iter().enumerate() {
                let size = kind.bytes_per_sample();
                let bytes = &bytes[columns * before..][first * size..last * size];
                let pixels = pixels[channel..].iter_mut().step_by(self.channels);
                match kind {
                    SampleType::F16 => fill(pixels, bytes, |b| f16::from_ne_bytes(b).to_f32()),
                    SampleType::F32 => fill(pixels, bytes, f32::from_ne_bytes),
                    SampleType::U32 => fill(pixels, bytes, |b| u32::from_ne_bytes(b) as f32),
                }
            }
        }
        Ok(())
    }
}

fn fill<'a, const N: usize>(
    pixels: impl Iterator<Item = &'a mut f32>,
    bytes: &[u8],
    value: impl Fn([u8; N]) -> f32,
) {
    for (pixel, bytes) in pixels.zip(bytes.as_chunks().0) {
        *pixel = value(*bytes);
    }
}
