//! Frames in bands of rows, for devices that cannot hold them in one piece.
//!
//! A band is a frame of its own: some rows of the picture, and as many rows around them as the method reads. The
//! artificial border of the band then affects none of its rows. Bands begin where tiles, blocks and the pixels of
//! smaller targets begin, and give the same bits as the whole frame.

use crate::picture::Size;
use std::ops::Range;

/// The rows that are read for a band begin and end at multiples of this number, unless a method has larger pixels.
const ALIGNMENT: usize = 64;

/// What a method requires of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Requirements {
    /// Bytes per pixel of its largest buffer.
    pub bytes_per_px: usize,
    /// Pixels that this buffer has on every side of the frame.
    pub around_px: usize,
    /// The distance in pixels up to which the method reads around a pixel.
    pub reach_px: usize,
    /// Side, in pixels of the picture, of the largest pixels on which the method works.
    pub block_px: usize,
}

impl Requirements {
    /// The requirements of a method that reads up to this distance and whose other buffers are no larger than the
    /// picture.
    pub fn reaching(reach_px: usize) -> Requirements {
        Requirements { bytes_per_px: 0, around_px: 0, reach_px, block_px: 1 }
    }
}

/// A band: some rows of the frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Band {
    /// The rows of the result.
    pub rows: Range<usize>,
    /// The rows that are read for them.
    pub read: Range<usize>,
}

/// The bands of a frame for buffers of at most so many bytes; a band has a multiple of `step` rows. `source` maps
/// rows of the output to the rows that the method renders for them. The error is the number of bytes that a band
/// needs at least.
pub fn split(
    most_bytes: usize,
    size: Size,
    layers: usize,
    need: Requirements,
    step: usize,
    source: impl Fn(Range<usize>) -> Range<usize>,
) -> Result<Vec<Band>, usize> {
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
    let whole = 0..size.height;
    if bytes(&whole) <= most_bytes {
        return Ok(vec![Band { rows: whole.clone(), read: whole }]);
    }
    let mut bands: Vec<Band> = Vec::new();
    while let Some(first) = Some(bands.last().map_or(0, |band| band.rows.end)).filter(|y| *y < size.height) {
        let ends = (first + step..=size.height).step_by(step);
        let fitting = ends.take_while(|&end| bytes(&read(&(first..end))) <= most_bytes).last();
        let least = first..first + step;
        let end = fitting.ok_or_else(|| bytes(&read(&least)))?;
        bands.push(Band { rows: first..end, read: read(&(first..end)) });
    }
    Ok(bands)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 100, height: 1500, channels: 3 };

    fn bands(most_bytes: usize, reach_px: usize, step: usize) -> Result<Vec<Band>, usize> {
        let need = Requirements { bytes_per_px: 16, block_px: 2, ..Requirements::reaching(reach_px) };
        split(most_bytes, SIZE, 1, need, step, |rows| rows)
    }

    #[test]
    fn bands_follow_one_another_and_read_all_that_they_need() {
        for (reach, step) in [(0, 1), (7, 3), (40, 1), (100, 5)] {
            let bands = bands(800_000, reach, step).unwrap();
            assert!(bands.len() > 2);
            let mut end = 0;
            for Band { rows, read } in bands {
                assert_eq!(rows.start, end);
                assert!(rows.len().is_multiple_of(step) && read.start.is_multiple_of(ALIGNMENT));
                assert!(read.start <= rows.start.saturating_sub(reach));
                assert!(read.end >= (rows.end + reach).min(SIZE.height));
                assert!(read.len() * (SIZE.width + 1) * 16 <= 800_000);
                end = rows.end;
            }
            assert_eq!(end, SIZE.height);
        }
    }

    #[test]
    fn what_fits_is_in_one_piece_and_what_never_fits_tells_its_size() {
        assert_eq!(bands(1 << 30, 5, 1).unwrap(), [Band { rows: 0..1500, read: 0..1500 }]);
        assert_eq!(bands(1000, 5, 1).unwrap_err(), 64 * 101 * 16);
    }
}
