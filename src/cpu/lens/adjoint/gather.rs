//! What the view of one lens sample adds to the cells that it meets: their shares of what pixels give, and how the picture
//! changes with their shifts.
//!
//! What one lens sample sees is a picture of its own, `V(p)`. A cell of shift `t` is drawn in it where the lens point `l`
//! moves it, `l t` away: a square of one pixel, of which a pixel shows the part that it shares. So when the cell moves,
//! light changes only at its borders with its neighbours, by the difference between both, in the pixel across which the
//! border lies.
//!
//! A surface is a flight of stairs: each cell is a step with a top, and between two steps is the wall at their border. A ray that
//! comes down over the second of two cells toward the first one (`l > 0`) meets the second one if it is down at its top
//! before it leaves it, and else the first one, or the wall below it. So it is the top of the second cell that tells where the
//! border is drawn, and for `l < 0` that of the first, whichever is nearer. Where a surface ends before another, its rim
//! moves alone, and what is behind it stays: a ray also passes below the last cell's bottom.
//!
//! A ray meets one cell, so the neighbours are what the rays of the neighbouring pixels meet, and what is between them. A border
//! lies across the one or the other of both pixels: its own shift says where. Nearly everywhere, neighbours are as far away
//! from their pixels, and so beside each other on a surface: many of these are worked on together, and the other pairs one by
//! one.

use super::around::{Around, Layer, Sums};
use super::met::Met;
use super::pairs::{OfPairs, Pair, both};
use super::plane_set::group;
use super::views::{ACROSS, Blind, GROUPS, GroupViews, LensPoint, SHARES, Views, of_share};
#[cfg(target_arch = "x86_64")]
use crate::cpu::lens::lanes::Avx2Floats;
use crate::cpu::lens::lanes::{FLOATS, Floats};
use crate::cpu::lens::padded::Padded;
use crate::scene::grid::TILE;
use crate::simd::{InstructionSet, Simd};

/// Some of the pixels of a group, a bit for each.
type Lanes = u16;
const ALL: Lanes = Lanes::MAX;
/// All but the last one.
const NOT_LAST: Lanes = ALL >> 1;
/// So many pairs of pixels wait, and those of one group and lens point.
const PAIRS: usize = 256;
const NOTHING: [u32; FLOATS] = [Met::NOTHING.code(); FLOATS];

/// Adds to the cells around a tile what its pixels see.
pub struct Gather<'a, const C: usize> {
    pub padded: &'a Padded,
    pub around: &'a mut Around,
    pub views: &'a Views,
    /// Whether the derivatives by shifts are added, too.
    pub of_shifts: bool,
    /// Pairs that wait for others, of which many are worked on one after another.
    pub pairs: &'a mut Vec<Pair>,
}

/// Pixels beside each other.
struct Pixels<'a, F, const C: usize> {
    /// The first of them in the tile.
    first: usize,
    /// What each gives to each of its samples; and what the next ones along each axis give, to as many.
    own: [F; C],
    next: [[F; C]; 2],
    /// Those that have a next one along each axis in the tile, and those in front of which there is none that is swept.
    inside: [Lanes; 2],
    begins: [Lanes; 2],
    /// What they see, and what the groups on the right and below see in the tile.
    views: GroupViews<'a>,
    right: Option<GroupViews<'a>>,
    below: Option<GroupViews<'a>>,
}

/// What pixels have met through one lens point, and what the next ones below, and the one behind the last of them. Beyond the tile
/// that is the same.
struct Seen {
    own: [u32; FLOATS],
    below: [u32; FLOATS],
    behind: u32,
}

impl Seen {
    /// What the next pixel along an axis has met.
    #[inline(always)]
    fn next(&self, axis: usize, lane: usize) -> Met {
        let right = || if lane + 1 < FLOATS { self.own[lane + 1] } else { self.behind };
        Met::of_code(if axis == 0 { right() } else { self.below[lane] })
    }
}

