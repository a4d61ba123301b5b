//! How much detail the sweep has to resolve in each part of the frame.
//!
//! What reaches a place and is blurred by many pixels has nothing to say at the scale of one. It is swept in a
//! [coarser scene](crate::scene::coarser), whose cells are `2^n` pixels wide. The number `n` changes smoothly over the
//! frame, and so do the shares of the scenes between which it lies.

use super::Plan;
use super::padding::Padding;
use super::tiles::{Work, reaching};
use crate::rows::mix;
use crate::scene::depth_bounds::{DepthBits, DepthBounds, unite};
use crate::scene::depth_codes::DepthCodes;
use crate::scene::grid::{BLOCK, TILE};
use rayon::prelude::*;
use std::ops::Range;

/// The scenes that are rendered: that of the picture's own cells, and those of four, eight, and up to 256 pixels a cell. One
/// of two pixels, with the samples that its pixels need, would take half the work, and where scenes meet both are swept.
pub const SCENES: [usize; 8] = [0, 2, 3, 4, 5, 6, 7, MOST];
const MOST: usize = 8;
/// The coarsest scene that blocks of [`BLOCK`] pixels tell from finer ones.
const FIRST: usize = 3;
/// What is blurred by so much, in the pixels of a coarser scene, is swept there alone. Over a disc of this radius, the
/// square of the place along an axis is 36 on average, a quarter of the square of the radius; the mean over a cell adds a
/// twelfth. The disc has 450 cells, so that what is met of one more or less of them does not show.
const ENOUGH_PX: f64 = 12.0;
/// Before what is swept in a coarser scene alone, both have a share over so much of a doubling of the blur.
const FADE: f32 = 0.5;
/// A coarser scene has at least so many cells along each axis: rays that go beyond its mirror image find the next one a part of a
/// cell away from its place.
const CELLS: usize = 8;
/// Exact discs have no noise in which an error could hide, and cost little until they are large. They are rendered in scenes
/// whose number is lower by so much: four times as fine.
const EXACT: f32 = 2.0;
/// The noise of the sweep is as coarse as the cells, and seen the more. Beyond scene number [`FIRST`] they become larger only
/// where discs have eight times as many of them along their radius, and so eight times as many lens points.
const COARSE_NOISE: f32 = 3.0;

/// How a block of the frame is rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    InFocus,
    Disc,
    Swept,
}

impl Kind {
    /// The number of the scene in which a block is rendered, where the least blur is so many doublings of [`ENOUGH_PX`].
    fn number(self, doublings: f32) -> f32 {
        match self {
            Kind::InFocus => 0.0,
            Kind::Disc => (doublings - EXACT).max(0.0),
            Kind::Swept => doublings.min(FIRST as f32).max(doublings - COARSE_NOISE),
        }
    }
}

