//! Highlights, drawn as exact discs of which a part is visible.

use super::padded::Padded;
use super::surroundings::Surroundings;
use super::tile_color::TileColor;
use crate::plan::lens::disc::APART;
use crate::plan::lens::highlights::{Cluster, Highlight, Highlights, SAME_SURFACE_PX, same_surface};
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::tiles::{Tile, Work};
use crate::scene::grid::{BLOCK, TILE};
use std::cmp::Ordering;

/// Side of the groups of pixels for which it is found together whether nothing hides a cluster.
const GROUP: usize = 8;

/// The input for drawing highlights.
pub struct HighlightPass<'a> {
    pub highlights: &'a Highlights,
    pub padded: &'a Padded,
    pub surroundings: Surroundings,
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
            let mut clear = [[None; TILE.0 / GROUP]; TILE.1 / GROUP];
            differences.for_each::<C>(|x, y, light| {
                let (gx, gy) = (x / GROUP, y / GROUP);
                let is_clear = *clear[gy][gx].get_or_insert_with(|| {
                    let first = lens_point(gx * GROUP, gy * GROUP);
                    let last = lens_point(gx * GROUP + GROUP - 1, gy * GROUP + GROUP - 1);
                    let least = [0, 1].map(|i| first[i].min(last[i]));
                    let greatest = [0, 1].map(|i| first[i].max(last[i]));
                    self.is_clear(cluster, middle, least, greatest)
                });
                let visible =
                    if is_clear { 1.0 } else { self.visible_from(cluster, middle, lens_point(x, y)) };
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

    /// The fraction of a pixel's rays near lens point `l` that meet nothing before they meet a cluster.
    ///
    /// The rays of a pixel are a beam as wide as the pixel at every depth. Where the beam lies between two cells, each
    /// hides the part that it is near, and a cell that covers its pixel partly hides only that part of it.
    fn visible_from(&self, cluster: &Cluster, middle: &Highlight, l: [f64; 2]) -> f32 {
        let padded = self.padded;
        let path = Path::new(cluster, middle, l, padded);
        let (stride, rows) = (padded.padding.stride as i32, padded.padding.rows as i32);
        // With the cells beside it.
        let inside = |cell: [i32; 2]| (1..stride - 1).contains(&cell[0]) && (1..rows - 1).contains(&cell[1]);
        let mut visible = 1.0f32;
        let (mut k, mut looked_until) = (0, 1);
        while k <= path.steps && visible > 0.0 {
            let cell = path.cell(k);
            if !inside(cell) {
                break;
            }
            if k >= looked_until {
                looked_until = k + steps_inside(cell, path.slope);
                let block = cell.map(|v| v as usize / BLOCK);
                let codes = path.codes(k, looked_until);
                if !self.surroundings.has(block, codes, (path.layer, path.hiding)) {
                    // No cell of this block is at the depths at which the beam passes it.
                    k = looked_until;
                    continue;
                }
            }
            let codes = path.codes(k, k);
            for beside in -1..=1 {
                visible -= self.hidden_by(path.beside(cell, beside), k, codes, &path);
            }
            k += 1;
        }
        visible.max(0.0)
    }

    /// Whether beams near all lens points from `least` to `greatest` certainly meet nothing before they meet a cluster.
    ///
    /// The beams form a pyramid with its tip at the cluster. It is looked at in slices, over which it moves by no more
    /// than a block.
    fn is_clear(&self, cluster: &Cluster, middle: &Highlight, least: [f64; 2], greatest: [f64; 2]) -> bool {
        let padded = self.padded;
        let own = padded.padding.index(middle.x as usize, middle.y as usize);
        let mut other_layers = padded.layers.iter().enumerate().filter(|(i, _)| *i != middle.layer);
        if other_layers.any(|(_, layer)| layer.hi[own] >= cluster.code) {
            return false;
        }
        let pad = padded.padding.pad as f64;
        let place = [f64::from(middle.x) + pad, f64::from(middle.y) + pad];
        let farthest = [0, 1].map(|i| least[i].abs().max(greatest[i].abs()));
        let slice = BLOCK as f64 / farthest[0].max(farthest[1]).max(1e-9);
        let code = |px: f64| f64::from(cluster.code) + px / padded.codes.step();
        let hiding = hiding_code(cluster, padded.codes.step());
        let end = padded.reach_px - middle.t;
        let mut from = 0.0;
        while from < end {
            let to = (from + slice).min(end);
            let codes = [code(from), code(to)].map(|code| code.min(f64::from(u16::MAX)) as u16);
            let [columns, rows] = [0, 1].map(|i| {
                let ends = [least[i] * from, least[i] * to, greatest[i] * from, greatest[i] * to];
                let first = ends.iter().copied().fold(f64::INFINITY, f64::min) + place[i];
                let last = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max) + place[i];
                let most = [padded.padding.stride, padded.padding.rows][i] / BLOCK - 1;
                (first.max(0.0) as usize / BLOCK).min(most)..=(last.max(0.0) as usize / BLOCK).min(most)
            });
            let mut blocks = rows.flat_map(|by| columns.clone().map(move |bx| [bx, by]));
            if blocks.any(|block| self.surroundings.has(block, codes, (middle.layer, hiding))) {
                return false;
            }
            from = to;
        }
        true
    }

    /// The fraction of the beam that the cells of a pixel hide, which it passes at step `k` and so between these codes.
    #[inline]
    fn hidden_by(&self, cell: [i32; 2], k: i32, [from, to]: [u16; 2], path: &Path) -> f32 {
        let index = cell[1] as usize * self.padded.padding.stride + cell[0] as usize;
        let mut hidden = 0.0;
        for (i, layer) in self.padded.layers.iter().enumerate() {
            let (lo, hi) = (layer.lo[index], layer.hi[index]);
            if hi < from || lo > to || path.is_behind(cell, i, [lo, hi]) {
                continue;
            }
            let (share, at) = path.passes(cell, k, [lo, hi]);
            if share > 0.0 {
                let let_through = if cell == path.place {
                    0.0
                } else if i == path.layer {
                    path.is_same_surface([lo, u16::MAX], k)
                } else {
                    // The cluster's surface goes on in another layer where its own layer has another surface.
                    let own = &self.padded.layers[path.layer];
                    let has_own = path.is_same_surface([own.lo[index], own.hi[index]], k);
                    path.is_same_surface([lo, u16::MAX], k) * (1.0 - has_own)
                };
                hidden += share * layer.partial.covered(index, at) * (1.0 - let_through);
            }
        }
        hidden
    }
}

