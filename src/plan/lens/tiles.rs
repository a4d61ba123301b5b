//! The work that each tile of the frame needs: next to none in focus, an exact disc, or the full sweep over the lens.

use super::aberrated::{Bounds, Reaches};
use super::in_focus::IN_FOCUS_PX;
use super::padding::Padding;
use crate::optics::SecondStop;
use crate::rows::ITEMS_PER_TASK;
use crate::scene::contrast::{Contrast, Light};
use crate::scene::depth_bounds::{DepthBits, DepthBounds};
use crate::scene::depth_codes::DepthCodes;
use crate::scene::grid::{BLOCK, TILE};
use rayon::prelude::*;

/// The disc of a pixel on a tilted surface is centred `slope * radius / 4` beside it; a quarter of a pixel is
/// tolerated.
const TILT_PX: f64 = 1.0;
/// From this tilt on, a tile is swept alone. In between it is in part an exact disc, so that a tile changes from the one
/// to the other smoothly as the focus does.
const SWEPT_TILT_PX: f64 = 1.5;

/// The work of one tile.
#[derive(Debug, Clone, PartialEq)]
pub enum Work {
    /// Everything that can reach the tile is in focus.
    InFocus,
    /// One closed surface of nearly constant depth: each pixel is the mean over its own disc.
    Disc,
    /// Visibility is resolved for every lens sample.
    Sweep {
        /// Number of samples.
        samples: usize,
        /// The depths that a ray of this tile may meet.
        occupied: DepthBits,
        /// The share of exact discs in the result.
        disc: f32,
        /// The share of what is as in a tile in focus.
        in_focus: f32,
    },
}

/// A tile and its work.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    /// Left column and top row in the frame.
    pub origin: (usize, usize),
    /// No ray of the tile goes farther, in pixels: the radius of the largest disc that reaches it, and the offset of rays
    /// in focus.
    pub reach_px: f64,
    /// How the tile is rendered.
    pub work: Work,
}

impl Tile {
    /// Whether some of the tile is swept.
    pub fn is_swept(&self) -> bool {
        matches!(self.work, Work::Sweep { .. })
    }

    /// The share of exact discs in the result.
    pub fn disc_share(&self) -> f32 {
        match self.work {
            Work::InFocus => 0.0,
            Work::Disc => 1.0,
            Work::Sweep { disc, .. } => disc,
        }
    }

    /// The share of what is swept in the result.
    pub fn swept_share(&self) -> f32 {
        match self.work {
            Work::InFocus | Work::Disc => 0.0,
            Work::Sweep { disc, in_focus, .. } => (1.0 - disc) * (1.0 - in_focus),
        }
    }

    /// The share of what is as in a tile in focus.
    pub fn share_in_focus(&self) -> f32 {
        match self.work {
            Work::InFocus => 1.0,
            Work::Disc => 0.0,
            Work::Sweep { in_focus, .. } => in_focus,
        }
    }
}

/// The depths, by high byte of their codes, whose discs reach at least `distance` pixels.
pub(super) fn reaching(codes: &DepthCodes, s_focus: f64, distance: f64) -> DepthBits {
    let mut bits = [0u64; 4];
    for bin in 0..256usize {
        let shift = |code: usize| (codes.decode(code as f64) - s_focus).abs();
        // One pixel more, for the cell's own width and the ray's start inside its pixel.
        if shift(bin << 8).max(shift((bin << 8) + 256)) + 1.5 >= distance {
            bits[bin / 64] |= 1 << (bin % 64);
        }
    }
    bits
}

/// The input from which tiles are planned.
pub struct Inputs<'a> {
    pub padding: &'a Padding,
    pub codes: &'a DepthCodes,
    /// The bounds of depth of the padded frame.
    pub bounds: &'a DepthBounds,
    pub s_focus: f64,
    /// Set if the second stop clips the opening differently for each pixel: then no disc is the same for a whole
    /// tile.
    pub second_stop: Option<&'a SecondStop>,
    /// Set if the lens has aberrations that change where rays land.
    pub reaches: Option<&'a Reaches>,
    /// The contrast of each padded block; none if all are even.
    pub contrast: Option<&'a [Contrast]>,
}

/// The padded blocks that come within `margin` pixels of the tile at `origin`.
fn blocks_around(
    padding: &Padding,
    origin: (usize, usize),
    margin: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let range = |first: usize, side: usize, n: usize| {
        // What is beyond shows the same as what is inside, at some other place.
        if margin > first || first + side + margin > n {
            return 0..n / BLOCK;
        }
        (first - margin) / BLOCK..(first + side + margin).div_ceil(BLOCK)
    };
    let columns = range(origin.0 + padding.pad[0], TILE.0, padding.stride);
    let rows = range(origin.1 + padding.pad[1], TILE.1, padding.rows);
    rows.flat_map(move |by| columns.clone().map(move |bx| (bx, by)))
}