macro_rules! instantiate {
    ($($name:ident, $floats:ty, $($feature:literal)?;)*) => {
        $(
            /// # Safety
            ///
            /// The instructions have been detected.
            $(#[target_feature(enable = $feature)])?
            unsafe fn $name<const C: usize>(gather: &mut Gather<C>) {
                for group in 0..GROUPS {
                    // SAFETY: per the function's contract.
                    unsafe { gather.add_group::<$floats>(group) };
                }
            }
        )*
    };
}

instantiate! {
    portable, [f32; FLOATS], ;
}
#[cfg(target_arch = "x86_64")]
instantiate! {
    avx2, Avx2Floats, "avx2";
    avx512, std::arch::x86_64::__m512, "avx512f,avx512bw";
}

impl<'a, F: Floats, const C: usize> Pixels<'a, F, C> {
    /// What pixels from one on give to each of their samples.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn shares(views: &Views, at: usize) -> [F; C] {
        let from = views.given().0.groups::<C>(0, at);
        // SAFETY: per the function's contract.
        unsafe {
            let mut shares = [F::all(0.0); C];
            for c in 0..C {
                shares[c] = F::load(from[c]);
            }
            shares
        }
    }

    /// The pixels of a group.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn new(views: &'a Views, is_first: [bool; 2], group: usize) -> Pixels<'a, F, C> {
        let (x, y) = (group % ACROSS, group / ACROSS);
        let (is_last, first) = ([x + 1 == ACROSS, y + 1 == TILE.1], y * TILE.0 + x * FLOATS);
        let share = of_share(first);
        // SAFETY: per the function's contract.
        unsafe {
            Pixels {
                first,
                own: Self::shares(views, share),
                next: [Self::shares(views, share + 1), Self::shares(views, share + SHARES)],
                inside: [if is_last[0] { NOT_LAST } else { ALL }, if is_last[1] { 0 } else { ALL }],
                begins: [Lanes::from(is_first[0] && x == 0), if is_first[1] && y == 0 { ALL } else { 0 }],
                views: views.of_group(group),
                right: (!is_last[0]).then(|| views.of_group(group + 1)),
                below: (!is_last[1]).then(|| views.of_group(group + ACROSS)),
            }
        }
    }
}

