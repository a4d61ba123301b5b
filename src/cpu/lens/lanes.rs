//! The few operations of the sweep on a row of cells, for each instruction set.
//!
//! All implementations give the same bits: comparisons are exact, and sums are plain additions in the same order.

/// Half-planes of a row of cells, and the ray that tests them.
#[derive(Clone, Copy)]
pub struct HalfPlaneRow {
    pub normal_x: *const f32,
    pub normal_y: *const f32,
    pub cut: *const f32,
    /// DepthCodes of the cells.
    pub code: *const u16,
    /// Where the ray meets a cell of code `u`, from the cell's centre: `(ax u + bx, ay u + by)`.
    pub ray: CellRay,
}

/// See [`HalfPlaneRow::ray`].
#[derive(Clone, Copy, Debug)]
pub struct CellRay {
    pub ax: f32,
    pub bx: f32,
    pub ay: f32,
    pub by: f32,
}

/// The operations of the sweep in one instruction set.
///
/// # Safety
///
/// Implementations use instructions that the caller has to have detected, and read `CELLS` values from every
/// pointer.
pub unsafe trait Lanes {
    /// Cells handled at once, as many as leave the sums of three channels and two rows in registers.
    const CELLS: usize;
    /// Sums of one channel.
    type Sum: Copy;
    /// Some of the cells.
    type Mask: Copy;