/// The code from which on a cell of a cluster's own layer may hide a part of it: what is nearer to its depth is of its
/// surface.
fn hiding_code(cluster: &Cluster, px_per_code: f64) -> u16 {
    let code = f64::from(cluster.span[1]) + f64::from(SAME_SURFACE_PX) / px_per_code;
    code.min(f64::from(u16::MAX)) as u16
}

/// A beam on its way from a highlight to the lens, one cell at a time along the longer axis of the lens point.
struct Path {
    /// The highlight's own cell in the padded frame, its layer, the code of its depth and those of its span.
    place: [i32; 2],
    layer: usize,
    code: f32,
    span: [u16; 2],
    own_span_px: f32,
    /// See [`hiding_code`].
    hiding: u16,
    /// Cells per step along each axis; the longer axis, and the other one.
    slope: [f32; 2],
    longer: usize,
    steps: i32,
    code_per_step: f32,
    px_per_code: f32,
}

impl Path {
    fn new(cluster: &Cluster, middle: &Highlight, l: [f64; 2], padded: &Padded) -> Path {
        let px_per_code = padded.codes.step();
        // A beam through the middle of the lens stays at its pixel. As a very long step, that needs no case of its own.
        let longest = l[0].abs().max(l[1].abs()).max(1e-9);
        let pad = padded.padding.pad as i32;
        Path {
            place: [middle.x + pad, middle.y + pad],
            layer: middle.layer,
            code: f32::from(cluster.code),
            span: cluster.span,
            hiding: hiding_code(cluster, px_per_code),
            own_span_px: (f64::from(cluster.span[1] - cluster.span[0]) * px_per_code) as f32,
            slope: l.map(|l| (l / longest) as f32),
            longer: usize::from(l[1].abs() > l[0].abs()),
            steps: ((padded.reach_px - middle.t) * longest).ceil() as i32,
            code_per_step: (1.0 / (longest * px_per_code)) as f32,
            px_per_code: px_per_code as f32,
        }
    }

