//! The headers of files with deep parts.

use super::read::Window;
use crate::files::error::Problem;

type Result<T> = std::result::Result<T, Problem>;

/// Bits of the version field.
const TILED: u32 = 1 << 9;
const SEVERAL_PARTS: u32 = 1 << 12;

/// The number of pixels that any file may claim, and what each of its bytes adds: a part without any sample compresses
/// almost without limit, and each pixel becomes layers.
const ALWAYS_ALLOWED_PX: u64 = 1 << 24;
const PX_PER_BYTE: u64 = 96;

/// The blocks in which the pixels of a part are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Block {
    /// Of a part that is not deep.
    Flat,
    /// So many deep lines.
    Lines(usize),
    /// Deep tiles of so many columns and rows.
    Tiles(usize, usize),
}

impl Block {
    pub fn is_deep(self) -> bool {
        self != Block::Flat
    }
}

/// How deep blocks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    None,
    Rle,
    Zip,
}

/// The type of the samples of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    Uint,
    Half,
    Float,
}

/// A channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    pub name: String,
    pub kind: Type,
}

/// What the header of a part says; of a part that is not deep, only how many blocks it has is defined.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    pub channels: Vec<Channel>,
    pub compression: Compression,
    pub data_window: Window,
    pub display_window: Window,
    pub blocks: Block,
    /// The number of blocks.
    pub count: usize,
}

/// The headers of all parts, and where their tables of offsets begin.
pub fn headers(file: &[u8]) -> Result<(Vec<Header>, usize)> {
    let mut reader = Reader { file, at: 4 };
    let version = reader.u32()?;
    let mut all = Vec::new();
    loop {
        let attributes = reader.attributes()?;
        if attributes.is_empty() {
            break;
        }
        all.push(header(&attributes, version, file.len() as u64)?);
        if version & SEVERAL_PARTS == 0 {
            break;
        }
    }
    let blocks = all.iter().try_fold(0usize, |sum, header| sum.checked_add(header.count));
    // A block has an offset of eight bytes.
    match blocks.filter(|blocks| *blocks <= file.len() / 8) {
        Some(_) => Ok((all, reader.at)),
        None => Err(Problem::Damaged("its header claims more blocks of pixels than it can hold".into())),
    }
}

/// A name, a type and a value.
type Attribute<'a> = (&'a [u8], &'a [u8], &'a [u8]);

/// The bytes of a file, from a place on.
struct Reader<'a> {
    file: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn too_early() -> Problem {
        Problem::Damaged("its header ends too early".into())
    }

    fn bytes(&mut self, length: usize) -> Result<&'a [u8]> {
        let end = self.at.checked_add(length);
        let bytes = end.and_then(|end| self.file.get(self.at..end)).ok_or_else(Reader::too_early)?;
        self.at += length;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        let bytes = self.bytes(4)?;
        Ok(u32::from_le_bytes(*bytes.first_chunk().expect("there are four")))
    }

    /// The bytes before the next zero.
    fn word(&mut self) -> Result<&'a [u8]> {
        let rest = self.file.get(self.at..).unwrap_or_default();
        let length = rest.iter().position(|byte| *byte == 0).ok_or_else(Reader::too_early)?;
        self.at += length + 1;
        Ok(&rest[..length])
    }

    /// The attributes of one part, up to an empty name.
    fn attributes(&mut self) -> Result<Vec<Attribute<'a>>> {
        let mut all = Vec::new();
        loop {
            let name = self.word()?;
            if name.is_empty() {
                return Ok(all);
            }
            let kind = self.word()?;
            let length = self.u32()? as usize;
            all.push((name, kind, self.bytes(length)?));
        }
    }
}