    /// All sums zero.
    unsafe fn zero() -> Self::Sum;
    /// The cells whose bit is set.
    unsafe fn mask(bits: u32) -> Self::Mask;
    /// The bits of some cells.
    unsafe fn bits(cells: Self::Mask) -> u32;
    /// Whether there is none.
    unsafe fn is_none(cells: Self::Mask) -> bool;
    /// The cells of both.
    unsafe fn union(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The cells of `a` that are not in `b`.
    unsafe fn without(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Those of some cells that reach into the codes `from .. to`: `hi >= from && lo < to`.
    unsafe fn hits(of: Self::Mask, lo: *const u16, hi: *const u16, from: u16, to: u16) -> Self::Mask;
    /// Adds the values of all cells.
    unsafe fn add_all(sum: &mut Self::Sum, values: *const f32);
    /// Adds the values of some cells.
    unsafe fn add(sum: &mut Self::Sum, values: *const f32, cells: Self::Mask);
    /// Writes the sums out.
    unsafe fn store(sum: Self::Sum, out: *mut f32);
    /// Bit `i` is set where the ray passes through the covered part of cell `i`.
    unsafe fn covered(row: &HalfPlaneRow) -> u32;
}

/// Masks that are bits, on which processors calculate.
macro_rules! bit_masks {
    () => {
        #[inline(always)]
        unsafe fn mask(bits: u32) -> u32 {
            bits
        }

        #[inline(always)]
        unsafe fn bits(cells: u32) -> u32 {
            cells
        }

        #[inline(always)]
        unsafe fn is_none(cells: u32) -> bool {
            cells == 0
        }

        #[inline(always)]
        unsafe fn union(a: u32, b: u32) -> u32 {
            a | b
        }

        #[inline(always)]
        unsafe fn without(a: u32, b: u32) -> u32 {
            a & !b
        }
    };
}

/// Any processor.
pub struct Portable;

// SAFETY: no special instructions; reads and writes CELLS values as the trait says.
unsafe impl Lanes for Portable {
    const CELLS: usize = 32;
    type Sum = [f32; Self::CELLS];
    type Mask = u32;

    bit_masks!();

    #[inline(always)]
    unsafe fn zero() -> Self::Sum {
        [0.0; Self::CELLS]
    }

    #[inline(always)]
    unsafe fn hits(of: u32, lo: *const u16, hi: *const u16, from: u16, to: u16) -> u32 {
        // SAFETY: the caller guarantees CELLS readable values.
        let (lo, hi) = unsafe { (&*lo.cast::<[u16; Self::CELLS]>(), &*hi.cast::<[u16; Self::CELLS]>()) };
        let mut bits = 0;
        for i in 0..Self::CELLS {
            bits |= u32::from((hi[i] >= from) & (lo[i] < to)) << i;
        }
        of & bits
    }

    #[inline(always)]
    unsafe fn add_all(sum: &mut Self::Sum, values: *const f32) {
        // SAFETY: the caller guarantees CELLS readable values.
        let values = unsafe { &*values.cast::<[f32; Self::CELLS]>() };
        for i in 0..Self::CELLS {
            sum[i] += values[i];
        }
    }

    #[inline(always)]
    unsafe fn add(sum: &mut Self::Sum, values: *const f32, mask: u32) {
        // SAFETY: the caller guarantees CELLS readable values.
        let values = unsafe { &*values.cast::<[f32; Self::CELLS]>() };
        for i in 0..Self::CELLS {
            sum[i] += if mask >> i & 1 != 0 { values[i] } else { 0.0 };
        }
    }

    #[inline(always)]
    unsafe fn store(sum: Self::Sum, out: *mut f32) {
        // SAFETY: the caller guarantees CELLS writable values.
        unsafe { out.cast::<[f32; Self::CELLS]>().write_unaligned(sum) }
    }

    #[inline(always)]
    unsafe fn covered(row: &HalfPlaneRow) -> u32 {
        let mut bits = 0;
        for i in 0..Self::CELLS {
            // SAFETY: the caller guarantees CELLS readable values.
            let (nx, ny, cut, code) =
                unsafe { (*row.normal_x.add(i), *row.normal_y.add(i), *row.cut.add(i), *row.code.add(i)) };
            let u = f32::from(code);
            let side = nx * (row.ray.ax * u + row.ray.bx) + ny * (row.ray.ay * u + row.ray.by);
            bits |= u32::from(side <= cut) << i;
        }
        bits
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{HalfPlaneRow, Lanes};
    use std::arch::x86_64::*;

    /// AVX-512 F and BW.
    pub struct Avx512;

    // SAFETY: reads and writes CELLS values; the caller has detected avx512f and avx512bw.
    unsafe impl Lanes for Avx512 {
        const CELLS: usize = 32;
        type Sum = [__m512; 2];
        type Mask = u32;

        bit_masks!();

        #[inline(always)]
        unsafe fn zero() -> Self::Sum {
            // SAFETY: the caller has detected the instructions.
            unsafe { [_mm512_setzero_ps(); 2] }
        }

        #[inline(always)]
        unsafe fn hits(of: u32, lo: *const u16, hi: *const u16, from: u16, to: u16) -> u32 {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                let above = _mm512_mask_cmpge_epu16_mask(
                    of,
                    _mm512_loadu_si512(hi.cast()),
                    _mm512_set1_epi16(from.cast_signed()),
                );
                _mm512_mask_cmplt_epu16_mask(
                    above,
                    _mm512_loadu_si512(lo.cast()),
                    _mm512_set1_epi16(to.cast_signed()),
                )
            }
        }

        #[inline(always)]
        unsafe fn add_all(sum: &mut Self::Sum, values: *const f32) {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                sum[0] = _mm512_add_ps(sum[0], _mm512_loadu_ps(values));
                sum[1] = _mm512_add_ps(sum[1], _mm512_loadu_ps(values.add(16)));
            }
        }

        #[inline(always)]
        unsafe fn add(sum: &mut Self::Sum, values: *const f32, mask: u32) {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                sum[0] = _mm512_mask_add_ps(sum[0], mask as u16, sum[0], _mm512_loadu_ps(values));
                sum[1] =
                    _mm512_mask_add_ps(sum[1], (mask >> 16) as u16, sum[1], _mm512_loadu_ps(values.add(16)));
            }
        }

        #[inline(always)]
        unsafe fn store(sum: Self::Sum, out: *mut f32) {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                _mm512_storeu_ps(out, sum[0]);
                _mm512_storeu_ps(out.add(16), sum[1]);
            }
        }

