//! What the view of one lens sample adds to the cells that it meets: their shares of what pixels give, and how the picture
//! changes with their shifts.
//!
//! What one lens sample sees is a picture of its own, `V(p)`. A cell of shift `t` is drawn in it where the lens point `l`
//! moves it, `l t` away: a square of one pixel, of which a pixel shows the part that it shares. So when the cell moves,
//! light changes only at its borders with its neighbours, by the difference between both, in the pixel across which the
//! border lies. Where a surface goes on, the border moves as both cells do, half as far with each. Where it ends before
//! another, its rim moves alone, and what is behind it stays.
//!
//! A ray meets one cell, so the neighbours are what the rays of the neighbouring pixels meet, and what is between them. A border
//! lies across the one or the other of both pixels: its own shift says where. Nearly everywhere, neighbours are as far away
//! from their pixels, and so beside each other on a surface: many of these are worked on together, and the other pairs one by
//! one.

use super::around::{Around, Layer, Sums, is_one_surface};
use super::met::Met;
use super::plane_set::{PlaneSet, group};
use super::views::{Blind, SHARES, View, Views};
#[cfg(target_arch = "x86_64")]
use crate::cpu::lens::lanes::Avx2Floats;
use crate::cpu::lens::lanes::{FLOATS, Floats};
use crate::plan::lens::lens_samples::LensSample;
use crate::scene::grid::TILE;
use crate::simd::{InstructionSet, Simd};
use std::ops::Range;

/// Pixels of a row, a bit for each.
type Row = u64;
const _: () = assert!(TILE.0 == Row::BITS as usize);
const ALL: Row = Row::MAX;
/// Pixels of a row that have a neighbour behind them in the tile.
const NOT_LAST: Row = ALL >> 1;

/// A lens point as seen from behind the focus, and from in front of it.
type LensPoint = [[f32; 2]; 2];

/// Adds to the cells around a tile.
pub struct Gather<'a, const C: usize> {
    pub around: &'a mut Around,
    /// What each pixel of the tile, and those beyond its last column and row, give to each of their samples.
    pub shares: &'a PlaneSet,
}

/// Rows of a tile that are worked on together. What they meet through lens points of about the same height is in a few rows,
/// and so in the cache of a core: a tile of a wide blur is not.
const STRIP: usize = 8;

/// Adds what the samples of a tile see; if it is asked for, also how the sum changes with the shifts of the cells. Pixels that
/// have met nothing keep the colour of their own cell of the first layer.
pub fn add<const C: usize>(
    views: &mut Views,
    around: &mut Around,
    simd: Simd,
    samples: &[LensSample],
    of_shifts: bool,
) {
    let (shares, blind, views) = views.seen();
    for Blind { pixel, given } in blind {
        let at = around.index(*pixel, Met::OWN);
        let sums = around.layers[0].sums.as_mut().expect("every tile may meet the first layer");
        (0..C).for_each(|c| sums.by_color.plane_mut(c)[at] += given[c]);
    }
    let mut gather = Gather::<C> { around, shares };
    let mut by_height: Vec<usize> = (0..views.len()).collect();
    by_height.sort_by(|a, b| samples[*a].behind[1].total_cmp(&samples[*b].behind[1]));
    for y in (0..TILE.1).step_by(STRIP) {
        for &number in &by_height {
            let sample = of_shifts.then(|| &samples[number]);
            gather.add(simd, &views[number], sample, y..y + STRIP);
        }
    }
}

/// Some pixels beside each other of which a few have met the same.
struct Group {
    /// The first pixel in the tile.
    pixel: usize,
    met: Met,
    /// A bit for each of them.
    lanes: u16,
    /// Those whose next pixel along each axis has met the same, too: their cells are neighbours. Beyond the tile they are taken
    /// to.
    same: [u16; 2],
}

/// Two pixels beside each other along an axis, and what they have met.
struct Pair {
    pixels: [usize; 2],
    mets: [Met; 2],
    /// Where that is around the tile.
    at: [usize; 2],
    axis: usize,
}

/// Where the share of a pixel is.
#[inline(always)]
fn of_share(pixel: usize) -> usize {
    pixel / TILE.0 * SHARES + pixel % TILE.0
}

