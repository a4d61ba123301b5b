//! Deep parts: any number of samples a pixel, in scan lines or tiles.
//!
//! The layout is that of the public description of the format, *OpenEXR File Layout*. The decoder of flat parts knows
//! neither deep blocks nor their headers, so both are read here. Nothing is believed before it is checked: windows and
//! blocks are held against the length of the file, and memory for samples is taken when all counts have been read.

use super::deep_header::{Block, Channel, Header, Type, headers};
use super::parallel::for_each_parallel;
use super::read::Window;
use super::unpack::{EXPANSION, unpack};
use crate::files::error::{Problem, Result};
use crate::files::source::{check_claim, check_regular, with_path};
use half::f16;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// The samples of a deep part.
#[derive(Debug, Clone, PartialEq)]
pub struct Deep {
    /// The number of samples of each pixel that is stored, row by row.
    pub counts: Vec<u32>,
    /// The wanted channels that the part has: their names, and the samples of all pixels one after another.
    pub channels: Vec<(String, Vec<f32>)>,
    /// The pixels that are stored.
    pub data_window: Window,
    /// The pixels that are meant to be seen.
    pub display_window: Window,
}

/// A block of pixels that has not been decoded.
struct Packed<'a> {
    /// Columns and rows of the data window that it holds.
    area: Window,
    /// How many samples each pixel and all before it in its row have.
    table: &'a [u8],
    samples: &'a [u8],
    /// The number of bytes of the samples.
    unpacked: u64,
}

/// Reads the wanted channels of the first deep part that has a channel of the name `needed`; `None` if there is none.
///
/// Half samples are represented exactly, unsigned ones up to 2^24.
pub fn read_deep(path: &Path, needed: &str, wanted: &[String]) -> Result<Option<Deep>> {
    with_path(path, || {
        check_regular(path)?;
        let file = std::fs::read(path)?;
        let (headers, tables) = headers(&file)?;
        let has_needed = |header: &Header| header.channels.iter().any(|channel| channel.name == needed);
        let is_deep = |header: &Header| header.blocks.is_deep() && has_needed(header);
        let Some(part) = headers.iter().position(is_deep) else { return Ok(None) };
        let first: usize = headers[..part].iter().map(|header| header.count).sum();
        let header = &headers[part];
        let number = (headers.len() > 1).then_some(part);
        let blocks = packed(&file, header, number, tables + 8 * first)?;
        let counts = counts(header, &blocks)?;
        let channels = samples(&file, header, &blocks, &counts, wanted)?;
        let Header { data_window, display_window, .. } = *header;
        Ok(Some(Deep { counts, channels, data_window, display_window }))
    })
}

/// The bytes `at .. at + length` of a file.
fn part_of(file: &[u8], at: u64, length: u64) -> std::result::Result<&[u8], Problem> {
    let range =
        usize::try_from(at).ok().zip(at.checked_add(length).and_then(|end| usize::try_from(end).ok()));
    let part = range.and_then(|(start, end)| file.get(start..end));
    part.ok_or_else(|| Problem::Damaged("a block of pixels ends after the file".into()))
}

/// Integers, one after another.
struct Numbers<'a> {
    file: &'a [u8],
    at: u64,
}

impl Numbers<'_> {
    fn bytes<const N: usize>(&mut self) -> std::result::Result<[u8; N], Problem> {
        let part = part_of(self.file, self.at, N as u64)?;
        self.at += N as u64;
        Ok(*part.first_chunk().expect("the part has this length"))
    }

    fn i32(&mut self) -> std::result::Result<i32, Problem> {
        self.bytes().map(i32::from_le_bytes)
    }

    fn u64(&mut self) -> std::result::Result<u64, Problem> {
        self.bytes().map(u64::from_le_bytes)
    }
}

