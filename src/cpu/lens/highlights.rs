//! Highlights, drawn as the exact opening with visibility resolved for each pixel of it.

use super::padded::Padded;
use super::tile_color::TileColor;
use crate::plan::lens::highlights::{Highlight, Highlights};
use crate::plan::lens::kernels::{self, Kernels};
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::scene::grid::{BLOCK, TILE};
use rayon::prelude::*;

/// The input for drawing highlights.
pub struct HighlightPass<'a> {
    pub padded: &'a Padded,
    pub s_focus: f64,
    pub kernels: &'a Kernels,
    pub clip: Option<&'a PupilClip>,
}

/// Finds the highlights that other cells may hide partly.
pub fn find_hidden(highlights: &mut [Highlight], padded: &Padded, s_focus: f64) {
    highlights.par_iter_mut().for_each(|h| h.hidden_in_part = h.may_be_hidden(padded, s_focus));
}

impl Highlight {
    /// Whether some cell of the scene lies between the highlight and some point of the lens.
    fn may_be_hidden(&self, padded: &Padded, s_focus: f64) -> bool {
        let (bounds, codes) = (&padded.bounds, &padded.codes);
        if self.is_covered(padded, s_focus, f64::INFINITY) {
            return true;
        }
        let reach = padded.reach_px - self.t;
        let range = |v: i32, n: usize| {
            let first = (f64::from(v) - reach).max(0.0) as usize / BLOCK;
            let last = ((f64::from(v) + reach).max(0.0) as usize / BLOCK).min(n / BLOCK - 1);
            first..=last
        };
        let gap = |v: i32, b: usize| {
            let (v, lo, hi) = (v as i64, (b * BLOCK) as i64, (b * BLOCK + BLOCK - 1) as i64);
            (lo - v).max(v - hi).max(0) as f64
        };
        range(self.y, padded.padding.rows).any(|by| {
            range(self.x, padded.padding.stride).any(|bx| {
                let nearest = bounds.range[by * bounds.across + bx].1;
                let in_front = codes.decode(f64::from(nearest)) - s_focus - self.t;
                in_front > 0.5 && in_front + 1.5 >= gap(self.x, bx).hypot(gap(self.y, by))
            })
        })
    }

    /// Whether another layer has a cell at the highlight's own pixel, in front of it by no more than `within` pixels.
    fn is_covered(&self, padded: &Padded, s_focus: f64, within: f64) -> bool {
        let cell = self.y as usize * padded.padding.stride + self.x as usize;
        let own = padded.codes.encode((self.t + s_focus) as f32);
        padded.layers.iter().any(|layer| {
            let lo = layer.lo[cell];
            lo > own && f64::from(lo - own) * padded.codes.step() <= within
        })
    }

