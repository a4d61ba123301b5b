//! The surfaces that the pinhole sees, as they are separated and continued behind one another.

use super::edges::CONNECTED_PX;
use super::layer::SceneLayer;
use crate::picture::{KnownCoverage, Size};
use rayon::prelude::*;

/// The surfaces that the pinhole sees.
#[derive(Clone, Copy)]
pub struct FrontLayer<'a> {
    pub size: Size,
    /// How many channels, the first ones, hold light. What is in front and what is behind is told from these alone:
    /// coverage is no light.
    pub lights: usize,
    /// Linear colour, planar.
    pub color: &'a [f32],
    /// Disparity in pixels of circle of confusion.
    pub s: &'a [f32],
    /// See [`connectivity`](super::edges::connectivity).
    pub connectivity: &'a [u8],
    /// Coverage that is known beside the colours, in the order of rows.
    pub known: &'a [KnownCoverage],
    /// What is known of the surfaces that these hide, front to back.
    pub behind: &'a [SceneLayer],
}

impl<'a> FrontLayer<'a> {
    /// These surfaces alone, without anything that is known beside them.
    pub fn new(
        size: Size,
        lights: usize,
        color: &'a [f32],
        s: &'a [f32],
        connectivity: &'a [u8],
    ) -> FrontLayer<'a> {
        FrontLayer { size, lights, color, s, connectivity, known: &[], behind: &[] }
    }

    pub fn color_at(&self, i: usize) -> [f32; 4] {
        let n = self.size.pixels();
        std::array::from_fn(|c| if c < self.size.channels { self.color[c * n + i] } else { 0.0 })
    }

    /// What is known to be behind the surface that is seen at a pixel.
    pub fn known_behind(&self, x: usize, y: usize) -> Option<Surface<'a>> {
        let index = y * self.size.width + x;
        let layer = self.behind.iter().find(|layer| layer.s[index] < self.s[index] - CONNECTED_PX)?;
        let (s, color) = (layer.s[index], layer.colors.at(index));
        let at = |dx: i32, dy: i32| {
            let q = self.offset(x, y, dx, dy).filter(|&q| (layer.s[q] - s).abs() < CONNECTED_PX);
            q.map(|q| layer.colors.at(q))
        };
        // It is sampled at the pixel's centre. What it is all over the pixel differs from that by no more than it does from
        // the mean of opposite neighbours.
        let opposite = |(dx, dy): (i32, i32)| at(dx, dy).zip(at(-dx, -dy));
        let means = [(1, 0), (0, 1), (1, 1), (1, -1)].into_iter().filter_map(opposite);
        let means = means.map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c])));
        let mut off: Vec<f32> = means.map(|mean| self.norm2(sub(color, mean))).collect();
        if off.is_empty() {
            let beside = [(1, 0), (0, 1), (-1, 0), (0, -1)].into_iter().filter_map(|(dx, dy)| at(dx, dy));
            off = beside.map(|beside| self.norm2(sub(color, beside))).collect();
        }
        let variance = off.iter().sum::<f32>() / off.len().max(1) as f32;
        Some(Surface { s, known: Some(Known { layer, color, variance }) })
    }

    /// The median of the light of all pixels, as the length of their colours.
    pub fn median_light(&self) -> f32 {
        let light = |i: usize| self.norm2(self.color_at(i)).sqrt();
        let mut all: Vec<f32> = (0..self.size.pixels()).into_par_iter().map(light).collect();
        let middle = all.len() / 2;
        *all.select_nth_unstable_by(middle, f32::total_cmp).1
    }

    /// The squared length of the light of a colour.
    pub fn norm2(&self, color: [f32; 4]) -> f32 {
        color[..self.lights].iter().map(|c| c * c).sum()
    }

    /// Index of the pixel at the offset `(dx, dy)`, if it is in the frame.
    pub fn offset(&self, x: usize, y: usize, dx: i32, dy: i32) -> Option<usize> {
        let (x, y) = (x as i32 + dx, y as i32 + dy);
        let inside = (0..self.size.width as i32).contains(&x) && (0..self.size.height as i32).contains(&y);
        inside.then(|| y as usize * self.size.width + x as usize)
    }
}

/// A surface at a pixel: its shift, and what is known of it if it is hidden there.
#[derive(Clone, Copy)]
pub struct Surface<'a> {
    pub s: f32,
    pub known: Option<Known<'a>>,
}

/// The layer that has a hidden surface, its pure colour and the variance of that.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    pub layer: &'a SceneLayer,
    pub color: [f32; 4],
    pub variance: f32,
}

/// The difference of two colours.
pub fn sub(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|c| a[c] - b[c])
}
