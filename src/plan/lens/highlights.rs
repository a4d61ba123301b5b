//! Highlights: cells so bright that single lens samples would show as dots in their discs.
//!
//! The light by which such a cell outshines its surroundings is taken out of the layers and drawn as the exact,
//! area-weighted opening. How much of it nearer surfaces hide at a pixel is found by the [sweep](super::tiles::Work):
//! the same samples add up the light that meets the pixel and the light that would meet it if nothing stood in
//! between. The exact disc times their ratio has no noise where nothing is hidden.
//!
//! Beyond the border of the frame, the mirror image stands in for the surroundings. It has no highlights.

use super::Plan;
use super::disc;
use super::tiles::{Tile, Work};
use crate::scene::colors::CellColor;
use crate::scene::depth_bounds::DepthBounds;
use crate::scene::depth_codes::DepthCodes;
use crate::scene::edges::CONNECTED_PX;
use crate::scene::grid::{BLOCK, TILE};
use crate::scene::layer::SceneLayer;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use rayon::prelude::*;

/// Pixels on each side of a pixel whose samples also tell how much light it sees: a few samples meet the light of a
/// small highlight at any one pixel, forty times as many meet it in its neighbourhood.
pub const WINDOW: usize = 3;

/// The weight of a pixel's own samples where it shows more than one surface, against its nearest neighbours that show
/// one: they only speak where there are no such neighbours, as in hair.
pub const OWN_WEIGHT: f32 = 1e-3;

/// The weight of a neighbour for the visibility at a pixel, by its offset and by how far apart the shifts of the two
/// pixels are. What hides a light in focus has a sharp edge, and the pixels beyond it see other surfaces.
#[inline(always)]
pub fn neighbour_weight(offset: [i32; 2], apart_px: f32) -> f32 {
    let [x, y] = offset.map(|v| v.unsigned_abs() as usize);
    let near = ((WINDOW + 1 - x) * (WINDOW + 1 - y)) as f32;
    let connected_px = CONNECTED_PX * x.max(y).max(1) as f32;
    near * (2.0 - apart_px / connected_px).clamp(0.0, 1.0)
}

/// The part of the light that is visible, by the light that samples meet and the light that they would meet if nothing
/// stood in between. If no sample says anything, nothing is hidden.
#[inline(always)]
pub fn visible_part(met: f32, all: f32) -> f32 {
    if all > 0.0 { met / all } else { 1.0 }
}

/// Up to this gap between two depth spans of a layer, in pixels of shift, the spans belong to one surface, which does
/// not hide its own light.
pub const SAME_SURFACE_PX: f32 = CONNECTED_PX;
/// From this gap on, they belong to two.
pub const OTHER_SURFACE_PX: f32 = 2.0 * CONNECTED_PX;

/// The part of a highlight's light that a cell of the same layer lets through, which is in front of it by this gap
/// between their depth spans and this distance away. It is all of it if both are on one surface, which goes on as
/// steeply as at the highlight: it rises by the highlight's own span from pixel to pixel.
#[inline(always)]
pub fn same_surface(gap_px: f32, own_span_px: f32, distance_px: f32) -> f32 {
    let beyond = gap_px - own_span_px * distance_px;
    ((OTHER_SURFACE_PX - beyond) / (OTHER_SURFACE_PX - SAME_SURFACE_PX)).clamp(0.0, 1.0)
}

/// The light of one cell, and its disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Highlight {
    /// Pixel of the frame.
    pub x: i32,
    pub y: i32,
    /// Shift in pixels.
    pub t: f64,
    /// The light by which the cell outshines its surroundings.
    pub excess: [f32; 4],
    /// The discs between which its own lies, in steps of [`disc::APART`], and the share of the second.
    pub steps: [i32; 2],
    pub share: f32,
}

impl Highlight {
    fn new(index: usize, width: usize, t: f64, excess: [f32; 4]) -> Highlight {
        let position = disc::position_of(t);
        let first = position.floor();
        Highlight {
            x: (index % width) as i32,
            y: (index / width) as i32,
            t,
            excess,
            steps: [first as i32, position.ceil() as i32],
            share: (position - first) as f32,
        }
    }

    /// No pixel of the disc is farther from the highlight's own than this, along either axis.
    pub fn reach(&self) -> i32 {
        self.t.abs().ceil() as i32 + 1
    }

    /// The discs between which its own lies, with their shares.
    pub fn discs(&self) -> impl Iterator<Item = (i32, f32)> + use<> {
        let shares = [1.0 - self.share, self.share];
        self.steps.into_iter().zip(shares).filter(|(_, share)| *share > 0.0)
    }
}

/// The highlights of a scene under one focus.
#[derive(Default)]
pub struct Highlights {
    pub all: Vec<Highlight>,
    /// For each layer, the colours of their cells without that light.
    pub dimmed: Vec<Vec<CellColor>>,
    /// For each layer, that light.
    pub light: Vec<Vec<CellColor>>,
    /// For each tile, the highlights that reach it, in order.
    pub by_tile: Vec<Vec<u32>>,
    /// For each tile, whether a nearer surface may hide a part of the light that reaches it.
    pub hidden_in_part: Vec<bool>,
}