fn header(attributes: &[Attribute], version: u32, length: u64) -> Result<Header> {
    let value = |name: &str| {
        let found = attributes.iter().find(|(own, ..)| *own == name.as_bytes());
        found.map(|(.., value)| *value)
    };
    let needed =
        |name: &str| value(name).ok_or_else(|| Problem::Damaged(format!("its header has no {name}")));
    let number = |bytes: &[u8], at: usize| {
        let found = bytes.get(4 * at..).and_then(|rest| rest.first_chunk());
        found.map(|bytes| i32::from_le_bytes(*bytes)).ok_or_else(Reader::too_early)
    };
    let count = match value("chunkCount") {
        Some(bytes) => usize::try_from(number(bytes, 0)?).map_err(|_| Reader::too_early())?,
        None => return Err(Problem::Damaged("its header has no chunkCount".into())),
    };
    let window = |name: &str| {
        let bytes = needed(name)?;
        let [left, top, right, bottom] = [0, 1, 2, 3].map(|i| number(bytes, i));
        let (x, y) = (left?, top?);
        let side = |last: i32, first: i32| (i64::from(last) - i64::from(first) + 1).max(0) as u64;
        let (width, height) = (side(right?, x), side(bottom?, y));
        let most = ALWAYS_ALLOWED_PX + PX_PER_BYTE * length;
        if !(1..=most).contains(&width.saturating_mul(height)) {
            return Err(Problem::Damaged(format!(
                "its header claims {width} x {height} pixels, which a file of {length} bytes cannot hold"
            )));
        }
        Ok(Window { x, y, width: width as usize, height: height as usize })
    };
    let (data_window, display_window) = (window("dataWindow")?, window("displayWindow")?);
    let kind = value("type").unwrap_or(if version & TILED == 0 { b"scanlineimage" } else { b"tiledimage" });
    let is_tiled = match kind.strip_suffix(b"\0").unwrap_or(kind) {
        b"deepscanline" => false,
        b"deeptile" => true,
        _ => {
            let (channels, compression, blocks) = (Vec::new(), Compression::None, Block::Flat);
            return Ok(Header { channels, compression, data_window, display_window, blocks, count });
        }
    };
    // By the numbers of the format; only these are allowed for deep pixels.
    let (compression, lines) = match needed("compression")? {
        [0] => (Compression::None, 1),
        [1] => (Compression::Rle, 1),
        [2] => (Compression::Zip, 1),
        [3] => (Compression::Zip, 16),
        other => {
            return Err(Problem::Unsupported {
                found: format!("deep pixels of compression {other:?}"),
                accepted: "deep pixels compressed by RLE, ZIPS, ZIP or not",
            });
        }
    };
    let blocks = if is_tiled {
        let bytes = needed("tiles")?;
        let side = |at: usize| usize::try_from(number(bytes, at)?).map_err(|_| Reader::too_early());
        let (columns, rows) = (side(0)?, side(1)?);
        if columns == 0 || rows == 0 {
            return Err(Problem::Damaged(format!("its header claims tiles of {columns} x {rows} pixels")));
        }
        Block::Tiles(columns, rows)
    } else {
        Block::Lines(lines)
    };
    let channels = channels(needed("channels")?)?;
    Ok(Header { channels, compression, data_window, display_window, blocks, count })
}

/// The channels of a list, in its order.
fn channels(list: &[u8]) -> Result<Vec<Channel>> {
    let mut reader = Reader { file: list, at: 0 };
    let mut all = Vec::new();
    loop {
        let name = reader.word()?;
        if name.is_empty() {
            return Ok(all);
        }
        let name = String::from_utf8_lossy(name).into_owned();
        let kind = match reader.u32()? {
            0 => Type::Uint,
            1 => Type::Half,
            2 => Type::Float,
            other => return Err(Problem::Damaged(format!("its channel {name:?} is of the type {other}"))),
        };
        reader.u32()?;
        let sampling = [reader.u32()?, reader.u32()?];
        if sampling != [1, 1] {
            return Err(Problem::Unsupported {
                found: format!(
                    "a channel {name:?} with a sample for every {} x {} pixels",
                    sampling[0], sampling[1]
                ),
                accepted: "deep channels with samples for every pixel",
            });
        }
        all.push(Channel { name, kind });
    }
}