/// What a function gives for both of a pair.
#[inline(always)]
fn both<T>(of: impl Fn(usize) -> T) -> [T; 2] {
    [of(0), of(1)]
}

/// The pixels of a row that have met the same as those of another.
///
/// # Safety
///
/// The instructions of `F` have been detected.
#[inline(always)]
unsafe fn equal<F: Floats>(a: &[u32], b: &[u32]) -> Row {
    let (mut all, mut x) = (0, 0);
    while x < TILE.0 {
        // SAFETY: per the function's contract.
        all |= Row::from(unsafe { F::same(group(a, x), group(b, x)) }) << x;
        x += FLOATS;
    }
    all
}

macro_rules! instantiate {
    ($($name:ident, $floats:ty, $($feature:literal)?;)*) => {
        $(
            /// # Safety
            ///
            /// The instructions have been detected.
            $(#[target_feature(enable = $feature)])?
            unsafe fn $name<const C: usize>(
                gather: &mut Gather<C>,
                view: &View,
                lens: Option<&LensPoint>,
                rows: Range<usize>,
            ) {
                // SAFETY: per the function's contract.
                unsafe { gather.add_with::<$floats>(view, lens, rows) }
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

impl<const C: usize> Gather<'_, C> {
    /// Adds the shares of the cells that a sample meets from some rows of the tile; of a known one also how the sum changes with
    /// the shifts of the cells.
    fn add(&mut self, simd: Simd, view: &View, sample: Option<&LensSample>, rows: Range<usize>) {
        let lens = sample.map(|sample| [sample.behind, sample.in_front].map(|point| point.map(|v| v as f32)));
        // SAFETY: the instructions have been detected, otherwise this `Simd` would not exist.
        unsafe {
            match simd.instruction_set() {
                InstructionSet::Portable => portable(self, view, lens.as_ref(), rows),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2 => avx2(self, view, lens.as_ref(), rows),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512 => avx512(self, view, lens.as_ref(), rows),
            }
        }
    }

    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_with<F: Floats>(&mut self, view: &View, lens: Option<&LensPoint>, rows: Range<usize>) {
        // SAFETY: per the function's contract.
        unsafe {
            match view {
                View::Even(met) => self.add_even::<F>(*met, lens, rows),
                View::Uneven(codes) => self.add_uneven::<F>(codes, lens, rows),
            }
        }
    }

    /// Adds a view in which all pixels have met the same.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_even<F: Floats>(&mut self, met: Met, lens: Option<&LensPoint>, rows: Range<usize>) {
        for y in rows {
            let (mut ends, mut x) = ([0; 2], 0);
            while x < TILE.0 {
                let group = Group { pixel: y * TILE.0 + x, met, lanes: u16::MAX, same: [u16::MAX; 2] };
                // SAFETY: per the function's contract.
                unsafe { self.add_group::<F>(&group, lens, &mut ends) };
                x += FLOATS;
            }
            if let Some(lens) = lens {
                self.add_pairs(y, ends, lens, |_| met);
            }
        }
    }

    /// Adds a view by what each pixel has met.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_uneven<F: Floats>(&mut self, codes: &[u32], lens: Option<&LensPoint>, rows: Range<usize>) {
        let nothing = [Met::NOTHING.code(); FLOATS];
        for y in rows {
            let row = &codes[y * TILE.0..][..TILE.0];
            let (mut right, mut below) = (ALL, ALL);
            if lens.is_some() {
                let mut next = [row[TILE.0 - 1]; TILE.0];
                next[..TILE.0 - 1].copy_from_slice(&row[1..]);
                // SAFETY: per the function's contract.
                right = unsafe { equal::<F>(row, &next) };
                if y + 1 < TILE.1 {
                    // SAFETY: per the function's contract.
                    below = unsafe { equal::<F>(row, &codes[(y + 1) * TILE.0..][..TILE.0]) };
                }
            }
            let (mut ends, mut x) = ([!right, !below], 0);
            while x < TILE.0 {
                let of_group = |row: Row| (row >> x) as u16;
                let same = [of_group(right), of_group(below)];
                let own = group(row, x);
                // SAFETY: per the function's contract.
                let mut left = !unsafe { F::same(own, &nothing) };
                while left != 0 {
                    let met = Met::of_code(own[left.trailing_zeros() as usize]);
                    // SAFETY: per the function's contract.
                    let lanes = unsafe { F::same(own, &[met.code(); FLOATS]) };
                    left &= !lanes;
                    let group = Group { pixel: y * TILE.0 + x, met, lanes, same };
                    // SAFETY: per the function's contract.
                    unsafe { self.add_group::<F>(&group, lens, &mut ends) };
                }
                x += FLOATS;
            }
            if let Some(lens) = lens {
                self.add_pairs(y, ends, lens, |pixel| Met::of_code(codes[pixel]));
            }
        }
    }

    /// Adds the shares of a group, and of a known lens point what the borders change that lie between its pixels and the next
    /// ones. Notes the pixels behind which surfaces end.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_group<F: Floats>(
        &mut self,
        &Group { pixel, met, lanes, same }: &Group,
        lens: Option<&LensPoint>,
        row_ends: &mut [Row; 2],
    ) {
        let (at, share) = (self.around.index(pixel, met), of_share(pixel));
        // SAFETY: per the function's contract.
        unsafe {
            let zero = F::all(0.0);
            let mut own = [zero; C];
            let Layer { sums, .. } = &mut self.around.layers[met.layer()];
            let Sums { by_color, .. } = sums.as_mut().expect("the layer is met");
            let (shares, by_color) = (self.shares.groups::<C>(0, share), by_color.groups_mut::<C>(at));
            for (c, sum) in by_color.into_iter().enumerate() {
                own[c] = F::choose(lanes, F::load(shares[c]), zero);
                F::load(sum).add(own[c]).store(sum);
            }
            let Some(lens) = lens else { return };
            let apart = [1, self.around.region.stride];
            let is_first = self.around.is_first;
            for axis in 0..2 {
                let pairs = lanes & same[axis];
                if pairs != 0 {
                    let shares = self.shares.groups::<C>(0, share + [1, SHARES][axis]);
                    let mut next = [zero; C];
                    for c in 0..C {
                        next[c] = F::load(shares[c]);
                    }
                    self.add_borders::<F>((axis, at), met, pairs, [own, next], lens);
                }
                // In front of the frame's first pixels there are no others.
                let first = [u16::from(pixel % TILE.0 == 0), if pixel < TILE.0 { u16::MAX } else { 0 }][axis];
                if is_first[axis] && lanes & first != 0 {
                    self.add_borders::<F>(
                        (axis, at - apart[axis]),
                        met,
                        lanes & first,
                        [[zero; C], own],
                        lens,
                    );
                }
            }
        }
        let ends = group(&self.around.layers[met.layer()].ends, at);
        if u128::from_ne_bytes(*ends) != 0 {
            for (axis, row_ends) in row_ends.iter_mut().enumerate() {
                let mut found = 0u16;
                for i in 0..FLOATS {
                    found |= u16::from(ends[i] >> axis & 1) << i;
                }
                *row_ends |= Row::from(found & lanes) << (pixel % TILE.0);
            }
        }
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
        lanes: u16,
        [in_front, behind]: [[F; C]; 2],
        lens: &LensPoint,
    ) {
        let Layer { borders, sums, .. } = &mut self.around.layers[met.layer()];
        let ([t], slopes) = (borders[axis].groups(0, at), borders[axis].groups::<C>(1, at));
        let Sums { by_border, .. } = sums.as_mut().expect("the layer is met");
        let [sum] = by_border[axis].groups_mut(at);
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

    /// Adds what pairs of pixels change: some of row `y`, and their neighbours behind them along each axis, as far as these
    /// are in the tile.
    #[inline(always)]
    fn add_pairs(&mut self, y: usize, pairs: [Row; 2], lens: &LensPoint, met: impl Fn(usize) -> Met) {
        let inside = [NOT_LAST, if y + 1 < TILE.1 { ALL } else { 0 }];
        for axis in 0..2 {
            let mut pixels = pairs[axis] & inside[axis];
            while pixels != 0 {
                let pixel = y * TILE.0 + pixels.trailing_zeros() as usize;
                pixels &= pixels - 1;
                let next = pixel + [1, TILE.0][axis];
                let mets = [met(pixel), met(next)];
                if mets[0] != Met::NOTHING && mets[1] != Met::NOTHING {
                    let pixels = [pixel, next];
                    let at = both(|k| self.around.index(pixels[k], mets[k]));
                    self.add_pair(&Pair { pixels, mets, at, axis }, lens);
                }
            }
        }
    }

    /// Adds what two pixels change, which meet two surfaces, or one in cells that are not beside each other.
    #[inline(always)]
    fn add_pair(&mut self, pair: &Pair, lens: &LensPoint) {
        let &Pair { pixels, mets, at, axis } = pair;
        let [a, b] = both(|k| mets[k].away());
        // From the one cell to the other: on one surface with its shift, as many as pixels.
        let step = both(|along| b[along] - a[along] + i32::from(along == axis));
        let [span_a, span_b] = both(|k| self.around.layers[mets[k].layer()].span[at[k]]);
        // A surface that is seen from the side may show every other cell only, or fewer. It rises by a cell's span from cell
        // to cell.
        let between = (step[0].abs().max(step[1].abs()) - 1).max(0) as u32;
        if !is_one_surface(span_a, span_b, between) {
            // The rim of the nearer one moves. Pairs of pixels in two tiles are not looked at; the others stand for them.
            let side = [TILE.0, TILE.1][axis] as f32;
            self.add_change(pair, usize::from(span_a.1 <= span_b.1), side / (side - 1.0), lens);
        } else if mets[0].layer() == mets[1].layer() && step[axis] >= 0 && step[1 - axis] == 0 {
            let away = a[axis] as f32;
            for passed in 0..step[axis] as usize {
                let at = at[0] + passed * [1, self.around.region.stride][axis];
                self.add_border(pixels, (mets[0].layer(), at), away + passed as f32, axis, lens);
            }
        } else {
            // In two columns and two rows, or two layers: half of it where the one cell is left, and half where the other one is
            // entered.
            (0..2).for_each(|k| self.add_change(pair, k, 0.5, lens));
        }
    }

    /// Adds what a border between two pixels changes: that behind a cell which is `away` from the first of them along an axis.
    #[inline(always)]
    fn add_border(
        &mut self,
        pixels: [usize; 2],
        (layer, at): (usize, usize),
        away: f32,
        axis: usize,
        lens: &LensPoint,
    ) {
        let Layer { borders, sums, .. } = &mut self.around.layers[layer];
        let t = borders[axis].plane(0)[at];
        let along = lens[usize::from(t > 0.0)][axis];
        let across = of_share(pixels[usize::from(along * t - away <= 0.0)]);
        let mut dot = 0.0;
        for c in 0..C {
            dot += self.shares.plane(c)[across] * borders[axis].plane(1 + c)[at];
        }
        let Sums { by_border, .. } = sums.as_mut().expect("the layer is met");
        by_border[axis].plane_mut(0)[at] += along * dot;
    }

    /// Adds a part of what a pair changes with one of its cells: the pixel across which that cell's border lies takes the
    /// difference between both.
    #[inline(always)]
    fn add_change(&mut self, &Pair { pixels, mets, at, axis }: &Pair, k: usize, part: f32, lens: &LensPoint) {
        let layers = both(|k| &self.around.layers[mets[k].layer()]);
        let (lo, hi) = layers[k].span[at[k]];
        let t = layers[k].codes.shift(0.5 * (f32::from(lo) + f32::from(hi)));
        let along = lens[usize::from(t > 0.0)][axis];
        let across = of_share(pixels[usize::from(along * t - mets[k].away()[axis] as f32 <= 0.0)]);
        let mut dot = 0.0;
        for c in 0..C {
            let change = layers[1].color.plane(c)[at[1]] - layers[0].color.plane(c)[at[0]];
            dot += self.shares.plane(c)[across] * change;
        }
        let sums = self.around.layers[mets[k].layer()].sums.as_mut().expect("the layer is met");
        sums.by_shift.plane_mut(0)[at[k]] += part * along * dot;
    }
}
