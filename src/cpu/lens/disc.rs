//! Tiles that see one closed surface of nearly constant depth: the exact, area-weighted opening by running sums.

use super::pack::TILE;
use super::sweep::TileColor;
use crate::aperture::{Aperture, Kernel};
use crate::picture::Size;

/// Radii are told apart to this fraction of a pixel where depth varies within a tile.
fn radius_step_px(r: f64) -> f64 {
    if r < 4.0 { 1.0 / 64.0 } else { 1.0 / 16.0 }
}

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

fn mirrored(i: i64, n: usize) -> usize {
    let i = i.rem_euclid(2 * n as i64) as usize;
    if i < n { i } else { 2 * n - 1 - i }
}

impl Surroundings {
    fn new(size: Size, color: &[f32], origin: (usize, usize), reach: usize) -> Surroundings {
        let (across, down) = (TILE.0 + 2 * reach, TILE.1 + 2 * reach);
        let from = |start: usize, n: usize, extent: usize| -> Vec<usize> {
            (0..n).map(|i| mirrored((start + i) as i64 - reach as i64, extent)).collect()
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

/// The tile at `origin` of a surface with shifts `s - s_focus`.
pub fn gather(
    size: Size,
    color: &[f32],
    s: &[f32],
    s_focus: f64,
    aperture: &Aperture,
    origin: (usize, usize),
    out: &mut TileColor,
) {
    let (columns, rows) = (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1));
    let shift = |x: usize, y: usize| f64::from(s[(origin.1 + y) * size.width + origin.0 + x]) - s_focus;
    let first = shift(0, 0);
    let constant = (0..rows).all(|y| (0..columns).all(|x| shift(x, y) == first));
    let step = radius_step_px(first.abs());
    // Kernels are told apart by their radius in steps; a tile of one depth has exactly its own.
    let key = |t: f64| if constant { 0 } else { (t / step).round() as i64 };
    let radius = |key: i64| if constant { first } else { key as f64 * step };

    let keys: Vec<Vec<i64>> =
        (0..rows).map(|y| (0..columns).map(|x| key(shift(x, y))).collect()).collect();
    let mut distinct: Vec<i64> = keys.iter().flatten().copied().collect();
    distinct.sort_unstable();
    distinct.dedup();
    let kernels: Vec<Kernel> = distinct.iter().map(|&k| aperture.kernel(radius(k))).collect();
    let reach = kernels.iter().map(|k| k.reach).max().unwrap_or(0) as usize;
    let around = Surroundings::new(size, color, origin, reach);

    let mut sums = [0.0f64; TILE.0];
    for (y, keys) in keys.iter().enumerate() {
        let mut x = 0;
        for same in keys.chunk_by(|a, b| a == b) {
            let kernel = &kernels[distinct.partition_point(|&k| k < same[0])];
            for (c, plane) in out.planes.iter_mut().enumerate() {
                around.convolve(kernel, c, x, y, &mut sums[..same.len()]);
                for (out, sum) in plane[y * TILE.0 + x..].iter_mut().zip(&sums[..same.len()]) {
                    *out = *sum as f32;
                }
            }
            x += same.len();
        }
    }
}