/// The blocks of a part, whose table of offsets begins at `table`, in its order. In a file of several parts, blocks say the
/// `number` of theirs. Blocks of smaller copies of the picture are left out.
fn packed<'a>(
    file: &'a [u8],
    header: &Header,
    number: Option<usize>,
    table: usize,
) -> std::result::Result<Vec<Packed<'a>>, Problem> {
    let Window { width, height, .. } = header.data_window;
    let mut offsets = Numbers { file, at: table as u64 };
    let mut blocks = Vec::new();
    // No byte is of two blocks, so all of them together are no longer than the file.
    let mut stored = 0u64;
    for _ in 0..header.count {
        let mut numbers = Numbers { file, at: offsets.u64()? };
        if let Some(number) = number
            && usize::try_from(numbers.i32()?) != Ok(number)
        {
            return Err(Problem::Damaged("a block of pixels belongs to another part".into()));
        }
        let area = match header.blocks {
            Block::Lines(lines) => {
                let y = i64::from(numbers.i32()?) - i64::from(header.data_window.y);
                let first = usize::try_from(y).ok().filter(|y| *y < height && y % lines == 0);
                first.map(|y| Window { x: 0, y: y as i32, width, height: lines.min(height - y) })
            }
            Block::Tiles(columns, rows) => {
                let [x, y, level_x, level_y] =
                    [numbers.i32()?, numbers.i32()?, numbers.i32()?, numbers.i32()?];
                let place = |number: i32, side: usize, n: usize| {
                    let first = usize::try_from(number).ok().and_then(|number| number.checked_mul(side));
                    first.filter(|first| *first < n)
                };
                if (level_x, level_y) != (0, 0) {
                    continue;
                }
                place(x, columns, width).zip(place(y, rows, height)).map(|(x, y)| Window {
                    x: x as i32,
                    y: y as i32,
                    width: columns.min(width - x),
                    height: rows.min(height - y),
                })
            }
            Block::Flat => None,
        };
        let Some(area) = area else {
            return Err(Problem::Damaged("a block of pixels is not where the file says".into()));
        };
        let [table, samples, unpacked] = [numbers.u64()?, numbers.u64()?, numbers.u64()?];
        stored = stored.saturating_add(table).saturating_add(samples);
        if stored > file.len() as u64 {
            return Err(Problem::Damaged("its blocks are longer than the file".into()));
        }
        check_claim(u128::from(unpacked), file.len() as u64)?;
        // What is claimed is also held against the bytes of the block itself: many short blocks may not claim much together.
        let fits = |packed: u64, claimed: u64| u128::from(claimed) <= u128::from(packed) * EXPANSION as u128;
        if !fits(table, 4 * (area.width * area.height) as u64) || !fits(samples, unpacked) {
            return Err(Problem::Damaged("a block of pixels claims more than its bytes can hold".into()));
        }
        let table_end = numbers.at + table;
        blocks.push(Packed {
            area,
            table: part_of(file, numbers.at, table)?,
            samples: part_of(file, table_end, samples)?,
            unpacked,
        });
    }
    Ok(blocks)
}

/// The number of samples of each pixel. Every pixel is in one block.
fn counts(header: &Header, blocks: &[Packed]) -> std::result::Result<Vec<u32>, Problem> {
    let Window { width, height, .. } = header.data_window;
    let area: usize = blocks.iter().map(|block| block.area.width * block.area.height).sum();
    if area != width * height {
        return Err(Problem::Damaged("blocks of pixels are missing, or stored twice".into()));
    }
    // What no block has written.
    const NONE: u32 = u32::MAX;
    let mut counts = vec![NONE; width * height];
    for block in blocks {
        let Window { x, y, width: columns, height: rows } = block.area;
        let table = unpack(block.table, 4 * columns * rows, header.compression)?;
        for (row, table) in table.chunks_exact(4 * columns).enumerate() {
            let counts = &mut counts[(y as usize + row) * width + x as usize..][..columns];
            let mut before = 0;
            for (count, total) in counts.iter_mut().zip(table.as_chunks().0) {
                let total = i32::from_le_bytes(*total);
                if total < before || *count != NONE {
                    return Err(Problem::Damaged("the numbers of samples contradict one another".into()));
                }
                *count = (total - before) as u32;
                before = total;
            }
        }
    }
    Ok(counts)
}

