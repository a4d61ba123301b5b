//! The implementations for x86-64 with AVX2 and with AVX-512.

use super::operations::{HalfPlaneRow, Lanes, bit_masks};
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
            sum[1] = _mm512_mask_add_ps(sum[1], (mask >> 16) as u16, sum[1], _mm512_loadu_ps(values.add(16)));
        }
    }

    #[inline(always)]
    unsafe fn add_weighted(sum: &mut Self::Sum, values: *const f32, weights: *const f32, mask: u32) {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            for (i, half) in [mask as u16, (mask >> 16) as u16].into_iter().enumerate() {
                let (values, weights) = (values.add(16 * i), weights.add(16 * i));
                let product = _mm512_mul_ps(_mm512_loadu_ps(weights), _mm512_loadu_ps(values));
                sum[i] = _mm512_mask_add_ps(sum[i], half, sum[i], product);
            }
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
    // For each cell 16 bits, the size of a depth code; all of them are set or all are clear.
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
            // Saturating subtraction replaces unsigned comparison: `a - b` is zero where `a <= b`. And `lo < to` is
            // `lo <= to - 1`, as to > 0.
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
    unsafe fn add_weighted(sum: &mut Self::Sum, values: *const f32, weights: *const f32, cells: __m256i) {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            let halves = [_mm256_castsi256_si128(cells), _mm256_extracti128_si256::<1>(cells)];
            for (i, half) in halves.into_iter().enumerate() {
                let lanes = _mm256_castsi256_ps(_mm256_cvtepi16_epi32(half));
                let (values, weights) = (values.add(8 * i), weights.add(8 * i));
                let product = _mm256_mul_ps(_mm256_loadu_ps(weights), _mm256_loadu_ps(values));
                sum[i] = _mm256_add_ps(sum[i], _mm256_and_ps(product, lanes));
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
                let u = _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(row.code.add(at).cast())));
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