impl<const C: usize> Gather<'_, C> {
    /// Adds the shares of all cells that are met, and how the sum changes with their shifts. Pixels that have met nothing keep
    /// the colour of their own cell of the first layer.
    pub fn add(&mut self, simd: Simd) {
        for Blind { pixel, given } in self.views.given().1 {
            let at = self.around.index(*pixel, Met::OWN);
            let sums = self.around.layers[0].sums.as_mut().expect("every tile may meet the first layer");
            (0..C).for_each(|c| sums.by_color.plane_mut(c)[at] += given[c]);
        }
        // SAFETY: the instructions have been detected, otherwise this `Simd` would not exist.
        unsafe {
            match simd.instruction_set() {
                InstructionSet::Portable => portable(self),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2 => avx2(self),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512 => avx512(self),
            }
        }
    }

    /// Adds what the pixels of one group see through all lens points, one after another: what they give stays at hand.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_group<F: Floats>(&mut self, group: usize) {
        // SAFETY: per the function's contract.
        unsafe {
            let views = self.views;
            let pixels = Pixels::<F, C>::new(views, self.around.is_first, group);
            for (rank, lens) in views.lens.iter().enumerate() {
                self.add_views(&pixels, rank, lens);
                if self.pairs.len() >= PAIRS {
                    self.add_pairs();
                }
            }
            self.add_pairs();
        }
    }

    /// Adds what pixels see through the lens point of a rank.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_views<F: Floats>(&mut self, pixels: &Pixels<F, C>, rank: usize, lens: &LensPoint) {
        let Pixels { views: own, right, below, .. } = pixels;
        let is_alike =
            |next: &Option<GroupViews>| next.is_none_or(|next| next.whole(rank) == own.whole(rank));
        // SAFETY: per the function's contract.
        unsafe {
            if let Some(met) = own.whole(rank).filter(|_| is_alike(right) && is_alike(below)) {
                return self.add_cells::<F>(pixels, (rank, lens), (met, ALL, [ALL; 2]), |_, _| met);
            }
            let own = own.at(rank);
            let behind = right.map_or(own[FLOATS - 1], |right| right.first(rank));
            let seen = Seen { own, below: below.map_or(own, |below| below.at(rank)), behind };
            let mut left = !F::same(&own, &NOTHING);
            while left != 0 {
                let met = own[left.trailing_zeros() as usize];
                let lanes = F::same(&own, &[met; FLOATS]);
                left &= !lanes;
                let right = lanes >> 1 | Lanes::from(behind == met) << (FLOATS - 1);
                let same = [lanes & right, lanes & F::same(&seen.below, &[met; FLOATS])];
                let met = (Met::of_code(met), lanes, same);
                self.add_cells::<F>(pixels, (rank, lens), met, |axis, lane| seen.next(axis, lane));
            }
        }
    }

    /// Adds the shares of the cells that some pixels have met, what the borders change that lie between these and the next ones,
    /// and what pairs of pixels change which have met something else. `same` are those whose next one along each axis has met
    /// the same, and `next` is what the next one of another has met.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_cells<F: Floats>(
        &mut self,
        pixels: &Pixels<F, C>,
        (rank, lens): (usize, &LensPoint),
        (met, lanes, same): (Met, Lanes, [Lanes; 2]),
        next: impl Fn(usize, usize) -> Met,
    ) {
        let at = self.around.index(pixels.first, met);
        // SAFETY: per the function's contract.
        unsafe {
            let zero = F::all(0.0);
            let mut own = [zero; C];
            for c in 0..C {
                own[c] = F::choose(lanes, pixels.own[c], zero);
            }
            let Layer { sums, .. } = &mut self.around.layers[met.layer()];
            let Sums { by_color, .. } = sums.as_mut().expect("the layer is met");
            for (sum, own) in by_color.groups_mut::<C>(at).into_iter().zip(own) {
                F::load(sum).add(own).store(sum);
            }
            if !self.of_shifts {
                return;
            }
            let apart = [1, self.around.region.stride];
            for axis in 0..2 {
                if same[axis] != 0 {
                    self.add_borders::<F>((axis, at), met, same[axis], [own, pixels.next[axis]], lens);
                }
                let first = lanes & pixels.begins[axis];
                if first != 0 {
                    self.add_borders::<F>((axis, at - apart[axis]), met, first, [[zero; C], own], lens);
                }
            }
            let ends = self.ends(at, met);
            for axis in 0..2 {
                let mut pairs = lanes & (!same[axis] | ends[axis]) & pixels.inside[axis];
                while pairs != 0 {
                    let lane = pairs.trailing_zeros() as usize;
                    pairs &= pairs - 1;
                    let next = next(axis, lane);
                    if next != Met::NOTHING {
                        let pixel = pixels.first + lane;
                        let (pixels, mets) = ([pixel, pixel + [1, TILE.0][axis]], [met, next]);
                        let at = [at + lane, self.around.index(pixels[1], next)];
                        self.pairs.push(Pair { pixels, mets, at, axis, rank });
                    }
                }
            }
        }
    }

    /// The cells from `at` on behind which their surface ends, along each axis.
    #[inline(always)]
    fn ends(&self, at: usize, met: Met) -> [Lanes; 2] {
        let ends = group(&self.around.layers[met.layer()].ends, at);
        if u128::from_ne_bytes(*ends) == 0 {
            return [0; 2];
        }
        both(|axis| {
            let mut found = 0;
            for (i, ends) in ends.iter().enumerate() {
                found |= Lanes::from(ends >> axis & 1) << i;
            }
            found
        })
    }

    /// Adds what the borders change that are next along an axis to the cells from `at` on, which are met, each in the one of two
    /// pixels, in front of it and behind, across which it lies.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_borders<F: Floats>(
        &mut self,
        (axis, at): (usize, usize),
        met: Met,
        lanes: Lanes,
        [in_front, behind]: [[F; C]; 2],
        lens: &LensPoint,
    ) {
        let apart = [1, self.around.region.stride][axis];
        // The cell whose top the border moves with.
        let moving = if lens[0][axis] > 0.0 { at + apart } else { at };
        let Layer { top, slopes, sums, .. } = &mut self.around.layers[met.layer()];
        let ([t], slopes) = (top.groups(0, moving), slopes[axis].groups::<C>(0, at));
        let Sums { by_top, .. } = sums.as_mut().expect("the layer is met");
        let [sum] = by_top.groups_mut(moving);
        // SAFETY: per the function's contract.
        unsafe {
            let t = F::load(t);
            let along = t.where_above_0(F::all(lens[1][axis]), F::all(lens[0][axis]));
            // How far the first of both pixels reaches beyond the border.
            let beyond = along.mul(t).sub(F::all(met.away()[axis] as f32));
            let mut dot = F::all(0.0);
            for c in 0..C {
                let share = beyond.where_above_0(in_front[c], behind[c]);
                dot = dot.add(share.mul(F::load(slopes[c])));
            }
            F::load(sum).add(F::choose(lanes, along.mul(dot), F::all(0.0))).store(sum);
        }
    }

    /// Adds what the pairs change that wait.
    fn add_pairs(&mut self) {
        let Gather { padded, around, views, pairs, .. } = self;
        OfPairs::<C> { padded, around, views }.add(pairs);
    }
}
