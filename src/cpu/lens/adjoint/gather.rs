//! What the view of one lens sample adds to the cells that it meets: their shares of what pixels give, and how the picture
//! changes with their shifts.
//!
//! What one lens sample sees is a picture of its own, `V(p)`. A cell of shift `t` is drawn in it where the lens point `l`
//! moves it, `l t` away: a square of one pixel, of which a pixel shows the part that it shares. So when the cell moves,
//! light changes only at its borders with its neighbours, by the difference between both, in the pixel across which the
//! border lies. Where a surface goes on, its cells move together. Where it ends before another, its rim moves alone, and what
//! is behind it stays.
//!
//! A ray meets one cell, so the neighbours are what the rays of the neighbouring pixels meet. The border is on that side of
//! the cell on which the middle of the pixel is. Nearly everywhere, neighbours are as far away from their pixels, and so beside
//! each other on a surface: many of these are worked on together, and the other pairs one by one.

use super::around::{Around, Layer, is_one_surface};
use super::met::Met;
use super::views::{Blind, View, Views};
#[cfg(target_arch = "x86_64")]
use crate::cpu::lens::lanes::Avx2Floats;
use crate::cpu::lens::lanes::{FLOATS, Floats};
use crate::plan::lens::lens_samples::LensSample;
use crate::scene::grid::TILE;
use crate::simd::{InstructionSet, Simd};

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
    /// What each pixel of the tile gives to each of its samples.
    pub shares: [&'a [f32]; C],
}

/// Visits what each sample of a tile sees, by its number. Pixels that have met nothing keep the colour of their own cell of the
/// first layer, and are added here.
pub fn visit<const C: usize>(
    views: &mut Views,
    around: &mut Around,
    mut visit: impl FnMut(&mut Gather<C>, usize, &View),
) {
    let (shares, blind, views) = views.seen();
    for Blind { pixel, given } in blind {
        let at = around.index(*pixel, Met::OWN);
        around.layers[0].by_color.iter_mut().zip(given).for_each(|(sum, v)| sum[at] += *v);
    }
    let mut gather = Gather { around, shares: std::array::from_fn(|c| &shares[c][..]) };
    for (sample, view) in views.enumerate() {
        visit(&mut gather, sample, &view);
    }
}

/// Some pixels beside each other of which a few have met the same.
struct Group {
    /// The first pixel in the tile.
    pixel: usize,
    met: Met,
    /// A bit for each of them.
    lanes: u16,
    /// Those whose neighbours in front and behind along each axis have met the same, too: their cells are neighbours. Beyond
    /// the tile they are taken to.
    same: [[u16; 2]; 2],
}

/// The group of values that starts at `at`.
#[inline(always)]
fn group<T>(values: &[T], at: usize) -> &[T; FLOATS] {
    values[at..].first_chunk().expect("planes are longer by a group")
}

