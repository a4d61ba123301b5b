//! Highlights: cells so bright that single lens samples would show as dots in their discs.
//!
//! The light by which such a cell outshines its surroundings is taken out of the layers and drawn as the exact,
//! area-weighted opening. Cells that lie together are one cluster: what nearer surfaces hide of it is found once for
//! each pixel of their discs.
//!
//! Beyond the border of the frame, the mirror image stands in for the surroundings. It has no highlights.

use super::aberrated::Aberrated;
use super::disc;
use super::in_focus::IN_FOCUS_PX;
use super::tiles::{Tile, Work};
use super::{Plan, padding::Padding};
use crate::scene::colors::CellColor;
use crate::scene::contrast::light_channels;
use crate::scene::depth_codes::DepthCodes;
use crate::scene::edges::CONNECTED_PX;
use crate::scene::grid::{BLOCK, TILE};
use crate::scene::highlights::Bright;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Up to this gap between two depth spans, in pixels of shift, the spans belong to one surface, which does not hide its
/// own light.
pub const SAME_SURFACE_PX: f32 = CONNECTED_PX;
/// From this gap on, they belong to two.
pub const OTHER_SURFACE_PX: f32 = 2.0 * CONNECTED_PX;
/// Up to this radius, and in part up to twice of it, the samples of a sweep draw highlights: so small a disc has hardly
/// more pixels than samples.
const SWEPT_PX: f64 = 0.5 * IN_FOCUS_PX;
/// The side of a cluster, as a fraction of the radius of its discs. What is blurred so much shows nothing finer.
const SIDE: f64 = 1.0 / 16.0;

/// The part of a highlight's light that a cell lets through, which is in front of it by this gap
/// between their depth spans and this distance away. It is all of it if both are on one surface, which goes on as
/// steeply as at the highlight: it rises by the highlight's own span from pixel to pixel.
#[inline(always)]
pub fn same_surface(gap_px: f32, own_span_px: f32, distance_px: f32) -> f32 {
    let beyond = gap_px - own_span_px * distance_px;
    ((OTHER_SURFACE_PX - beyond) / (OTHER_SURFACE_PX - SAME_SURFACE_PX)).clamp(0.0, 1.0)
}

/// The part of the light of a highlight of shift `t` that a sweep leaves to exact discs.
fn drawn_part(t: f64) -> f32 {
    ((t.abs() - SWEPT_PX) / SWEPT_PX).clamp(0.0, 1.0) as f32
}

/// The light of one cell, and its disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Highlight {
    /// Pixel of the frame.
    pub x: i32,
    pub y: i32,
    pub layer: usize,
    /// Shift in pixels.
    pub t: f64,
    /// The light by which the cell outshines its surroundings.
    pub excess: [f32; 4],
    /// The part of the cell's own light that this is, over all channels, and the part of its pixel that the cell covers.
    pub outshining: f32,
    pub area: f32,
    /// The discs between which its own lies, in steps of [`disc::APART`], and the share of the second.
    pub steps: [i32; 2],
    pub share: f32,
    /// The part of its light that is not swept.
    pub drawn: f32,
    /// The part of what is drawn that an aberrated lens draws: not as a disc.
    pub aberrated: f32,
    /// No light of it lands farther away than this, and aberrations included it has about this radius.
    pub radius_px: f64,
}

impl Highlight {
    fn new(
        layer: usize,
        (x, y): (usize, usize),
        t: f64,
        bright: &Bright,
        lights: usize,
        lens: Option<&Aberrated>,
    ) -> Highlight {
        let bounds = lens.map(|lens| lens.at([x as f64, y as f64]).bounds);
        let aberrated = bounds.map_or(0.0, |bounds| 1.0 - bounds.thin(t.abs()));
        let radius_px = t.abs() + bounds.map_or(0.0, |bounds| bounds.offset_px);
        let position = disc::position_of(t);
        let first = position.floor();
        let steps = [first as i32, position.ceil() as i32];
        let (share, drawn) = ((position - first) as f32, drawn_part(radius_px));
        let (outshining, area) = (bright.outshining(lights), bright.area);
        let excess = bright.excess.map(|e| area * e);
        let (x, y) = (x as i32, y as i32);
        Highlight { x, y, layer, t, excess, outshining, area, steps, share, drawn, aberrated, radius_px }
    }

