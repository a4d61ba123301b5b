//! Frames in bands of rows, where a device cannot have them in one piece.
//!
//! A band is a frame of its own: some rows of the picture, and as many around them as the method looks at, so that what
//! is taken for the border there reaches no row of the band. Bands begin where tiles, blocks and the pixels of smaller
//! targets do, and give the same bits as the whole frame.

use super::device::Gpu;
use crate::error::Result;
use crate::picture::Size;
use std::ops::Range;

/// Rows that what is read for a band begins and ends at multiples of, unless a method has larger pixels.
const ALIGNMENT: usize = 64;

/// What a method needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Need {
    /// Bytes of its largest buffer, for every pixel.
    pub bytes_per_px: usize,
    /// Pixels that this buffer has on every side of the frame.
    pub around_px: usize,
    /// How far from a pixel it looks.
    pub reach_px: usize,
    /// Pixels along each side of the largest pixels that it works on.
    pub block_px: usize,
}

impl Need {
    /// Of a method that looks so far and whose other buffers are no larger than the picture.
    pub fn reaching(reach_px: usize) -> Need {
        Need { bytes_per_px: 0, around_px: 0, reach_px, block_px: 1 }
    }
}

/// Some rows of the frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Band {
    /// Those that come out.
    pub rows: Range<usize>,
    /// Those that are read for it.
    pub read: Range<usize>,
}

/// The bands of a frame, of `step` rows or a multiple of that. `source` says which rows of what the method renders come
/// out at some rows.
pub fn split(
    gpu: &Gpu,
    size: Size,
    layers: usize,
    need: Need,
    step: usize,
    source: impl Fn(Range<usize>) -> Range<usize>,
) -> Result<Vec<Band>> {
    let bytes_per_px = need.bytes_per_px.max(size_of::<f32>() * size.channels * layers);
    let alignment = ALIGNMENT.max(need.block_px);
    let read = |rows: &Range<usize>| {
        let Range { start, end } = source(rows.clone());
        let first = start.saturating_sub(need.reach_px) / alignment * alignment;
        first..(end + need.reach_px).next_multiple_of(alignment).min(size.height)
    };
    let bytes = |read: &Range<usize>| {
        (size.width + 2 * need.around_px + 1) * (read.len() + 2 * need.around_px) * bytes_per_px
    };
    let most = gpu.most_bytes() as usize;
    let whole = 0..size.height;
    if bytes(&whole) <= most {
        return Ok(vec![Band { rows: whole.clone(), read: whole }]);
    }
    let mut bands: Vec<Band> = Vec::new();
    while let Some(first) = Some(bands.last().map_or(0, |band| band.rows.end)).filter(|y| *y < size.height) {
        let ends = (first + step..=size.height).step_by(step);
        let fitting = ends.take_while(|&end| bytes(&read(&(first..end))) <= most).last();
        let least = first..first + step;
        let end =
            fitting.ok_or_else(|| gpu.too_large("a band of the picture", bytes(&read(&least)) as u64))?;
        bands.push(Band { rows: first..end, read: read(&(first..end)) });
    }
    Ok(bands)
}
