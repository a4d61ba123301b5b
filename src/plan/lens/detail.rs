//! How much detail the sweep has to resolve in each part of the frame.
//!
//! What reaches a place and is blurred by many pixels has nothing to say at the scale of one. It is swept in a
//! [coarser scene](crate::scene::coarser), whose cells are `2^n` pixels wide. The number `n` changes smoothly over the
//! frame, and so do the shares of the scenes between which it lies.

use super::Plan;
use super::padding::Padding;
use super::tiles::reaching;
use crate::rows::mix;
use crate::scene::depth_bounds::{DepthBits, DepthBounds, unite};
use crate::scene::depth_codes::DepthCodes;
use crate::scene::grid::{BLOCK, TILE};
use rayon::prelude::*;
use std::ops::Range;

/// The scenes that are swept: that of the picture's own cells, and those of four and of eight pixels a cell. One of two
/// pixels, with the samples that its pixels need, would take half the work, and where scenes meet both are swept.
pub const SCENES: [usize; 3] = [0, 2, MOST];
const MOST: usize = 3;
/// What is blurred by so much, in the pixels of a coarser scene, is swept there alone. Over a disc of this radius, the
/// square of the place along an axis is 36 on average, a quarter of the square of the radius; the mean over a cell adds a
/// twelfth. The disc has 450 cells, so that what is met of one more or less of them does not show.
const ENOUGH_PX: f64 = 12.0;
/// Before what is swept in a coarser scene alone, both have a share over so much of a doubling of the blur.
const FADE: f32 = 0.5;

/// How much detail the swept tiles of a plan need.
pub struct Detail {
    width: usize,
    height: usize,
    /// Blocks in a row.
    across: usize,
    /// Whether each block is in a tile that is swept.
    swept: Vec<bool>,
    /// For each corner of the blocks, the number `n` of the scene that resolves what reaches the blocks around it.
    corners: Vec<f32>,
}

/// The depths of a scene under one focus, by the bins of their codes.
struct Bins {
    /// The bin of the focus, which may be outside of all.
    focus: i32,
    /// The least blur in each, in pixels.
    least_px: [f64; 256],
}

impl Bins {
    fn new(codes: &DepthCodes, s_focus: f64) -> Bins {
        let focus = (codes.place(s_focus) / 256.0).floor().clamp(-1.0, 256.0) as i32;
        let least_px = std::array::from_fn(|bin| {
            let [a, b] = [bin << 8, (bin << 8) + 256].map(|code| codes.decode(code as f64) - s_focus);
            if a * b <= 0.0 { 0.0 } else { a.abs().min(b.abs()) }
        });
        Bins { focus, least_px }
    }

    /// The least blur of some depths, in pixels; infinite if there are none.
    fn sharpest_px(&self, bits: &DepthBits) -> f64 {
        let at_focus = self.focus.max(0) as usize;
        let blur = |bin: usize| self.least_px[bin];
        let (word, bit) = (at_focus / 64, at_focus % 64);
        let from = |i: usize| match i.cmp(&word) {
            std::cmp::Ordering::Less => 0,
            std::cmp::Ordering::Equal => bits[i] & (u64::MAX << bit),
            std::cmp::Ordering::Greater => bits[i],
        };
        let behind = (0..4).rev().find_map(|i| {
            let before = bits[i] & !from(i);
            (before != 0).then(|| 64 * i + 63 - before.leading_zeros() as usize)
        });
        let in_front = (0..4).find_map(|i| {
            let after = from(i);
            (after != 0).then(|| 64 * i + after.trailing_zeros() as usize)
        });
        let [behind, in_front] = [behind, in_front].map(|bin| bin.map_or(f64::INFINITY, blur));
        behind.min(in_front)
    }
}

/// Least distance in pixels between blocks number `a` and `b` along one axis.
fn gap(a: usize, b: usize) -> f64 {
    match a.abs_diff(b) {
        0 => 0.0,
        apart => ((apart - 1) * BLOCK + 1) as f64,
    }
}