    /// The cell nearest to the beam at step `k`.
    fn cell(&self, k: i32) -> [i32; 2] {
        [0, 1].map(|i| self.place[i] + rounded(k as f32 * self.slope[i]))
    }

    /// The cell so many cells aside, along the shorter axis.
    fn beside(&self, mut cell: [i32; 2], cells: i32) -> [i32; 2] {
        cell[1 - self.longer] += cells;
        cell
    }

    /// The least and the greatest code at which the beam is less than a step away from the steps `first ..= last`.
    fn codes(&self, first: i32, last: i32) -> [u16; 2] {
        let code = |k: i32| self.code + k as f32 * self.code_per_step;
        [code(first - 1).max(self.code) as u16, code(last + 1).min(f32::from(u16::MAX)) as u16]
    }

    /// Whether a cell of this span is behind the highlight. Of two cells of one pixel, the one in the earlier layer is in
    /// front where their depths meet.
    fn is_behind(&self, cell: [i32; 2], layer: usize, [lo, hi]: [u16; 2]) -> bool {
        if cell != self.place {
            return f32::from(hi) < self.code;
        }
        match layer.cmp(&self.layer) {
            Ordering::Less => f32::from(hi) < self.code,
            Ordering::Equal => true,
            Ordering::Greater => f32::from(lo) <= self.code,
        }
    }

    /// How much a cell of this span, so many steps away, is of the highlight's surface.
    fn is_same_surface(&self, [lo, hi]: [u16; 2], k: i32) -> f32 {
        let gap = lo.saturating_sub(self.span[1]).max(self.span[0].saturating_sub(hi));
        same_surface(self.px_per_code * f32::from(gap), self.own_span_px, k as f32)
    }

    /// The share of the beam that passes through a cell of this span, and the beam's place relative to the cell's centre.
    fn passes(&self, cell: [i32; 2], k: i32, [lo, hi]: [u16; 2]) -> (f32, [f32; 2]) {
        let middle = self.code + k as f32 * self.code_per_step;
        let code = middle.max(f32::from(lo).max(self.code)).min(f32::from(hi));
        let step = (code - self.code) / self.code_per_step;
        let at = [0, 1].map(|i| step * self.slope[i] - (cell[i] - self.place[i]) as f32);
        let share = at.iter().fold(1.0, |share, at| share * (1.0 - at.abs()).max(0.0));
        (share, at)
    }
}

/// Rounds to the nearest integer, halves away from zero; in a few instructions on any processor.
fn rounded(v: f32) -> i32 {
    let magnitude = (v.abs() + 0.5) as i32;
    if v < 0.0 { -magnitude } else { magnitude }
}

/// A lower bound on the number of steps after which a beam from `cell` leaves its block.
fn steps_inside(cell: [i32; 2], slope: [f32; 2]) -> i32 {
    let steps = |i: usize| {
        let (inside, block) = (cell[i] % BLOCK as i32, BLOCK as i32);
        let to_border = if slope[i] > 0.0 { block - inside } else { inside + 1 };
        // Rounding to cells may gain one step.
        (to_border - 1) as f32 / slope[i].abs()
    };
    (steps(0).min(steps(1)).min(BLOCK as f32) as i32).max(1)
}
