//! The colours of a layer's cells: planes as the caller gave them, and a list of the few cells that differ from them.

use crate::memory::Buffer;
use crate::picture::Size;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// A cell whose colour is listed.
#[derive(Clone, Copy)]
pub struct CellColor {
    pub index: usize,
    pub color: [f32; 4],
}

/// The values of these channels, and `none` for those that are missing to four.
pub fn picked(values: [f32; 4], channels: &[usize], none: f32) -> [f32; 4] {
    std::array::from_fn(|i| channels.get(i).map_or(none, |&c| values[c]))
}

/// The colours of one layer.
#[derive(Clone)]
pub struct Colors {
    size: Size,
    /// Planes of the frame; absent if all cells are listed.
    planes: Option<Arc<Buffer<f32>>>,
    /// The listed cells, sorted by index.
    listed: Vec<CellColor>,
}

impl Colors {
    /// Colours as planes.
    pub fn new(size: Size, planes: Arc<Buffer<f32>>) -> Colors {
        Colors { size, planes: Some(planes), listed: Vec::new() }
    }

    /// Colours of these cells only; zero elsewhere.
    pub fn of_cells(size: Size, listed: Vec<CellColor>) -> Colors {
        Colors { size, planes: None, listed: Vec::new() }.with(listed)
    }

    /// The same colours except for these cells. Each cell is listed once.
    pub fn with(&self, mut changes: Vec<CellColor>) -> Colors {
        changes.par_sort_unstable_by_key(|cell| cell.index);
        let listed = if self.listed.is_empty() { changes } else { merged(&self.listed, &changes) };
        Colors { size: self.size, planes: self.planes.clone(), listed }
    }

    /// Only these channels.
    pub fn of_channels(&self, channels: &[usize]) -> Colors {
        let n = self.size.pixels();
        let planes = self.planes.as_ref().map(|planes| {
            let kept: Vec<_> = channels.iter().map(|&c| &planes[c * n..][..n]).collect();
            Arc::new(Buffer::concat(&kept))
        });
        let listed = self
            .listed
            .iter()
            .map(|cell| CellColor { index: cell.index, color: picked(cell.color, channels, 0.0) });
        Colors { size: Size { channels: channels.len(), ..self.size }, planes, listed: listed.collect() }
    }

    /// Only these pixels, which are whole rows and form a frame of this size.
    pub fn rows(&self, pixels: Range<usize>, size: Size) -> Colors {
        let planes = self.planes.as_ref().map(|planes| {
            let of_plane = planes.chunks(self.size.pixels()).map(|plane| &plane[pixels.clone()]);
            Arc::new(Buffer::concat(&of_plane.collect::<Vec<_>>()))
        });
        let listed = self.listed(pixels.clone()).iter();
        let listed = listed.map(|cell| CellColor { index: cell.index - pixels.start, ..*cell }).collect();
        Colors { size, planes, listed }
    }

    /// The number of channels.
    pub fn channels(&self) -> usize {
        self.size.channels
    }

    /// The planes of the frame, without the listed cells; `None` if only these have a colour.
    pub fn planes(&self) -> Option<&[f32]> {
        self.planes.as_ref().map(|planes| &planes[..])
    }

    /// Whether only listed cells have a colour.
    pub fn is_list(&self) -> bool {
        self.planes.is_none()
    }

    /// The listed cells in a range of pixels.
    pub fn listed(&self, pixels: Range<usize>) -> &[CellColor] {
        let place = |index: usize| self.listed.partition_point(|cell| cell.index < index);
        &self.listed[place(pixels.start)..place(pixels.end)]
    }

    /// The colour of one cell.
    pub fn at(&self, index: usize) -> [f32; 4] {
        match (self.listed.binary_search_by_key(&index, |cell| cell.index), &self.planes) {
            (Ok(i), _) => self.listed[i].color,
            (Err(_), None) => [0.0; 4],
            (Err(_), Some(planes)) => std::array::from_fn(|c| {
                if c < self.size.channels { planes[c * self.size.pixels() + index] } else { 0.0 }
            }),
        }
    }

    /// Copies a range of columns of row `y`. Each channel is written `pitch` values after the previous one.
    pub fn copy_row(&self, y: usize, columns: Range<usize>, pitch: usize, out: &mut [f32]) {
        let (start, n) = (y * self.size.width + columns.start, columns.len());
        for c in 0..self.size.channels {
            let out = &mut out[c * pitch..][..n];
            match &self.planes {
                Some(planes) => out.copy_from_slice(&planes[c * self.size.pixels() + start..][..n]),
                None => out.fill(0.0),
            }
        }
        for cell in self.listed(start..start + n) {
            for c in 0..self.size.channels {
                out[c * pitch + cell.index - start] = cell.color[c];
            }
        }
    }

    /// All colours as planes.
    pub fn to_planes(&self) -> Buffer<f32> {
        let n = self.size.pixels();
        let mut all = match &self.planes {
            Some(planes) => Buffer::clone(planes),
            None => Buffer::full(n * self.size.channels, 0.0),
        };
        for cell in &self.listed {
            for c in 0..self.size.channels {
                all[c * n + cell.index] = cell.color[c];
            }
        }
        all
    }
}

/// Merges two lists sorted by index. If a cell is in both lists, the later one wins.
fn merged(earlier: &[CellColor], later: &[CellColor]) -> Vec<CellColor> {
    let mut all = Vec::with_capacity(earlier.len() + later.len());
    let mut rest = earlier.iter().peekable();
    for cell in later {
        while let Some(before) = rest.next_if(|other| other.index < cell.index) {
            all.push(*before);
        }
        rest.next_if(|other| other.index == cell.index);
        all.push(*cell);
    }
    all.extend(rest);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listed_cells_win_over_planes_and_later_ones_over_earlier() {
        let size = Size { width: 3, height: 2, channels: 2 };
        let planes = Arc::new((0..12).map(|v| v as f32).collect::<Buffer<_>>());
        let cell = |index: usize, v: f32| CellColor { index, color: [v, -v, 0.0, 0.0] };
        let colors =
            Colors::new(size, planes).with(vec![cell(4, 50.0), cell(1, 20.0)]).with(vec![cell(4, 60.0)]);
        assert_eq!(colors.at(0), [0.0, 6.0, 0.0, 0.0]);
        assert_eq!(colors.at(4), [60.0, -60.0, 0.0, 0.0]);
        let mut row = [0.0; 4];
        colors.copy_row(1, 1..3, 2, &mut row);
        assert_eq!(row, [60.0, 5.0, -60.0, 11.0]);
        assert_eq!(colors.to_planes()[..6], [0.0, 20.0, 2.0, 3.0, 60.0, 5.0]);
    }
}