impl Detail {
    /// The detail of a plan; `None` if nothing that is swept is blurred so much that it could be coarser than the picture.
    pub fn new(plan: &Plan, codes: &DepthCodes) -> Option<Detail> {
        let Plan { padding, bounds, s_focus, reach_px, tiles, .. } = plan;
        let level = |blur_px: f64| ((blur_px / ENOUGH_PX).log2() as f32).clamp(0.0, MOST as f32);
        if level(*reach_px) <= SCENES[1] as f32 - FADE {
            return None;
        }
        let Padding { width, height, pad, .. } = *padding;
        // Whole tiles are planned.
        let (across, down) =
            (width.next_multiple_of(TILE.0) / BLOCK, height.next_multiple_of(TILE.1) / BLOCK);
        let mut swept = vec![false; across * down];
        for tile in tiles.iter().filter(|tile| tile.is_swept()) {
            let (x, y) = (tile.origin.0 / BLOCK, tile.origin.1 / BLOCK);
            (y..y + TILE.1 / BLOCK).for_each(|y| swept[y * across + x..][..TILE.0 / BLOCK].fill(true));
        }
        let least = least_blur(bounds, codes, *s_focus, (pad / BLOCK, [across, down]));
        let corner = |x: usize, y: usize| {
            let beside = |v: usize, n: usize| v.saturating_sub(1)..(v + 1).min(n);
            let rows = beside(y, down).map(|y| &least[y * across..][beside(x, across)]);
            level(rows.flatten().fold(f64::INFINITY, |least, blur| least.min(*blur)))
        };
        let corners = (0..(across + 1) * (down + 1)).map(|i| corner(i % (across + 1), i / (across + 1)));
        let detail = Detail { width, height, across, swept, corners: corners.collect() };
        detail.coarsest().is_some().then_some(detail)
    }

    /// The number of the coarsest scene that is needed anywhere; `None` if that is the picture's own.
    pub fn coarsest(&self) -> Option<usize> {
        let extent = |n: usize, of: usize| 0..of.div_ceil(1 << n);
        let is_needed = |n: &usize| self.needs(*n, extent(*n, self.width), extent(*n, self.height), 0);
        SCENES.into_iter().skip(1).rfind(is_needed)
    }

    /// The number of the scene at the corners of a block: above left and right, below left and right.
    fn corners_of(&self, (x, y): (usize, usize)) -> [[f32; 2]; 2] {
        let at = y * (self.across + 1) + x;
        [at, at + self.across + 1].map(|at| [self.corners[at], self.corners[at + 1]])
    }

    /// Whether scene number `n` has a share of what is swept in these columns and rows of its own frame, or within `margin`
    /// of its pixels around them.
    pub fn needs(&self, n: usize, columns: Range<usize>, rows: Range<usize>, margin: usize) -> bool {
        // The blocks of the picture.
        let blocks = |range: Range<usize>, extent: usize| {
            let (first, end) = (range.start.saturating_sub(margin) << n, (range.end + margin) << n);
            first / BLOCK..end.min(extent).div_ceil(BLOCK)
        };
        let columns = blocks(columns, self.width);
        let blocks = blocks(rows, self.height).flat_map(|y| columns.clone().map(move |x| (x, y)));
        let swept = blocks.filter(|(x, y)| self.swept[y * self.across + x]);
        let corners = swept.flat_map(|block| self.corners_of(block)).flatten();
        let (least, most) = corners.fold((f32::MAX, f32::MIN), |(lo, hi), n| (lo.min(n), hi.max(n)));
        // Between its corners a block has all numbers that lie between theirs.
        let [from, to] = shared_between(n);
        least < to && most > from
    }

    /// Writes the share of scene number `n` in each pixel of the tile at `origin`.
    pub fn shares(&self, n: usize, origin: (usize, usize), shares: &mut [f32]) {
        let place = |i: usize| (i as f32 + 0.5) / BLOCK as f32;
        for (y, shares) in shares.chunks_exact_mut(TILE.0).enumerate() {
            for (i, shares) in shares.chunks_exact_mut(BLOCK).enumerate() {
                let [above, below] = self.corners_of((origin.0 / BLOCK + i, (origin.1 + y) / BLOCK));
                let [left, right] = [0, 1].map(|k| mix(above[k], below[k], place(y % BLOCK)));
                for (x, share) in shares.iter_mut().enumerate() {
                    *share = share_of(n, mix(left, right, place(x)));
                }
            }
        }
    }
}