/// The origins of all tiles of a frame, in the order of rows.
pub fn origins(width: usize, height: usize) -> Vec<(usize, usize)> {
    let rows = (0..height).step_by(TILE.1);
    rows.flat_map(|y| (0..width).step_by(TILE.0).map(move |x| (x, y))).collect()
}

/// Plans the tiles with these origins. `count_samples` gives the number of samples for the radius of the largest disc and the brightness of
/// what reaches the tile.
pub fn plan(
    inputs: &Inputs,
    origins: Vec<(usize, usize)>,
    count_samples: impl Fn(f64, f32) -> usize + Sync,
) -> Vec<Tile> {
    let Inputs { padding, codes, bounds, s_focus, second_stop, reaches, contrast } = *inputs;
    let shift = |code: u16| codes.decode(f64::from(code)) - s_focus;
    let block_reach: Vec<f64> = bounds
        .range
        .iter()
        .map(|&(lo, hi)| if lo > hi { 0.0 } else { shift(lo).abs().max(shift(hi).abs()) })
        .collect();
    let largest = block_reach.iter().copied().fold(0.0, f64::max);
    let masks: Vec<DepthBits> =
        (0..=largest as usize + 3).map(|distance| reaching(codes, s_focus, distance as f64)).collect();

    let plan_tile = |origin: (usize, usize)| {
        let (x0, y0) = (origin.0 + padding.pad[0], origin.1 + padding.pad[1]);
        let (x1, y1) = (x0 + TILE.0, y0 + TILE.1);
        let mut occupied = [0u64; 4];
        let (mut reach, mut steepest) = (0.0f64, Some(0u16));
        let (mut light, mut uneven) = (Light::default(), Vec::<&Contrast>::new());
        let aberrations = reaches.map_or(Bounds::default(), |reaches| reaches.of_tile(origin));
        let offset = aberrations.offset_px;
        for (bx, by) in blocks_around(padding, origin, (largest + offset) as usize + 2) {
            let b = by * bounds.across + bx;
            let gap = |lo: usize, hi: usize, b: usize| {
                lo.saturating_sub((b + 1) * BLOCK - 1).max((b * BLOCK).saturating_sub(hi - 1)) as f64
            };
            let distance = gap(x0, x1, bx).hypot(gap(y0, y1, by));
            if distance > block_reach[b] + offset + 1.5 {
                continue;
            }
            let mask = &masks[((distance - offset).max(0.0) as usize).min(masks.len() - 1)];
            for bits in &bounds.occupied[b * bounds.layers..][..bounds.layers] {
                for i in 0..4 {
                    occupied[i] |= bits[i] & mask[i];
                }
            }
            reach = reach.max(block_reach[b]);
            if let Some(contrast) = contrast.map(|contrast| &contrast[b]) {
                light.add(&contrast.light);
                uneven.extend((!contrast.is_even()).then_some(contrast));
            }
            steepest = steepest.zip(bounds.smooth[b]).map(|(a, b)| a.max(b));
        }
        let one_surface = steepest.filter(|_| second_stop.is_none());
        let disc = one_surface.map_or(0.0, |codes_per_px| {
            let tilt_px = f64::from(codes_per_px) * codes.step() * reach;
            ((SWEPT_TILT_PX - tilt_px) / (SWEPT_TILT_PX - TILT_PX)).clamp(0.0, 1.0) as f32
        });
        // What is as through a thin lens may take the shorter ways.
        let thin = aberrations.thin(reach);
        let [disc, in_focus] = if reach <= IN_FOCUS_PX { [0.0, thin] } else { [thin * disc, 0.0] };
        let limit = light.limit();
        let brightest = uneven.iter().map(|contrast| contrast.times(limit)).fold(1.0, f32::max);
        let samples = count_samples(reach.hypot(aberrations.spread_px), brightest);
        let work = match (in_focus, disc) {
            (1.0, _) => Work::InFocus,
            (_, 1.0) => Work::Disc,
            _ => Work::Sweep { samples, occupied, disc, in_focus },
        };
        Tile { origin, reach_px: reach + offset, work }
    };

    origins.into_par_iter().with_max_len(ITEMS_PER_TASK).map(plan_tile).collect()
}

/// For each padded block, whether the sweep of some of these tiles may read it.
pub fn needed<'a>(
    padding: &Padding,
    bounds: &DepthBounds,
    swept: impl Iterator<Item = &'a Tile>,
) -> Vec<bool> {
    let mut needed = vec![false; bounds.across * bounds.down];
    for tile in swept {
        for (bx, by) in blocks_around(padding, tile.origin, tile.reach_px.ceil() as usize + 2) {
            needed[by * bounds.across + bx] = true;
        }
    }
    needed
}
