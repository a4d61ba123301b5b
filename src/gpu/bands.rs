//! Frames in bands of rows, for devices that cannot hold them in one piece.
//!
//! A band is a frame of its own: some rows of the picture, and as many rows around them as the method reads. The
//! artificial border of the band then affects none of its rows. Bands begin where tiles, blocks and the pixels of
//! smaller targets begin, and give the same bits as the whole frame.

use crate::picture::{ChannelGroup, Size};
use std::ops::Range;

/// The rows that are read for a band begin and end at multiples of this number, unless a method has larger pixels.
const ALIGNMENT: usize = 64;

/// What a method requires of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Requirements {
    /// Bytes per pixel of its largest buffer.
    pub bytes_per_px: usize,
    /// Bytes per pixel of all its buffers that one picture leaves to the next, beside those of the result.
    pub all_bytes_per_px: usize,
    /// Bytes per pixel of what it keeps on the device, beside the picture.
    pub kept_bytes_per_px: usize,
    /// Pixels that this buffer has on every side of the frame.
    pub around_px: usize,
    /// The distance in pixels up to which the method reads around a pixel.
    pub reach_px: usize,
    /// Side, in pixels of the picture, of the largest pixels on which the method works.
    pub block_px: usize,
}

impl Requirements {
    /// The requirements of a method that reads up to this distance and has no other buffers than those of the picture
    /// and of the result.
    pub fn reaching(reach_px: usize) -> Requirements {
        Requirements {
            bytes_per_px: 0,
            all_bytes_per_px: 0,
            kept_bytes_per_px: 0,
            around_px: 0,
            reach_px,
            block_px: 1,
        }
    }

    /// The same for pictures whose colours have different focus, and for each of which buffers have other sizes.
    pub fn for_focuses(self, count: usize) -> Requirements {
        Requirements { all_bytes_per_px: count * self.all_bytes_per_px, ..self }
    }

    /// The same for a picture that carries channels.
    pub fn carrying(self, groups: &[ChannelGroup]) -> Requirements {
        let Some(first) = groups.first() else { return self };
        let of_all = size_of::<f32>() * groups.iter().map(|group| group.size.channels).sum::<usize>();
        let of_group = size_of::<f32>() * ChannelGroup::MOST;
        // Of every group its planes, as the pinhole sees them and as cells have them, which may all be on their way at a time;
        // the cells of a group; the picture's own, by which they are sharpened; up to four results of a group; and all of
        // them, which are also transferred back.
        let uploaded = 2 * of_all * first.layers.len();
        let more = uploaded + 3 * self.bytes_per_px + 4 * of_group + 3 * of_all;
        Requirements {
            bytes_per_px: self.bytes_per_px.max(of_all),
            all_bytes_per_px: self.all_bytes_per_px + more,
            ..self
        }
    }

    /// Bytes that a band takes: of the largest buffer, and of all.
    fn bytes(&self, band: &Band, size: Size, layers: usize) -> Bytes {
        let channels = size_of::<f32>() * size.channels;
        let pixels = (size.width + 2 * self.around_px + 1) * (band.read.len() + 2 * self.around_px);
        let kept = channels * layers + size_of::<f32>() + self.kept_bytes_per_px;
        // The band before may still be there.
        let bands = if band.read.len() < size.height { 2 } else { 1 };
        // Four on the device, for what is rendered may yet be magnified, cut out and averaged, and two that are
        // transferred back.
        let results = 6 * channels;
        Bytes {
            one: pixels * self.bytes_per_px.max(channels * layers),
            all: pixels * (bands * kept + results + self.all_bytes_per_px),
        }
    }
}

/// Bytes of a frame, or the most that a device has for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bytes {
    /// Of its largest buffer.
    pub one: usize,
    /// Of all buffers together.
    pub all: usize,
}

impl Bytes {
    fn fit(self, most: Bytes) -> bool {
        self.one <= most.one && self.all <= most.all
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

/// The bands of a frame, from some row on, for a device that has no more than `most`; a band has a multiple of `step`
/// rows. `source` maps rows of the output to the rows that the method renders for them. The error is what a band needs
/// at least.
pub fn split(
    most: Bytes,
    (size, layers): (Size, usize),
    need: Requirements,
    (from, step): (usize, usize),
    source: impl Fn(Range<usize>) -> Range<usize>,
) -> Result<Vec<Band>, Bytes> {
    let alignment = ALIGNMENT.max(need.block_px);
    let read = |rows: &Range<usize>| {
        let Range { start, end } = source(rows.clone());
        let first = start.saturating_sub(need.reach_px) / alignment * alignment;
        first..(end + need.reach_px).next_multiple_of(alignment).min(size.height)
    };
    let whole = Band { rows: 0..size.height, read: 0..size.height };
    if from == 0 && bytes(&whole, size, layers, need).fit(most) {
        return Ok(vec![whole]);
    }
    let band = |rows: Range<usize>| Band { read: read(&rows), rows };
    let bytes = |rows: Range<usize>| bytes(&band(rows), size, layers, need);
    let (mut bands, mut first) = (Vec::new(), from);
    while first < size.height {
        let ends = (first + step..=size.height).step_by(step);
        let fitting = ends.take_while(|&end| bytes(first..end).fit(most)).last();
        let end = fitting.ok_or_else(|| bytes(first..first + step))?;
        bands.push(band(first..end));
        first = end;
    }
    Ok(bands)
}

/// What a band of a frame needs of a device.
pub fn bytes(band: &Band, size: Size, layers: usize, need: Requirements) -> Bytes {
    need.bytes(band, size, layers)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 100, height: 1500, channels: 3 };

    fn split_to(most: Bytes, reach_px: usize, (from, step): (usize, usize)) -> Result<Vec<Band>, Bytes> {
        let need = Requirements { bytes_per_px: 16, block_px: 2, ..Requirements::reaching(reach_px) };
        split(most, (SIZE, 1), need, (from, step), |rows| rows)
    }

    fn bands(most_bytes: usize, reach_px: usize, step: usize) -> Result<Vec<Band>, Bytes> {
        split_to(Bytes { one: most_bytes, all: usize::MAX }, reach_px, (0, step))
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
        assert_eq!(bands(1000, 5, 1).unwrap_err().one, 64 * 101 * 16);
    }

    #[test]
    fn bands_are_planned_by_the_sum_of_all_buffers() {
        // The picture with its depth, and six times the result; in bands also the picture of the one before.
        let (kept, results) = (12 + 4, 6 * 12);
        let whole = 1500 * 101 * (kept + results);
        let most = |all| Bytes { one: usize::MAX, all };
        assert_eq!(split_to(most(whole), 5, (0, 1)).unwrap().len(), 1);
        let bands = split_to(most(whole - 1), 5, (0, 1)).unwrap();
        assert!(bands.len() == 2);
        assert!(bands.iter().all(|band| band.read.len() * 101 * (2 * kept + results) < whole));
        assert_eq!(split_to(most(1000), 5, (0, 1)).unwrap_err().all, 64 * 101 * (2 * kept + results));
    }

    #[test]
    fn a_frame_is_gone_on_with_from_any_row() {
        let rest = split_to(Bytes { one: 800_000, all: usize::MAX }, 7, (600, 3)).unwrap();
        assert_eq!((rest[0].rows.start, rest.last().unwrap().rows.end), (600, 1500));
        assert!(rest.windows(2).all(|pair| pair[0].rows.end == pair[1].rows.start));
        assert!(rest[0].read.start > 0 && rest[0].read.start <= 593);
    }
}