/// The numbers between which scene number `n` has a share.
fn shared_between(n: usize) -> [f32; 2] {
    let from = if n == 0 { f32::NEG_INFINITY } else { n as f32 - FADE };
    let next = SCENES.into_iter().find(|next| *next > n);
    [from, next.map_or(f32::INFINITY, |next| next as f32)]
}

/// The share of scene number `n` where the number is `level`.
#[inline(always)]
fn share_of(n: usize, level: f32) -> f32 {
    let [from, to] = shared_between(n);
    // From nothing to all of it, and then as much of it as of the next one is not there yet.
    let entered = |from: f32| ((level - from) / FADE).clamp(0.0, 1.0);
    entered(from) - entered(to - FADE)
}

/// The least blur in pixels of what reaches each block of the frame, as far as that tells scenes apart. The frame begins
/// `pad` blocks into the bounds, and is `columns` x `rows` blocks.
fn least_blur(
    bounds: &DepthBounds,
    codes: &DepthCodes,
    s_focus: f64,
    (pad, [columns, rows]): (usize, [usize; 2]),
) -> Vec<f64> {
    let bins = Bins::new(codes, s_focus);
    let depths: Vec<DepthBits> = bounds
        .occupied
        .chunks_exact(bounds.layers)
        .map(|layers| {
            let mut all = [0; 4];
            layers.iter().for_each(|bits| unite(&mut all, bits));
            all
        })
        .collect();
    let sharpest: Vec<f64> = depths.iter().map(|bits| bins.sharpest_px(bits)).collect();
    // What is blurred more is swept in the coarsest scene.
    let most = ENOUGH_PX * f64::from(1 << MOST);
    let around = (most as usize + 2).div_ceil(BLOCK);
    // The depths that reach a block from the one so many columns and rows away.
    let reach = |dx: usize, dy: usize| reaching(codes, s_focus, gap(0, dx).hypot(gap(0, dy)));
    let masks: Vec<DepthBits> =
        (0..(around + 1).pow(2)).map(|i| reach(i % (around + 1), i / (around + 1))).collect();
    let of_block = |x: usize, y: usize| {
        let near = |v: usize, n: usize| (v + pad).saturating_sub(around)..(v + pad + around + 1).min(n);
        let mut least = most;
        for by in near(y, bounds.down) {
            for bx in near(x, bounds.across) {
                let b = by * bounds.across + bx;
                if sharpest[b] < least {
                    let mask = &masks[by.abs_diff(y + pad) * (around + 1) + bx.abs_diff(x + pad)];
                    least = least.min(bins.sharpest_px(&std::array::from_fn(|i| depths[b][i] & mask[i])));
                }
            }
        }
        least
    };
    (0..columns * rows).into_par_iter().map(|b| of_block(b % columns, b / columns)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn shares_add_up_to_one(level in 0.0..=MOST as f32) {
            let shares = SCENES.map(|n| share_of(n, level));
            prop_assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{shares:?}");
            for (n, share) in SCENES.into_iter().zip(shares) {
                let [from, to] = shared_between(n);
                prop_assert!(share >= 0.0 && (share > 0.0) == (from < level && level < to), "{n}: {share}");
            }
        }

        #[test]
        fn the_sharpest_depth_is_found(bits in any::<DepthBits>(), focus in -20.0..120.0f64) {
            let codes = DepthCodes::new((0.0, 100.0));
            let bins = Bins::new(&codes, focus);
            let set = (0..256).filter(|bin| bits[bin / 64] >> (bin % 64) & 1 != 0);
            let expected = set.map(|bin| bins.least_px[bin]).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(bins.sharpest_px(&bits), expected);
        }
    }
}