    /// The part of its light that is drawn in a tile. Exact discs hold nothing of highlights, a sweep the part that is not
    /// drawn, and what is as in focus all.
    pub fn drawn_in(&self, tile: &Tile) -> f32 {
        self.drawn + tile.disc_share() * (1.0 - self.drawn) - tile.share_in_focus() * self.drawn
    }

    /// No pixel of the disc is farther from the highlight's own than this, along either axis.
    pub fn reach(&self) -> i32 {
        self.t.abs().ceil() as i32 + 2
    }

    /// The shift by which pixels are told which lens point they see it from: at least the half of a pixel, as which a
    /// smaller disc is drawn.
    pub fn drawn_px(&self) -> f64 {
        self.t.abs().max(0.5).copysign(self.t)
    }

    /// The discs between which its own lies, with their shares.
    pub fn discs(&self) -> impl Iterator<Item = (i32, f32)> + use<> {
        let shares = [1.0 - self.share, self.share];
        self.steps.into_iter().zip(shares).filter(|(_, share)| *share > 0.0)
    }

    /// The cluster to which it belongs: cells of one layer, in a square and in a range of shifts of a side that grows
    /// with the radius in powers of two.
    fn cluster(&self) -> (usize, u32, [i32; 3]) {
        let level = (SIDE * self.radius_px).max(1.0).log2() as u32;
        let side = 1 << level;
        let slice = (self.t / f64::from(side)).floor() as i32;
        (self.layer, level, [slice, self.y.div_euclid(side), self.x.div_euclid(side)])
    }
}

/// Highlights that lie together.
#[derive(Debug, Clone, PartialEq)]
pub struct Cluster {
    pub members: Range<usize>,
    /// The member in their middle. What hides it hides the others.
    pub middle: usize,
    /// Depth codes of the middle: of its span, and of itself.
    pub span: [u16; 2],
    pub code: u16,
    /// Whether a nearer surface may hide a part of the light.
    pub hidden_in_part: bool,
}

/// The highlights of a scene under one focus.
#[derive(Default)]
pub struct Highlights {
    pub all: Vec<Highlight>,
    pub clusters: Vec<Cluster>,
    /// For each layer, the colours of their cells without that light.
    pub dimmed: Vec<Vec<CellColor>>,
    /// For each layer, the colours with which they are swept, if these are not the dimmed ones.
    pub swept: Option<Vec<Vec<CellColor>>>,
    /// For each tile, the clusters that reach it, in order.
    pub by_tile: Vec<Vec<u32>>,
}

impl Highlights {
    /// The highlights of a scene, unless all tiles are in focus, which show them as they are.
    pub fn new(scene: &LayeredScene, plan: &Plan, simd: Simd) -> Highlights {
        if plan.tiles.iter().all(|tile| tile.work == Work::InFocus) {
            return Highlights::default();
        }
        let (width, lights) = (scene.size.width, light_channels(scene.size));
        let (mut found, mut swept) = (Highlights::default(), Vec::new());
        for (i, bright) in scene.highlights(simd).bright.iter().enumerate() {
            // A cell that has a colour and no depth is empty.
            let s = &scene.layers[i].s;
            let bright = || bright.iter().filter(|bright| !s[bright.index].is_nan());
            found.dimmed.push(bright().map(|b| b.with(0.0)).collect());
            let t = |b: &Bright| f64::from(s[b.index]) - plan.s_focus;
            let place = |b: &Bright| (b.index % width, b.index / width);
            let lens = plan.aberrated.as_ref();
            let first = found.all.len();
            found.all.extend(bright().map(|b| Highlight::new(i, place(b), t(b), b, lights, lens)));
            let own = bright().zip(&found.all[first..]);
            swept.push(own.map(|(b, h)| b.with(1.0 - h.drawn)).collect::<Vec<_>>());
        }
        found.swept = found.all.iter().any(|h| h.drawn < 1.0).then_some(swept);
        found.all.par_sort_by_key(Highlight::cluster);
        let mut start = 0;
        for members in found.all.chunk_by(|a, b| a.cluster() == b.cluster()) {
            found.clusters.push(cluster(members, start, scene, plan));
            start += members.len();
        }
        found.sort_into_tiles(plan);
        found
    }

