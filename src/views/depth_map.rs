//! The disparities that a camera sees, and how finely they tell surfaces apart.

use crate::scene::edges::connected;

/// Disparities of the pixels of a picture.
#[derive(Clone, Copy)]
pub struct DepthMap<'a> {
    pub width: usize,
    pub height: usize,
    pub disparity: &'a [f32],
}

impl DepthMap<'_> {
    /// The pixel in which a place lies.
    #[inline(always)]
    pub fn pixel_at(&self, x: f64, y: f64) -> Option<usize> {
        let (x, y) = (x + 0.5, y + 0.5);
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        inside.then(|| y as usize * self.width + x as usize)
    }

    /// The place of a pixel: its centre has whole coordinates.
    #[inline(always)]
    pub fn place(&self, index: usize) -> (f64, f64) {
        ((index % self.width) as f64, (index / self.width) as f64)
    }

    /// The indices of the 3 x 3 pixels around one, those in the frame.
    pub fn around(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        self.within(index, 1)
    }

    /// The indices of the pixels that are no more than so many columns and rows away from one, those in the frame.
    pub fn within(&self, index: usize, reach: usize) -> impl Iterator<Item = usize> + use<> {
        let (x, y, width, height) = (index % self.width, index / self.width, self.width, self.height);
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }

    /// How much the surface at a pixel rises to its steepest neighbour, in pixels of parallax where there are `k` of
    /// them to a unit of disparity. A neighbour on another surface does not count.
    pub fn slope_px(&self, index: usize, k: f32) -> f32 {
        let (x, y) = (index % self.width, index / self.width);
        let at = |x: usize, y: usize| k * self.disparity[y * self.width + x];
        // The next pixels along a line: before, here, after and the one after that.
        let rise = |v: usize, n: usize, s: &dyn Fn(usize) -> f32| {
            let mut rise = 0.0f32;
            if v > 0 && connected(s((v + 1).min(n - 1)), s(v), s(v - 1), s(v.saturating_sub(2))) {
                rise = rise.max((s(v - 1) - s(v)).abs());
            }
            if v + 1 < n && connected(s(v.saturating_sub(1)), s(v), s(v + 1), s((v + 2).min(n - 1))) {
                rise = rise.max((s(v + 1) - s(v)).abs());
            }
            rise
        };
        rise(x, self.width, &|x| at(x, y)).max(rise(y, self.height, &|y| at(x, y)))
    }

    /// How far a point at disparity `d` is behind the surface at a pixel, in pixels of parallax beyond what the slope of
    /// the surface explains. Negative if it is in front.
    #[inline(always)]
    pub fn behind_px(&self, index: usize, d: f32, k: f32) -> f32 {
        let apart = k * (self.disparity[index] - d);
        if apart.abs() <= SAME_PX {
            return apart;
        }
        let slope = self.slope_px(index, k);
        if apart > 0.0 { (apart - slope).max(0.0) } else { (apart + slope).min(0.0) }
    }
}

/// Points that a pixel of parallax tells apart, or less, are on one surface: a picture tells where things are to half a
/// pixel, and there are two of them.
pub const SAME_PX: f32 = 1.0;

/// How much a point that is so far away is on another surface: entirely from here on.
const ANOTHER_PX: f32 = 1.25;

/// From 0 for a point that is on the same surface to 1 for one that is on another.
#[inline(always)]
pub fn another(apart_px: f32) -> f32 {
    ((apart_px - SAME_PX) / (ANOTHER_PX - SAME_PX)).clamp(0.0, 1.0)
}
