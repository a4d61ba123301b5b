//! Highlights, drawn as exact discs of which a part is visible.

use super::padded::Padded;
use super::tile_color::TileColor;
use crate::plan::lens::disc::APART;
use crate::plan::lens::highlights::{Cluster, Highlight, Highlights, same_surface};
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::tiles::{Tile, Work};
use crate::scene::depth_bounds::any_bin;
use crate::scene::grid::{BLOCK, TILE};

/// The input for drawing highlights.
pub struct HighlightPass<'a> {
    pub highlights: &'a Highlights,
    pub padded: &'a Padded,
    pub s_focus: f64,
    pub kernels: &'a Kernels,
    pub clip: Option<&'a PupilClip>,
}

/// The light of discs in a tile, as differences between neighbouring pixels: a run of pixels is two numbers. Sums of
/// many lights that begin and end elsewhere need `f64`.
#[derive(Default)]
pub struct Differences {
    /// For each channel and row, one more value than a tile has columns.
    values: Vec<f64>,
    /// For each row, the columns that have light.
    columns: [(usize, usize); TILE.1],
}

impl Differences {
    const ROW: usize = TILE.0 + 1;

    fn clear(&mut self, channels: usize) {
        self.values.clear();
        self.values.resize(channels * TILE.1 * Self::ROW, 0.0);
        self.columns = [(TILE.0, 0); TILE.1];
    }

    /// Adds light to the columns `first .. end` of a row.
    fn add(&mut self, y: usize, (first, end): (i32, i32), weight: f64, light: &[f32; 4]) {
        let [first, end] = [first, end].map(|x| x.clamp(0, TILE.0 as i32) as usize);
        if first < end {
            let columns = &mut self.columns[y];
            *columns = (columns.0.min(first), columns.1.max(end));
            for (plane, light) in self.values.chunks_exact_mut(TILE.1 * Self::ROW).zip(light) {
                let added = weight * f64::from(*light);
                plane[y * Self::ROW + first] += added;
                plane[y * Self::ROW + end] -= added;
            }
        }
    }

    /// Calls `visit(x, y, light)` for every pixel that may have light.
    fn for_each<const C: usize>(&self, mut visit: impl FnMut(usize, usize, [f64; C])) {
        for (y, &(first, end)) in self.columns.iter().enumerate() {
            let mut sum = [0.0; C];
            for x in first..end {
                for (c, sum) in sum.iter_mut().enumerate() {
                    *sum += self.values[(c * TILE.1 + y) * Self::ROW + x];
                }
                visit(x, y, sum);
            }
        }
    }
}