    fn sort_into_tiles(&mut self, plan: &Plan) {
        let Padding { width, height, .. } = plan.padding;
        let (across, down) = (width.div_ceil(TILE.0), height.div_ceil(TILE.1));
        self.by_tile = vec![Vec::new(); plan.tiles.len()];
        for (i, cluster) in self.clusters.iter().enumerate() {
            let members = &self.all[cluster.members.clone()];
            if members.iter().all(|h| h.aberrated == 1.0) {
                continue;
            }
            let range = |of: fn(&Highlight) -> i32, side: usize, n: usize| {
                let first = members.iter().map(|h| of(h) - h.reach()).min().unwrap_or(0);
                let last = members.iter().map(|h| of(h) + h.reach()).max().unwrap_or(-1);
                first.max(0) as usize / side..((last.max(-1) + side as i32) as usize / side).min(n)
            };
            let columns = range(|h| h.x, TILE.0, across);
            for ty in range(|h| h.y, TILE.1, down) {
                for tile in columns.clone().map(|tx| ty * across + tx) {
                    if plan.tiles[tile].work != Work::InFocus {
                        self.by_tile[tile].push(i as u32);
                    }
                }
            }
        }
    }

    /// The radius steps of all discs.
    pub fn keys(&self) -> impl Iterator<Item = i32> + '_ {
        let discs = self.all.iter().filter(|h| h.aberrated < 1.0);
        discs.flat_map(|h| h.steps).map(|step| step * disc::APART)
    }

    /// The clusters that reach a tile.
    pub fn of_tile(&self, tile: usize) -> impl Iterator<Item = &Cluster> {
        self.by_tile.get(tile).into_iter().flatten().map(|&i| &self.clusters[i as usize])
    }
}

/// The cluster of these highlights, the first of which has the number `first`.
fn cluster(members: &[Highlight], first: usize, scene: &LayeredScene, plan: &Plan) -> Cluster {
    let mean = |of: fn(&Highlight) -> i32| {
        members.iter().map(|h| f64::from(of(h))).sum::<f64>() / members.len() as f64
    };
    let (x, y) = (mean(|h| h.x), mean(|h| h.y));
    let off = |h: &Highlight| (f64::from(h.x) - x).hypot(f64::from(h.y) - y);
    let middle =
        (0..members.len()).min_by(|&a, &b| off(&members[a]).total_cmp(&off(&members[b]))).unwrap_or(0);
    let h = &members[middle];
    let cell = h.y as usize * scene.size.width + h.x as usize;
    let depths = &scene.depths[h.layer];
    let span = [depths.lo[cell], depths.hi[cell]];
    let code = scene.codes.encode(scene.layers[h.layer].s[cell]);
    Cluster {
        members: first..first + members.len(),
        middle: first + middle,
        span,
        code,
        hidden_in_part: may_be_hidden(h, span, scene, plan),
    }
}

/// Whether some cell of the scene lies between a highlight with this span of depth and some point of the lens.
fn may_be_hidden(h: &Highlight, span: [u16; 2], scene: &LayeredScene, plan: &Plan) -> bool {
    let codes: &DepthCodes = &scene.codes;
    let cell = h.y as usize * scene.size.width + h.x as usize;
    // A cell of another layer at the same pixel may be in front as soon as it is not entirely behind.
    if (0..scene.layers.len()).any(|other| other != h.layer && scene.depths[other].hi[cell] >= span[0]) {
        return true;
    }
    let [x, y] = [(h.x, 0), (h.y, 1)].map(|(v, i)| v + plan.padding.pad[i] as i32);
    let own = codes.decode(f64::from(span[1]));
    let reach = codes.decode(f64::from(u16::MAX)) - own + 1.5;
    let blocks = |v: i32, n: usize| {
        let first = (f64::from(v) - reach).max(0.0) as usize / BLOCK;
        let last = ((f64::from(v) + reach).max(0.0) as usize / BLOCK).min(n / BLOCK - 1);
        first..=last
    };
    let gap = |v: i32, b: usize| {
        let (v, lo, hi) = (i64::from(v), (b * BLOCK) as i64, (b * BLOCK + BLOCK - 1) as i64);
        (lo - v).max(v - hi).max(0) as f64
    };
    blocks(y, plan.padding.rows).any(|by| {
        blocks(x, plan.padding.stride).any(|bx| {
            let nearest = plan.bounds.range[by * plan.bounds.across + bx].1;
            let in_front = codes.decode(f64::from(nearest)) - own;
            in_front > f64::from(SAME_SURFACE_PX) && in_front + 1.5 >= gap(x, bx).hypot(gap(y, by))
        })
    })
}