    /// The fraction of a pixel's rays near lens point `l` that meet nothing before they meet the highlight.
    ///
    /// The rays of a pixel are a beam as wide as the pixel at every depth. A cell that covers its pixel partly, and a
    /// cell that the beam meets only partly, let the rest of the beam through.
    fn visible_from(&self, padded: &Padded, s_focus: f64, l: [f64; 2]) -> f32 {
        let longest = l[0].abs().max(l[1].abs());
        if self.is_covered(padded, s_focus, 0.5 / longest) {
            return 0.0;
        }
        if longest == 0.0 {
            return 1.0;
        }
        let code_per_step = 1.0 / (longest * padded.codes.step());
        let start = f64::from(padded.codes.encode((self.t + s_focus) as f32));
        let code = |k: f64| (start + k * code_per_step).min(f64::from(u16::MAX)) as u16;
        // Steps outwards from the highlight, one cell at a time along the longer axis.
        let slope = [l[0] / longest, l[1] / longest];
        let steps = ((padded.reach_px - self.t) * longest).ceil() as i32;
        // A straight edge may be met in more than one cell, but must hide its part of the beam only once.
        let mut visible = 1.0f32;
        let mut k = 1;
        while k <= steps {
            let along = slope.map(|slope| f64::from(k) * slope);
            let cell = [self.x + along[0].round() as i32, self.y + along[1].round() as i32];
            let (stride, rows) = (padded.padding.stride as i32, padded.padding.rows as i32);
            if !(0..stride).contains(&cell[0]) || !(0..rows).contains(&cell[1]) {
                break;
            }
            let (from, to) = (code(f64::from(k) - 0.5), code(f64::from(k) + 0.5));
            let block = cell.map(|v| v as usize / BLOCK);
            if padded.bounds.range[block[1] * padded.bounds.across + block[0]].1 < from {
                // No cell in this block is near enough, and the ray only comes nearer to the camera.
                k += steps_inside(cell, slope);
                continue;
            }
            let index = (cell[1] * stride + cell[0]) as usize;
            for layer in &padded.layers {
                let (lo, hi) = (layer.lo[index], layer.hi[index]);
                if hi >= from && lo < to {
                    // The position of the ray in this cell, relative to the cell's centre; the ray passes through the
                    // highlight.
                    let t_cell = padded.codes.decode(f64::from(lo)) - s_focus - self.t;
                    let at = [0, 1].map(|i| (l[i] * t_cell - along[i].round()) as f32);
                    visible = visible.min(1.0 - layer.partial.covered(index, at));
                }
            }
            if visible == 0.0 {
                break;
            }
            k += 1;
        }
        visible
    }

    /// Adds the part of the disc that is inside a tile.
    fn draw(&self, pass: &HighlightPass, origin: (usize, usize), out: &mut TileColor) {
        let pad = pass.padded.padding.pad as i32;
        // The highlight in the tile's coordinates. A pixel p sees it at the offset q - p of the kernel.
        let (qx, qy) = (self.x - pad - origin.0 as i32, self.y - pad - origin.1 as i32);
        let kernel = pass.kernels.get(kernels::key(self.t));
        for row in &kernel.rows {
            let y = qy - row.dy;
            if !(0..TILE.1 as i32).contains(&y) {
                continue;
            }
            let mut add = |x: i32, weight: f32| {
                let l = [qx - x, row.dy].map(|d| f64::from(d) / self.t);
                let visible =
                    if self.hidden_in_part { self.visible_from(pass.padded, pass.s_focus, l) } else { 1.0 };
                if visible == 0.0 {
                    return;
                }
                let weight = visible * weight;
                let weight = match pass.clip {
                    None => weight,
                    Some(clip) => {
                        let place = [origin.0 as f64 + f64::from(x), origin.1 as f64 + f64::from(y)];
                        weight * clip.share(place, l, self.t) as f32
                    }
                };
                for (plane, e) in out.planes.iter_mut().zip(self.excess) {
                    plane[y as usize * TILE.0 + x as usize] += weight * e;
                }
            };
            // The pixels qx - dx for dx in the run, clipped to the tile.
            let first = (qx - row.run.1 + 1).max(0);
            let end = (qx - row.run.0 + 1).min(TILE.0 as i32);
            for x in first..end {
                add(x, kernel.run_weight);
            }
            for &(dx, weight) in &row.partial {
                let x = qx - dx;
                if (0..TILE.0 as i32).contains(&x) {
                    add(x, weight);
                }
            }
        }
    }
}

/// A lower bound on the number of steps after which a ray from `cell` leaves its block.
fn steps_inside(cell: [i32; 2], slope: [f64; 2]) -> i32 {
    let steps = |i: usize| {
        let (inside, block) = (cell[i] % BLOCK as i32, BLOCK as i32);
        let to_border = if slope[i] > 0.0 { block - inside } else { inside + 1 };
        // Rounding to cells may gain one step.
        f64::from(to_border - 1) / slope[i].abs()
    };
    (steps(0).min(steps(1)) as i32).max(1)
}

impl Highlights {
    /// Draws all highlights that reach tile number `tile`.
    pub fn draw(&self, pass: &HighlightPass, tile: usize, origin: (usize, usize), out: &mut TileColor) {
        for &i in &self.by_tile[tile] {
            self.all[i as usize].draw(pass, origin, out);
        }
    }
}