impl HighlightPass<'_> {
    /// Draws all highlights that reach a tile, which has the number `number`.
    pub fn draw<const C: usize>(
        &self,
        number: usize,
        tile: &Tile,
        differences: &mut Differences,
        out: &mut TileColor,
    ) {
        let origin = tile.origin;
        let clusters = || self.highlights.of_tile(number);
        if clusters().next().is_none() {
            return;
        }
        let mut add = |x: usize, y: usize, light: [f64; C], visible: f64| {
            for (plane, light) in out.planes.iter_mut().zip(light) {
                plane[y * TILE.0 + x] += (visible * light) as f32;
            }
        };
        differences.clear(C);
        for cluster in clusters().filter(|cluster| !cluster.hidden_in_part) {
            self.add_discs(cluster, tile, differences);
        }
        differences.for_each::<C>(|x, y, light| add(x, y, light, 1.0));
        for cluster in clusters().filter(|cluster| cluster.hidden_in_part) {
            differences.clear(C);
            self.add_discs(cluster, tile, differences);
            let middle = &self.highlights.all[cluster.middle];
            let lens_point = |x: usize, y: usize| {
                let to = [middle.x - (origin.0 + x) as i32, middle.y - (origin.1 + y) as i32];
                to.map(|d| f64::from(d) / middle.drawn_px())
            };
            differences.for_each::<C>(|x, y, light| {
                let visible = self.visible_from(cluster, middle, lens_point(x, y));
                add(x, y, light, f64::from(visible));
            });
        }
    }

    /// Adds the rows of a cluster's discs that are inside a tile.
    fn add_discs(&self, cluster: &Cluster, tile: &Tile, differences: &mut Differences) {
        for highlight in &self.highlights.all[cluster.members.clone()] {
            let drawn = if tile.work == Work::Disc { 1.0 } else { highlight.drawn };
            for (step, share) in highlight.discs().filter(|_| drawn > 0.0) {
                self.add_disc(highlight, step, drawn * share, tile.origin, differences);
            }
        }
    }

    /// Adds the rows of one disc that are inside the tile at `origin`.
    fn add_disc(
        &self,
        highlight: &Highlight,
        step: i32,
        share: f32,
        origin: (usize, usize),
        differences: &mut Differences,
    ) {
        let kernel = self.kernels.get(step * APART);
        // The highlight in the tile's coordinates. A pixel p sees it at the offset q - p of the kernel.
        let (qx, qy) = (highlight.x - origin.0 as i32, highlight.y - origin.1 as i32);
        // Rows are in the order of dy.
        let first = kernel.rows.partition_point(|row| qy - row.dy >= TILE.1 as i32);
        for row in kernel.rows[first..].iter().take_while(|row| qy - row.dy >= 0) {
            let y = (qy - row.dy) as usize;
            let mut add = |columns: (i32, i32), weight: f32| {
                let weight = f64::from(share) * f64::from(weight);
                let Some(clip) = self.clip else {
                    return differences.add(y, columns, weight, &highlight.excess);
                };
                for x in columns.0.max(0)..columns.1.min(TILE.0 as i32) {
                    let l = [qx - x, row.dy].map(|d| f64::from(d) / highlight.t);
                    let place = [origin.0 as f64 + f64::from(x), (origin.1 + y) as f64];
                    let seen = clip.share(place, l, highlight.t);
                    differences.add(y, (x, x + 1), weight * seen, &highlight.excess);
                }
            };
            add((qx - row.run.1 + 1, qx - row.run.0 + 1), kernel.run_weight);
            for &(dx, weight) in &row.partial {
                add((qx - dx, qx - dx + 1), weight);
            }
        }
    }

    /// Whether another layer has a cell at the middle of a cluster, in front of it by no more than `within` pixels.
    fn is_covered(&self, cluster: &Cluster, middle: &Highlight, cell: usize, within: f64) -> bool {
        let px_per_code = self.padded.codes.step();
        self.padded.layers.iter().enumerate().filter(|(i, _)| *i != middle.layer).any(|(_, layer)| {
            let lo = layer.lo[cell];
            lo > cluster.code && f64::from(lo - cluster.code) * px_per_code <= within
        })
    }

    /// The fraction of a pixel's rays near lens point `l` that meet nothing before they meet a cluster.
    ///
    /// The rays of a pixel are a beam as wide as the pixel at every depth. A cell that covers its pixel partly, and a
    /// cell that the beam meets only partly, let the rest of the beam through.
    fn visible_from(&self, cluster: &Cluster, middle: &Highlight, l: [f64; 2]) -> f32 {
        let padded = self.padded;
        let (stride, rows) = (padded.padding.stride as i32, padded.padding.rows as i32);
        let [x, y] = [middle.x, middle.y].map(|v| v + padded.padding.pad as i32);
        let own = (y * stride + x) as usize;
        let longest = l[0].abs().max(l[1].abs());
        if longest == 0.0 {
            return if self.is_covered(cluster, middle, own, f64::INFINITY) { 0.0 } else { 1.0 };
        }
        if self.is_covered(cluster, middle, own, 0.5 / longest) {
            return 0.0;
        }
        let px_per_code = padded.codes.step();
        let code_per_step = 1.0 / (longest * px_per_code);
        let start = f64::from(cluster.code);
        let code = |k: f64| (start + k * code_per_step).min(f64::from(u16::MAX)) as u16;
        let px = |codes: u16| (f64::from(codes) * px_per_code) as f32;
        let own_span_px = px(cluster.span[1] - cluster.span[0]);
        // Steps outwards from the highlight, one cell at a time along the longer axis.
        let slope = [l[0] / longest, l[1] / longest];
        let steps = ((padded.reach_px - middle.t) * longest).ceil() as i32;
        // A straight edge may be met in more than one cell, but must hide its part of the beam only once.
        let mut visible = 1.0f32;
        let (mut k, mut looked_until) = (1, 1);
        while k <= steps {
            let along = slope.map(|slope| f64::from(k) * slope);
            let moved = along.map(rounded);
            let cell = [x + moved[0], y + moved[1]];
            if !(0..stride).contains(&cell[0]) || !(0..rows).contains(&cell[1]) {
                break;
            }
            let (from, to) = (code(f64::from(k) - 0.5), code(f64::from(k) + 0.5));
            if k >= looked_until {
                looked_until = k + steps_inside(cell, slope);
                let last = code(f64::from(looked_until) - 0.5);
                let block = cell[1] as usize / BLOCK * padded.bounds.across + cell[0] as usize / BLOCK;
                let layers = padded.bounds.layers;
                let depths = &padded.bounds.occupied[block * layers..][..layers];
                if !depths.iter().any(|bits| any_bin(bits, usize::from(from >> 8), usize::from(last >> 8))) {
                    // No cell of this block is at the depths at which the ray passes it.
                    k = looked_until;
                    continue;
                }
            }
            let index = (cell[1] * stride + cell[0]) as usize;
            for (i, layer) in padded.layers.iter().enumerate() {
                let (lo, hi) = (layer.lo[index], layer.hi[index]);
                if hi >= from && lo < to {
                    // The position of the ray in this cell, relative to the cell's centre; the ray passes through the
                    // highlight.
                    let t_cell = padded.codes.decode(f64::from(lo)) - self.s_focus - middle.t;
                    let at = [0, 1].map(|i| (l[i] * t_cell - f64::from(moved[i])) as f32);
                    let let_through = if i == middle.layer {
                        same_surface(px(lo.saturating_sub(cluster.span[1])), own_span_px, k as f32)
                    } else {
                        0.0
                    };
                    visible = visible.min(1.0 - layer.partial.covered(index, at) * (1.0 - let_through));
                }
            }
            if visible == 0.0 {
                break;
            }
            k += 1;
        }
        visible
    }
}

/// Rounds to the nearest integer, halves away from zero; in a few instructions on any processor.
fn rounded(v: f64) -> i32 {
    let magnitude = (v.abs() + 0.5) as i32;
    if v < 0.0 { -magnitude } else { magnitude }
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