impl Highlights {
    /// The highlights of a scene, unless all tiles are copies, which show them as they are.
    pub fn new(scene: &LayeredScene, plan: &Plan, simd: Simd) -> Highlights {
        if plan.tiles.iter().all(|tile| tile.work == Work::Copy) {
            return Highlights::default();
        }
        let mut found = Highlights::default();
        let mut codes = Vec::new();
        for (i, bright) in scene.bright(simd).iter().enumerate() {
            let layer: &SceneLayer = &scene.layers[i];
            // A cell that has a colour and no depth is empty.
            let bright = || bright.iter().filter(|bright| !layer.s[bright.index].is_nan());
            let of = |index: usize, color: [f32; 4]| CellColor { index, color };
            found.dimmed.push(bright().map(|b| of(b.index, b.dim)).collect());
            found.light.push(bright().map(|b| of(b.index, b.excess)).collect());
            for b in bright() {
                let t = f64::from(layer.s[b.index]) - plan.s_focus;
                found.all.push(Highlight::new(b.index, scene.size.width, t, b.excess.map(|e| b.area * e)));
                codes.push((i, scene.depths[i].hi[b.index]));
            }
        }
        found.sort_into_tiles(plan);
        let hidden: Vec<bool> = found
            .all
            .par_iter()
            .zip(&codes)
            .map(|(highlight, &(layer, nearest))| may_be_hidden(highlight, layer, nearest, scene, plan))
            .collect();
        let any = |list: &Vec<u32>| list.iter().any(|&i| hidden[i as usize]);
        let swept = |tile: &Tile| matches!(tile.work, Work::Sweep { .. });
        found.hidden_in_part =
            plan.tiles.iter().zip(&found.by_tile).map(|(tile, list)| swept(tile) && any(list)).collect();
        found
    }

    fn sort_into_tiles(&mut self, plan: &Plan) {
        let across = plan.padding.width.div_ceil(TILE.0);
        self.by_tile = vec![Vec::new(); plan.tiles.len()];
        let down = plan.tiles.len() / across;
        for (i, h) in self.all.iter().enumerate() {
            let reach = h.reach();
            let range = |v: i32, side: usize, n: usize| {
                let first = (v - reach).max(0) as usize / side;
                let end = ((v + reach).max(-1) + side as i32) as usize / side;
                first..end.min(n)
            };
            for ty in range(h.y, TILE.1, down) {
                for tx in range(h.x, TILE.0, across) {
                    let tile = ty * across + tx;
                    if plan.tiles[tile].work != Work::Copy {
                        self.by_tile[tile].push(i as u32);
                    }
                }
            }
        }
    }

    /// Whether a nearer surface may hide some light anywhere.
    pub fn any_hidden(&self) -> bool {
        self.hidden_in_part.contains(&true)
    }

    /// The radius steps of all discs.
    pub fn keys(&self) -> impl Iterator<Item = i32> + '_ {
        self.all.iter().flat_map(|h| h.steps).map(|step| step * disc::APART)
    }
}

/// Whether some cell of the scene lies between a highlight of a layer and some point of the lens. The nearest code of
/// the highlight's span is `nearest`.
fn may_be_hidden(h: &Highlight, layer: usize, nearest: u16, scene: &LayeredScene, plan: &Plan) -> bool {
    let DepthBounds { range, across, .. } = &plan.bounds;
    let codes: &DepthCodes = &scene.codes;
    let cell = h.y as usize * scene.size.width + h.x as usize;
    if (0..scene.layers.len()).any(|other| other != layer && scene.depths[other].lo[cell] > nearest) {
        return true;
    }
    let (x, y) = (h.x + plan.padding.pad as i32, h.y + plan.padding.pad as i32);
    let own = codes.decode(f64::from(nearest));
    let reach = codes.decode(f64::from(u16::MAX)) - own;
    let blocks = |v: i32, n: usize| {
        let first = (f64::from(v) - reach - 1.5).max(0.0) as usize / BLOCK;
        let last = ((f64::from(v) + reach + 1.5).max(0.0) as usize / BLOCK).min(n / BLOCK - 1);
        first..=last
    };
    let gap = |v: i32, b: usize| {
        let (v, lo, hi) = (i64::from(v), (b * BLOCK) as i64, (b * BLOCK + BLOCK - 1) as i64);
        (lo - v).max(v - hi).max(0) as f64
    };
    blocks(y, plan.padding.rows).any(|by| {
        blocks(x, plan.padding.stride).any(|bx| {
            let in_front = codes.decode(f64::from(range[by * across + bx].1)) - own;
            in_front > f64::from(SAME_SURFACE_PX) && in_front + 1.5 >= gap(x, bx).hypot(gap(y, by))
        })
    })
}