/// A channel of the output: its bytes before it in a sample of all channels, its type, and where its samples go.
struct Plane<'a> {
    before: usize,
    kind: Type,
    samples: &'a mut [f32],
}

/// The samples of the wanted channels.
fn samples(
    file: &[u8],
    header: &Header,
    blocks: &[Packed],
    counts: &[u32],
    wanted: &[String],
) -> std::result::Result<Vec<(String, Vec<f32>)>, Problem> {
    let width = header.data_window.width;
    let bytes_of = |channels: &[Channel]| channels.iter().map(|channel| channel.kind.bytes()).sum::<usize>();
    let per_sample = bytes_of(&header.channels);
    let of_row = |area: &Window, row: usize| {
        let first = (area.y as usize + row) * width + area.x as usize;
        counts[first..first + area.width].iter().map(|count| u64::from(*count)).sum::<u64>()
    };
    // What all blocks hold, before memory is taken for it.
    let mut all = 0u128;
    for block in blocks {
        let of_block: u64 = (0..block.area.height).map(|row| of_row(&block.area, row)).sum();
        if u128::from(of_block) * per_sample as u128 != u128::from(block.unpacked) {
            return Err(Problem::Damaged(
                "a block of pixels has another number of samples than it says".into(),
            ));
        }
        all += u128::from(of_block);
    }
    let chosen: Vec<usize> =
        (0..header.channels.len()).filter(|&i| wanted.contains(&header.channels[i].name)).collect();
    check_claim(all * chosen.len() as u128 * size_of::<f32>() as u128, file.len() as u64)?;
    let mut found: Vec<(String, Vec<f32>)> =
        chosen.iter().map(|&i| (header.channels[i].name.clone(), vec![0.0; all as usize])).collect();

    // Where the samples of each row begin.
    let rows = counts.chunks_exact(width).scan(0usize, |end, row| {
        let first = *end;
        *end += row.iter().map(|count| *count as usize).sum::<usize>();
        Some(first)
    });
    let rows: Vec<usize> = rows.collect();
    let planes = found.iter_mut().zip(&chosen).map(|((_, samples), &i)| Plane {
        before: bytes_of(&header.channels[..i]),
        kind: header.channels[i].kind,
        samples,
    });
    let planes = Mutex::new(planes.collect::<Vec<_>>());
    for_each_parallel(blocks.len(), |i| {
        let Packed { area, samples, unpacked, .. } = &blocks[i];
        let bytes = unpack(samples, *unpacked as usize, header.compression)?;
        let mut rest = &bytes[..];
        // A thread that panicked has already made the call fail; the others only have to end.
        let mut planes = planes.lock().unwrap_or_else(PoisonError::into_inner);
        for row in 0..area.height {
            let line = area.y as usize + row;
            let before: usize = counts[line * width..][..area.x as usize].iter().map(|n| *n as usize).sum();
            let (first, n) = (rows[line] + before, of_row(area, row) as usize);
            let (own, others) = rest.split_at(n * per_sample);
            rest = others;
            for Plane { before, kind, samples } in planes.iter_mut() {
                let own = &own[n * *before..][..n * kind.bytes()];
                kind.fill(own, &mut samples[first..first + n]);
            }
        }
        Ok(())
    })?;
    drop(planes);
    Ok(found)
}

impl Type {
    /// Bytes of a sample.
    fn bytes(self) -> usize {
        match self {
            Type::Half => 2,
            Type::Uint | Type::Float => 4,
        }
    }

    /// Converts samples.
    fn fill(self, bytes: &[u8], out: &mut [f32]) {
        match self {
            Type::Uint => fill(bytes, out, |b| u32::from_le_bytes(b) as f32),
            Type::Half => fill(bytes, out, |b| f16::from_le_bytes(b).to_f32()),
            Type::Float => fill(bytes, out, f32::from_le_bytes),
        }
    }
}

fn fill<const N: usize>(bytes: &[u8], out: &mut [f32], value: impl Fn([u8; N]) -> f32) {
    out.iter_mut().zip(bytes.as_chunks().0).for_each(|(out, bytes)| *out = value(*bytes));
}