        #[inline(always)]
        unsafe fn covered(row: &HalfPlaneRow) -> u32 {
            let mut bits = 0;
            for half in 0..2 {
                let at = half * 16;
                // SAFETY: as the trait demands of the caller.
                let mask = unsafe {
                    let code = _mm512_cvtepu16_epi32(_mm256_loadu_si256(row.code.add(at).cast()));
                    let u = _mm512_cvtepi32_ps(code);
                    let along = |a, b| _mm512_add_ps(_mm512_mul_ps(_mm512_set1_ps(a), u), _mm512_set1_ps(b));
                    let side = _mm512_add_ps(
                        _mm512_mul_ps(_mm512_loadu_ps(row.normal_x.add(at)), along(row.ray.ax, row.ray.bx)),
                        _mm512_mul_ps(_mm512_loadu_ps(row.normal_y.add(at)), along(row.ray.ay, row.ray.by)),
                    );
                    _mm512_cmp_ps_mask::<_CMP_LE_OQ>(side, _mm512_loadu_ps(row.cut.add(at)))
                };
                bits |= u32::from(mask) << at;
            }
            bits
        }
    }

    /// AVX2.
    pub struct Avx2;

    // SAFETY: reads and writes CELLS values; the caller has detected avx2.
    unsafe impl Lanes for Avx2 {
        const CELLS: usize = 16;
        type Sum = [__m256; 2];
        // All bits of the 16 that a cell's depths have.
        type Mask = __m256i;

        #[inline(always)]
        unsafe fn mask(bits: u32) -> __m256i {
            // SAFETY: the caller has detected the instructions.
            unsafe {
                let bit = _mm256_setr_epi16(
                    1,
                    1 << 1,
                    1 << 2,
                    1 << 3,
                    1 << 4,
                    1 << 5,
                    1 << 6,
                    1 << 7,
                    1 << 8,
                    1 << 9,
                    1 << 10,
                    1 << 11,
                    1 << 12,
                    1 << 13,
                    1 << 14,
                    i16::MIN,
                );
                _mm256_cmpeq_epi16(_mm256_and_si256(_mm256_set1_epi16(bits as i16), bit), bit)
            }
        }

        #[inline(always)]
        unsafe fn bits(cells: __m256i) -> u32 {
            // SAFETY: the caller has detected the instructions.
            unsafe {
                let (low, high) = (_mm256_castsi256_si128(cells), _mm256_extracti128_si256::<1>(cells));
                _mm_movemask_epi8(_mm_packs_epi16(low, high)).cast_unsigned()
            }
        }

        #[inline(always)]
        unsafe fn is_none(cells: __m256i) -> bool {
            // SAFETY: the caller has detected the instructions.
            unsafe { _mm256_testz_si256(cells, cells) != 0 }
        }

        #[inline(always)]
        unsafe fn union(a: __m256i, b: __m256i) -> __m256i {
            // SAFETY: the caller has detected the instructions.
            unsafe { _mm256_or_si256(a, b) }
        }

        #[inline(always)]
        unsafe fn without(a: __m256i, b: __m256i) -> __m256i {
            // SAFETY: the caller has detected the instructions.
            unsafe { _mm256_andnot_si256(b, a) }
        }

        #[inline(always)]
        unsafe fn zero() -> Self::Sum {
            // SAFETY: the caller has detected the instructions.
            unsafe { [_mm256_setzero_ps(); 2] }
        }

        #[inline(always)]
        unsafe fn hits(of: __m256i, lo: *const u16, hi: *const u16, from: u16, to: u16) -> __m256i {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                // Subtraction that stops at zero stands in for unsigned comparison: nothing is left of `a - b` where
                // `a <= b`; and `lo < to` is `lo <= to - 1`, as to > 0.
                let from = _mm256_set1_epi16(from.cast_signed());
                let last = _mm256_set1_epi16(to.wrapping_sub(1).cast_signed());
                let below = _mm256_subs_epu16(from, _mm256_loadu_si256(hi.cast()));
                let above = _mm256_subs_epu16(_mm256_loadu_si256(lo.cast()), last);
                let outside = _mm256_or_si256(below, above);
                _mm256_and_si256(of, _mm256_cmpeq_epi16(outside, _mm256_setzero_si256()))
            }
        }

        #[inline(always)]
        unsafe fn add_all(sum: &mut Self::Sum, values: *const f32) {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                sum[0] = _mm256_add_ps(sum[0], _mm256_loadu_ps(values));
                sum[1] = _mm256_add_ps(sum[1], _mm256_loadu_ps(values.add(8)));
            }
        }

        #[inline(always)]
        unsafe fn add(sum: &mut Self::Sum, values: *const f32, cells: __m256i) {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                let halves = [_mm256_castsi256_si128(cells), _mm256_extracti128_si256::<1>(cells)];
                for (i, half) in halves.into_iter().enumerate() {
                    let lanes = _mm256_castsi256_ps(_mm256_cvtepi16_epi32(half));
                    sum[i] = _mm256_add_ps(sum[i], _mm256_and_ps(_mm256_loadu_ps(values.add(8 * i)), lanes));
                }
            }
        }

        #[inline(always)]
        unsafe fn store(sum: Self::Sum, out: *mut f32) {
            for (i, sum) in sum.into_iter().enumerate() {
                // SAFETY: as the trait demands of the caller.
                unsafe { _mm256_storeu_ps(out.add(8 * i), sum) }
            }
        }

        #[inline(always)]
        unsafe fn covered(row: &HalfPlaneRow) -> u32 {
            let mut bits = 0;
            for at in (0..Self::CELLS).step_by(8) {
                // SAFETY: as the trait demands of the caller.
                let mask = unsafe {
                    let u =
                        _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(row.code.add(at).cast())));
                    let along = |a, b| _mm256_add_ps(_mm256_mul_ps(_mm256_set1_ps(a), u), _mm256_set1_ps(b));
                    let side = _mm256_add_ps(
                        _mm256_mul_ps(_mm256_loadu_ps(row.normal_x.add(at)), along(row.ray.ax, row.ray.bx)),
                        _mm256_mul_ps(_mm256_loadu_ps(row.normal_y.add(at)), along(row.ray.ay, row.ray.by)),
                    );
                    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(side, _mm256_loadu_ps(row.cut.add(at))))
                };
                bits |= mask.cast_unsigned() << at;
            }
            bits
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What an implementation finds and adds up, cell by cell.
    unsafe fn found<L: Lanes>(
        of: u32,
        lo: &[u16; 32],
        hi: &[u16; 32],
        (from, to): (u16, u16),
    ) -> (u32, [f32; 32]) {
        let values: [f32; 32] = std::array::from_fn(|i| 1.0 + i as f32);
        let (mut bits, mut sums) = (0, [0.0; 32]);
        for at in (0..32).step_by(L::CELLS) {
            // SAFETY: the caller has detected the instructions, and there are 32 of everything.
            unsafe {
                let hits = L::hits(L::mask(of >> at), lo.as_ptr().add(at), hi.as_ptr().add(at), from, to);
                let mut sum = L::zero();
                L::add(&mut sum, values.as_ptr().add(at), hits);
                L::add_all(&mut sum, values.as_ptr().add(at));
                L::store(sum, sums.as_mut_ptr().add(at));
                assert_eq!(L::is_none(hits), L::bits(hits) == 0);
                let left = L::without(L::mask(of >> at), hits);
                assert_eq!(L::bits(L::union(left, hits)), L::bits(L::mask(of >> at)));
                bits |= L::bits(hits) << at;
            }
        }
        (bits, sums)
    }

    proptest! {
        #[test]
        fn lanes_find_and_add_what_the_comparison_says(
            of in any::<u32>(),
            cells in prop::collection::vec((0u16..9, 0u16..9), 32),
            far in any::<bool>(),
            from in 1u16..8,
            codes in 1u16..8,
        ) {
            // DepthCodes about either end of their range, where signed and unsigned order differ.
            let code = |code: u16| if far && code > 0 { u16::MAX - 16 + code } else { code };
            let lo: [u16; 32] = std::array::from_fn(|i| code(cells[i].0.min(cells[i].1)));
            let hi: [u16; 32] = std::array::from_fn(|i| code(cells[i].0.max(cells[i].1)));
            let (from, to) = (code(from), code(from + codes));
            let met = |i: &usize| of >> i & 1 != 0 && hi[*i] >= from && lo[*i] < to;
            let bits = (0..32).filter(met).fold(0u32, |bits, i| bits | 1 << i);
            let value = |i: usize| (1 + i) as f32 * if bits >> i & 1 != 0 { 2.0 } else { 1.0 };
            let expected = (bits, std::array::from_fn(value));
            // SAFETY: needs nothing.
            prop_assert_eq!(unsafe { found::<Portable>(of, &lo, &hi, (from, to)) }, expected);
            #[cfg(target_arch = "x86_64")]
            if is_x86_feature_detected!("avx2") {
                // SAFETY: detected.
                prop_assert_eq!(unsafe { found::<Avx2>(of, &lo, &hi, (from, to)) }, expected);
            }
            #[cfg(target_arch = "x86_64")]
            if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw") {
                // SAFETY: detected.
                prop_assert_eq!(unsafe { found::<Avx512>(of, &lo, &hi, (from, to)) }, expected);
            }
        }
    }
}
