//! Tiles that see one closed surface of nearly constant depth: the exact, area-weighted opening by running sums.

use super::kernels::{self, Kernels};
use super::pack::TILE;
use super::sweep::TileColor;
use crate::aperture::{Aperture, Kernel};
use crate::cpu::border::mirrored;
use crate::picture::Size;
use std::collections::BTreeSet;

/// A tile's surroundings as rows of running sums, with mirrored borders.
struct Surroundings {
    reach: usize,
    across: usize,
    /// Colour planes.
    color: Vec<Vec<f32>>,
    /// Running sums along each row, one more than there are columns; `f64`, so that a bright pixel does not drown
    /// the dark ones after it.
    sums: Vec<Vec<f64>>,
}

impl Surroundings {
    fn new(size: Size, color: &[f32], origin: (usize, usize), reach: usize) -> Surroundings {
        let (across, down) = (TILE.0 + 2 * reach, TILE.1 + 2 * reach);
        let from = |start: usize, n: usize, extent: usize| -> Vec<usize> {
            (0..n).map(|i| mirrored((start + i) as i64 - reach as i64, extent).0).collect()
        };
        let (columns, rows) = (from(origin.0, across, size.width), from(origin.1, down, size.height));
        let (mut planes, mut sums) = (Vec::new(), Vec::new());
        for c in 0..size.channels {
            let source = &color[c * size.pixels()..][..size.pixels()];
            let (mut plane, mut running) = (Vec::with_capacity(across * down), Vec::new());
            running.reserve((across + 1) * down);
            for &y in &rows {
                let row = &source[y * size.width..][..size.width];
                let mut sum = 0.0;
                running.push(sum);
                for &x in &columns {
                    plane.push(row[x]);
                    sum += f64::from(row[x]);
                    running.push(sum);
                }
            }
            planes.push(plane);
            sums.push(running);
        }
        Surroundings { reach, across, color: planes, sums }
    }

    /// Convolves pixels `x .. x + sums.len()` of tile row `y` with one kernel.
    fn convolve(&self, kernel: &Kernel, channel: usize, x: usize, y: usize, sums: &mut [f64]) {
        sums.fill(0.0);
        for row in &kernel.rows {
            let cy = (y + self.reach).wrapping_add_signed(row.dy as isize);
            let at = |dx: i32| (x + self.reach).wrapping_add_signed(dx as isize);
            if row.run.0 < row.run.1 {
                let running = &self.sums[channel][cy * (self.across + 1)..][..self.across + 1];
                let (first, end) = (&running[at(row.run.0)..], &running[at(row.run.1)..]);
                let weight = f64::from(kernel.run_weight);
                for ((sum, a), b) in sums.iter_mut().zip(first).zip(end) {
                    *sum += weight * (b - a);
                }
            }
            let plane = &self.color[channel][cy * self.across..][..self.across];
            for &(dx, weight) in &row.partial {
                for (sum, v) in sums.iter_mut().zip(&plane[at(dx)..]) {
                    *sum += f64::from(weight) * f64::from(*v);
                }
            }
        }
    }
}

/// The frame that discs are gathered from.
pub struct Gather<'a> {
    pub size: Size,
    /// Colour planes of the surface.
    pub color: &'a [f32],
    /// Its shifts relative to infinity.
    pub s: &'a [f32],
    pub s_focus: f64,
    pub aperture: &'a Aperture,
    pub kernels: &'a Kernels,
}

impl Gather<'_> {
    fn shift(&self, x: usize, y: usize) -> f64 {
        f64::from(self.s[y * self.size.width + x]) - self.s_focus
    }

    /// The tile at `origin`. A tile of one depth has exactly its own kernel; elsewhere radii go in steps.
    pub fn tile(&self, origin: (usize, usize), out: &mut TileColor) {
        let extent = extent(self.size, origin);
        let shifts: Vec<Vec<f64>> = (origin.1..origin.1 + extent.1)
            .map(|y| (origin.0..origin.0 + extent.0).map(|x| self.shift(x, y)).collect())
            .collect();
        let first = shifts[0][0];
        let own = shifts.iter().flatten().all(|&t| t == first).then(|| self.aperture.kernel(first));
        let kernel_of = |t: f64| own.as_ref().unwrap_or_else(|| self.kernels.get(t));
        let same = |a: &f64, b: &f64| own.is_some() || kernels::key(*a) == kernels::key(*b);
        let reach = shifts.iter().flatten().map(|&t| kernel_of(t).reach).max().unwrap_or(0) as usize;
        let around = Surroundings::new(self.size, self.color, origin, reach);

        let mut sums = [0.0f64; TILE.0];
        for (y, shifts) in shifts.iter().enumerate() {
            let mut x = 0;
            for run in shifts.chunk_by(same) {
                for (c, plane) in out.planes.iter_mut().enumerate() {
                    around.convolve(kernel_of(run[0]), c, x, y, &mut sums[..run.len()]);
                    for (out, sum) in plane[y * TILE.0 + x..].iter_mut().zip(&sums[..run.len()]) {
                        *out = *sum as f32;
                    }
                }
                x += run.len();
            }
        }
    }
}

/// Columns and rows of the frame in the tile at `origin`.
fn extent(size: Size, origin: (usize, usize)) -> (usize, usize) {
    (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1))
}

/// The radius steps that a tile needs.
pub fn keys(size: Size, s: &[f32], s_focus: f64, origin: (usize, usize)) -> BTreeSet<i32> {
    let extent = extent(size, origin);
    let row = |y: usize| &s[y * size.width + origin.0..][..extent.0];
    let mut keys = BTreeSet::new();
    let mut last = None;
    for y in origin.1..origin.1 + extent.1 {
        for &s in row(y) {
            let key = kernels::key(f64::from(s) - s_focus);
            if last != Some(key) {
                keys.insert(key);
                last = Some(key);
            }
        }
    }
    keys
}