#[inline(always)]
fn group_mut(values: &mut [f32], at: usize) -> &mut [f32; FLOATS] {
    values[at..].first_chunk_mut().expect("planes are longer by a group")
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
            unsafe fn $name<const C: usize>(gather: &mut Gather<C>, view: &View, lens: Option<&LensPoint>) {
                // SAFETY: per the function's contract.
                unsafe { gather.add_with::<$floats>(view, lens) }
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
    /// Adds the shares of the cells that a sample meets; of a known one also how the sum changes with the shifts of the cells.
    pub fn add(&mut self, simd: Simd, view: &View, sample: Option<&LensSample>) {
        let lens = sample.map(|sample| [sample.behind, sample.in_front].map(|point| point.map(|v| v as f32)));
        // SAFETY: the instructions have been detected, otherwise this `Simd` would not exist.
        unsafe {
            match simd.instruction_set() {
                InstructionSet::Portable => portable(self, view, lens.as_ref()),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2 => avx2(self, view, lens.as_ref()),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512 => avx512(self, view, lens.as_ref()),
            }
        }
    }

    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_with<F: Floats>(&mut self, view: &View, lens: Option<&LensPoint>) {
        // SAFETY: per the function's contract.
        unsafe {
            match view {
                View::Even(met) => self.add_even::<F>(*met, lens),
                View::Uneven(codes) => self.add_uneven::<F>(codes, lens),
            }
        }
    }

    /// Adds a view in which all pixels have met the same.
    ///
    /// # Safety
    ///
    /// The instructions of `F` have been detected.
    #[inline(always)]
    unsafe fn add_even<F: Floats>(&mut self, met: Met, lens: Option<&LensPoint>) {
        for y in 0..TILE.1 {
            let (mut ends, mut x) = ([0; 2], 0);
            while x < TILE.0 {
                let group = Group { pixel: y * TILE.0 + x, met, lanes: u16::MAX, same: [[u16::MAX; 2]; 2] };
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
    unsafe fn add_uneven<F: Floats>(&mut self, codes: &[u32], lens: Option<&LensPoint>) {
        let nothing = [Met::NOTHING.code(); FLOATS];
        let mut above = ALL;
        for y in 0..TILE.1 {
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
                let same = [[of_group(right << 1 | 1), of_group(right)], [of_group(above), of_group(below)]];
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
            above = below;
        }
    }

    /// Adds the shares of a group. Of a known lens point it adds what those cells change that have neighbours of their own
    /// surface: for each pixel, on the side on which its middle is. Notes the pixels behind which surfaces end.
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
        let at = self.around.index(pixel, met);
        let apart = [1, self.around.stride];
        let Layer { t, slopes, ends, by_color, by_shift, .. } = &mut self.around.layers[met.layer()];
        // SAFETY: per the function's contract.
        unsafe {
            let zero = F::all(0.0);
            let mut shares = [zero; C];
            for c in 0..C {
                shares[c] = F::choose(lanes, F::load(group(self.shares[c], pixel)), zero);
                let sum = group_mut(&mut by_color[c], at);
                F::load(sum).add(shares[c]).store(sum);
            }
            let Some(lens) = lens else { return };
            let t = F::load(group(t, at));
            let in_front_of_focus = t.above_0();
            let mut sum = zero;
            for axis in 0..2 {
                let along = F::choose(in_front_of_focus, F::all(lens[1][axis]), F::all(lens[0][axis]));
                let beyond = along.mul(t).sub(F::all(met.away()[axis] as f32)).above_0();
                let mut dot = zero;
                for c in 0..C {
                    let slopes = &slopes[axis][c];
                    let behind = F::load(group(slopes, at));
                    let in_front = F::load(group(slopes, at - apart[axis]));
                    dot = dot.add(shares[c].mul(F::choose(beyond, behind, in_front)));
                }
                let seen = beyond & same[axis][1] | !beyond & same[axis][0];
                sum = sum.add(F::choose(seen & lanes, along.mul(dot), zero));
            }
            let by_shift = group_mut(by_shift, at);
            F::load(by_shift).add(sum).store(by_shift);
        }
        let ends = group(ends, at);
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
                    self.add_pair([pixel, next], mets, axis, lens);
                }
            }
        }
    }

    /// Adds what two pixels beside each other change, which meet two surfaces, or one in cells that are not beside each other.
    #[inline(always)]
    fn add_pair(&mut self, pixels: [usize; 2], mets: [Met; 2], axis: usize, lens: &LensPoint) {
        let at = both(|k| self.around.index(pixels[k], mets[k]));
        let layers = both(|k| &self.around.layers[mets[k].layer()]);
        let mut dot = [0.0; 2];
        for c in 0..C {
            let [a, b] = both(|k| layers[k].color[c][at[k]]);
            dot = both(|k| dot[k] + self.shares[c][pixels[k]] * (b - a));
        }
        let [span_a, span_b] = both(|k| layers[k].span[at[k]]);
        let t = both(|k| layers[k].t[at[k]]);
        let along = both(|k| lens[usize::from(t[k] > 0.0)][axis]);
        // How far the middles of the pixels are beyond those of their cells.
        let beyond = both(|k| along[k] * t[k] - mets[k].away()[axis] as f32);
        // A surface that is seen from the side may show every other cell only, or fewer. It rises by a cell's span from cell
        // to cell.
        let [a, b] = both(|k| mets[k].away());
        let apart = both(|along| b[along] - a[along] + i32::from(along == axis));
        let between = (apart[0].abs().max(apart[1].abs()) - 1).max(0) as u32;
        // Pairs of pixels in two tiles are not looked at; the others stand for them.
        let side = [TILE.0, TILE.1][axis] as f32;
        let unseen = side / (side - 1.0);
        let changes = if is_one_surface(span_a, span_b, between) {
            [if beyond[0] > 0.0 { dot[0] } else { 0.0 }, if beyond[1] < 0.0 { dot[1] } else { 0.0 }]
        } else if span_a.1 > span_b.1 {
            [unseen * if beyond[0] > 0.0 { dot[0] } else { dot[1] }, 0.0]
        } else {
            [0.0, unseen * if beyond[1] < 0.0 { dot[1] } else { dot[0] }]
        };
        for k in 0..2 {
            self.around.layers[mets[k].layer()].by_shift[at[k]] += along[k] * changes[k];
        }
    }
}