/// How much detail the tiles of a plan need.
pub struct Detail {
    width: usize,
    height: usize,
    /// Blocks in a row.
    across: usize,
    kinds: Vec<Kind>,
    /// For each corner of the blocks, the least blur of what reaches the blocks around it, in doublings of [`ENOUGH_PX`].
    corners: Vec<f32>,
    /// The number of the coarsest scene that the frame is large enough for.
    coarsest: f32,
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

/// Least distance in pixels between blocks that are `side` pixels wide and so many of them apart along one axis.
fn gap(apart: usize, side: usize) -> f64 {
    if apart == 0 { 0.0 } else { ((apart - 1) * side + 1) as f64 }
}

impl Detail {
    /// The detail of a plan; `None` if nothing is blurred so much that it could be coarser than the picture.
    pub fn new(plan: &Plan, codes: &DepthCodes) -> Option<Detail> {
        let Plan { padding, bounds, s_focus, reach_px, tiles, .. } = plan;
        let Padding { width, height, pad, .. } = *padding;
        let coarsest = (width.min(height) / CELLS).checked_ilog2().map_or(0.0, |n| n.min(MOST as u32) as f32);
        let doublings = |blur_px: f64| ((blur_px / ENOUGH_PX).log2() as f32).max(0.0);
        if doublings(*reach_px).min(coarsest) <= SCENES[1] as f32 - FADE {
            return None;
        }
        // Whole tiles are planned.
        let (across, down) =
            (width.next_multiple_of(TILE.0) / BLOCK, height.next_multiple_of(TILE.1) / BLOCK);
        let mut kinds = vec![Kind::InFocus; across * down];
        for tile in tiles {
            let (x, y) = (tile.origin.0 / BLOCK, tile.origin.1 / BLOCK);
            let own = match tile.work {
                Work::InFocus => Kind::InFocus,
                Work::Disc => Kind::Disc,
                Work::Sweep { .. } => Kind::Swept,
            };
            (y..y + TILE.1 / BLOCK).for_each(|y| kinds[y * across + x..][..TILE.0 / BLOCK].fill(own));
        }
        let bins = Bins::new(codes, *s_focus);
        let frame = Blocks { first: pad.map(|pad| pad / BLOCK), extent: [across, down] };
        let least = least_blur(
            Depths::of(bounds),
            &bins,
            |distance| reaching(codes, *s_focus, distance),
            *reach_px,
            &frame,
        );
        let corner = |x: usize, y: usize| {
            let beside = |v: usize, n: usize| v.saturating_sub(1)..(v + 1).min(n);
            let rows = beside(y, down).map(|y| &least[y * across..][beside(x, across)]);
            doublings(rows.flatten().fold(f64::INFINITY, |least, blur| least.min(*blur)))
        };
        let corners = (0..(across + 1) * (down + 1)).map(|i| corner(i % (across + 1), i / (across + 1)));
        let detail = Detail { width, height, across, kinds, corners: corners.collect(), coarsest };
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
        let kind = self.kinds[y * self.across + x];
        let number = |at: usize| kind.number(self.corners[at]).min(self.coarsest);
        [at, at + self.across + 1].map(|at| [at, at + 1].map(number))
    }

    /// Whether scene number `n` has a share of these columns and rows of its own frame, or within `margin` of its pixels around
    /// them.
    pub fn needs(&self, n: usize, columns: Range<usize>, rows: Range<usize>, margin: usize) -> bool {
        // The blocks of the picture.
        let blocks = |range: Range<usize>, extent: usize| {
            let (first, end) = (range.start.saturating_sub(margin) << n, (range.end + margin) << n);
            first / BLOCK..end.min(extent).div_ceil(BLOCK)
        };
        let columns = blocks(columns, self.width);
        let blocks = blocks(rows, self.height).flat_map(|y| columns.clone().map(move |x| (x, y)));
        let [from, to] = shared_between(n);
        blocks.map(|block| self.corners_of(block)).any(|corners| {
            let (least, most) = corners
                .as_flattened()
                .iter()
                .fold((f32::MAX, f32::MIN), |(lo, hi), n| (lo.min(*n), hi.max(*n)));
            // Between its corners a block has all numbers that lie between theirs.
            least < to && most > from
        })
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

/// Blocks of the padded frame.
struct Blocks {
    first: [usize; 2],
    extent: [usize; 2],
}

impl Blocks {
    /// The blocks of twice the size that overlap these.
    fn doubled(&self) -> Blocks {
        let first = self.first.map(|first| first / 2);
        Blocks {
            first,
            extent: std::array::from_fn(|i| (self.first[i] + self.extent[i]).div_ceil(2) - first[i]),
        }
    }
}

/// The depths that occur in each block of the padded frame.
struct Depths {
    across: usize,
    down: usize,
    bits: Vec<DepthBits>,
}

/// All depths of some sets.
fn union<'a>(sets: impl Iterator<Item = &'a DepthBits>) -> DepthBits {
    sets.fold([0; 4], |mut all, bits| {
        unite(&mut all, bits);
        all
    })
}

impl Depths {
    /// Those of all layers.
    fn of(bounds: &DepthBounds) -> Depths {
        let bits = bounds.occupied.chunks_exact(bounds.layers).map(|layers| union(layers.iter()));
        Depths { across: bounds.across, down: bounds.down, bits: bits.collect() }
    }

