//! One layer of a [layered scene](super::layered).

use super::colors::{CellColor, Colors};
use super::half_plane::HalfPlane;
use crate::memory::Buffer;
use crate::picture::Size;
use std::ops::Range;
use std::sync::Arc;

/// What the cells of a layer do with light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// They send out their own and stop what comes from behind them.
    Surface,
    /// They only stop it. Their colours, coverage among them, are zero.
    Holdout,
}

/// A layer holds at most one cell per pixel. The layers of single channels share everything but the colours.
pub struct SceneLayer {
    /// What all of its cells do with light.
    pub role: Role,
    /// Shift of every cell relative to infinity, in pixels; NaN where there is no cell.
    pub s: Arc<Buffer<f32>>,
    /// Colour of every cell; zero where there is no cell.
    pub colors: Colors,
    /// The values of every cell in each group of channels that the picture carries.
    pub carried: Vec<Colors>,
    /// The cells that cover their pixel only partly, sorted by index.
    pub partial: Arc<Vec<(usize, HalfPlane)>>,
    /// Which neighbours are on one surface, however steep; see [`connectivity`](super::edges::connectivity). Empty
    /// for a layer whose cells are not pixels of the picture.
    pub connectivity: Arc<Vec<u8>>,
}

/// The layers of a picture alone.
pub struct Surfaces {
    pub layers: Vec<SceneLayer>,
    /// See [`LayeredScene::opaque`](super::layered::LayeredScene::opaque).
    pub opaque: bool,
}

impl SceneLayer {
    /// The layer that has only these cells: the pixel, the shift and the colour of each. It carries `carried`.
    pub fn of_cells(
        size: Size,
        cells: impl Iterator<Item = (usize, f32, [f32; 4])>,
        carried: Vec<Colors>,
    ) -> SceneLayer {
        let mut shifts = Buffer::full(size.pixels(), f32::NAN);
        let colors = cells.map(|(index, s, color)| {
            shifts[index] = s;
            CellColor { index, color }
        });
        let colors = Colors::of_cells(size, colors.collect());
        SceneLayer {
            role: Role::Surface,
            s: Arc::new(shifts),
            colors,
            carried,
            partial: Arc::default(),
            connectivity: Arc::default(),
        }
    }

    /// Whether some cell of a range of pixels covers its pixel only partly.
    pub fn covers_partly_any(&self, pixels: Range<usize>) -> bool {
        !self.partial_in(pixels).is_empty()
    }

    /// The cells of a range of pixels that cover their pixel only partly.
    pub fn partial_in(&self, pixels: Range<usize>) -> &[(usize, HalfPlane)] {
        let place = |index: usize| self.partial.partition_point(|(partial, _)| *partial < index);
        &self.partial[place(pixels.start)..place(pixels.end)]
    }

    /// The half-plane of the cell at a pixel, if it covers the pixel only partly.
    pub fn half_plane_at(&self, index: usize) -> Option<HalfPlane> {
        let found = self.partial.binary_search_by_key(&index, |(partial, _)| *partial);
        found.ok().map(|i| self.partial[i].1)
    }

    /// Whether the cell at a pixel covers it only partly.
    pub fn covers_partly(&self, index: usize) -> bool {
        self.half_plane_at(index).is_some()
    }
}