    /// Those of blocks of twice the size.
    fn doubled(&self) -> Depths {
        let (across, down) = (self.across.div_ceil(2), self.down.div_ceil(2));
        let of_block = |x: usize, y: usize| {
            let row = |y: usize| &self.bits[y * self.across..][2 * x..(2 * x + 2).min(self.across)];
            union((2 * y..(2 * y + 2).min(self.down)).flat_map(row))
        };
        let bits = (0..across * down).map(|b| of_block(b % across, b / across));
        Depths { across, down, bits: bits.collect() }
    }
}

/// The least blur in pixels of what reaches each block of the frame, as far as that tells scenes apart. `reaching` gives the
/// depths whose discs reach so many pixels.
///
/// What is blurred more than what blocks of one size tell is looked for in blocks of twice the size, where no more of them
/// are around a block than before.
fn least_blur(
    mut depths: Depths,
    bins: &Bins,
    reaching: impl Fn(f64) -> DepthBits,
    reach_px: f64,
    frame: &Blocks,
) -> Vec<f64> {
    let [columns, rows] = frame.extent;
    let mut least = vec![0.0f64; columns * rows];
    let mut blocks = Blocks { ..*frame };
    for doublings in 0.. {
        let side = BLOCK << doublings;
        let most = ENOUGH_PX * f64::from(1 << (FIRST + doublings));
        let of_blocks = least_blur_up_to(most, side, &depths, bins, &reaching, &blocks);
        let block_of = |i: usize, own: usize| ((frame.first[i] + own) >> doublings) - blocks.first[i];
        least.iter_mut().enumerate().for_each(|(b, least)| {
            let (x, y) = (block_of(0, b % columns), block_of(1, b / columns));
            *least = least.max(of_blocks[y * blocks.extent[0] + x]);
        });
        if most >= reach_px {
            break;
        }
        (depths, blocks) = (depths.doubled(), blocks.doubled());
    }
    least
}

/// The least blur of what reaches each of some blocks, which are `side` pixels wide; `most` if it is more.
fn least_blur_up_to(
    most: f64,
    side: usize,
    depths: &Depths,
    bins: &Bins,
    reaching: impl Fn(f64) -> DepthBits,
    blocks: &Blocks,
) -> Vec<f64> {
    let Depths { across, down, bits } = depths;
    let sharpest: Vec<f64> = bits.iter().map(|bits| bins.sharpest_px(bits)).collect();
    let around = (most as usize + 2).div_ceil(side);
    // The depths that reach a block from the one so many columns and rows away.
    let reach = |dx: usize, dy: usize| reaching(gap(dx, side).hypot(gap(dy, side)));
    let masks: Vec<DepthBits> =
        (0..(around + 1).pow(2)).map(|i| reach(i % (around + 1), i / (around + 1))).collect();
    let of_block = |x: usize, y: usize| {
        let near = |v: usize, n: usize| v.saturating_sub(around)..(v + around + 1).min(n);
        let mut least = most;
        for by in near(y, *down) {
            for bx in near(x, *across) {
                let b = by * across + bx;
                if sharpest[b] < least {
                    let mask = &masks[by.abs_diff(y) * (around + 1) + bx.abs_diff(x)];
                    least = least.min(bins.sharpest_px(&std::array::from_fn(|i| bits[b][i] & mask[i])));
                }
            }
        }
        least
    };
    let ([left, above], [columns, rows]) = (blocks.first, blocks.extent);
    (0..columns * rows).into_par_iter().map(|b| of_block(left + b % columns, above + b / columns)).collect()
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
