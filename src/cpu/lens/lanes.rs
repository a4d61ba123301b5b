//! The few operations of the sweep on a row of 32 cells, for each instruction set.
//!
//! All faces give the same bits: comparisons are exact, and sums are plain additions in the same order.

/// Cells handled at once.
pub const LANES: usize = 32;

/// Half-planes of a row of cells, and the ray that tests them.
#[derive(Clone, Copy)]
pub struct HalfPlaneRow {
    pub normal_x: *const f32,
    pub normal_y: *const f32,
    pub cut: *const f32,
    /// Codes of the cells.
    pub code: *const u16,
    /// Where the ray meets a cell of code `u`, from the cell's centre: `(ax u + bx, ay u + by)`.
    pub ray: Ray,
}

/// See [`HalfPlaneRow::ray`].
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub ax: f32,
    pub bx: f32,
    pub ay: f32,
    pub by: f32,
}

/// A face of the sweep for one instruction set.
///
/// # Safety
///
/// Implementations use instructions that the caller has to have detected, and read `LANES` values from every
/// pointer.
pub unsafe trait Lanes {
    /// Sums of one channel.
    type Sum: Copy;

    /// All sums zero.
    unsafe fn zero() -> Self::Sum;
    /// Bit `i` is set where cell `i` reaches into the codes `from .. to`: `hi >= from && lo < to`.
    unsafe fn hits(lo: *const u16, hi: *const u16, from: u16, to: u16) -> u32;
    /// Adds the values of the cells whose bit is set.
    unsafe fn add(sum: &mut Self::Sum, values: *const f32, mask: u32);
    /// Writes the sums out.
    unsafe fn store(sum: Self::Sum, out: *mut f32);
    /// Bit `i` is set where the ray passes through the covered part of cell `i`.
    unsafe fn covered(row: &HalfPlaneRow) -> u32;
}

/// Any processor.
pub struct Portable;

// SAFETY: no special instructions; reads and writes LANES values as the trait says.
unsafe impl Lanes for Portable {
    type Sum = [f32; LANES];

    #[inline(always)]
    unsafe fn zero() -> Self::Sum {
        [0.0; LANES]
    }

    #[inline(always)]
    unsafe fn hits(lo: *const u16, hi: *const u16, from: u16, to: u16) -> u32 {
        // SAFETY: the caller guarantees LANES readable values.
        let (lo, hi) = unsafe { (&*lo.cast::<[u16; LANES]>(), &*hi.cast::<[u16; LANES]>()) };
        let mut bits = 0;
        for i in 0..LANES {
            bits |= u32::from((hi[i] >= from) & (lo[i] < to)) << i;
        }
        bits
    }

    #[inline(always)]
    unsafe fn add(sum: &mut Self::Sum, values: *const f32, mask: u32) {
        // SAFETY: the caller guarantees LANES readable values.
        let values = unsafe { &*values.cast::<[f32; LANES]>() };
        for i in 0..LANES {
            sum[i] += if mask >> i & 1 != 0 { values[i] } else { 0.0 };
        }
    }

    #[inline(always)]
    unsafe fn store(sum: Self::Sum, out: *mut f32) {
        // SAFETY: the caller guarantees LANES writable values.
        unsafe { out.cast::<[f32; LANES]>().write_unaligned(sum) }
    }

    #[inline(always)]
    unsafe fn covered(row: &HalfPlaneRow) -> u32 {
        let mut bits = 0;
        for i in 0..LANES {
            // SAFETY: the caller guarantees LANES readable values.
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
    use super::{HalfPlaneRow, LANES, Lanes};
    use std::arch::x86_64::*;

    /// AVX-512 F and BW.
    pub struct Avx512;

    // SAFETY: reads and writes LANES values; the caller has detected avx512f and avx512bw.
    unsafe impl Lanes for Avx512 {
        type Sum = [__m512; 2];

        #[inline(always)]
        unsafe fn zero() -> Self::Sum {
            // SAFETY: the caller has detected the instructions.
            unsafe { [_mm512_setzero_ps(); 2] }
        }

        #[inline(always)]
        unsafe fn hits(lo: *const u16, hi: *const u16, from: u16, to: u16) -> u32 {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                let above = _mm512_cmpge_epu16_mask(
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

    // SAFETY: reads and writes LANES values; the caller has detected avx2.
    unsafe impl Lanes for Avx2 {
        type Sum = [__m256; 4];

        #[inline(always)]
        unsafe fn zero() -> Self::Sum {
            // SAFETY: the caller has detected the instructions.
            unsafe { [_mm256_setzero_ps(); 4] }
        }

        #[inline(always)]
        unsafe fn hits(lo: *const u16, hi: *const u16, from: u16, to: u16) -> u32 {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                let from = _mm256_set1_epi16(from.cast_signed());
                let last = _mm256_set1_epi16(to.wrapping_sub(1).cast_signed());
                let inside = |at: usize| {
                    let (lo, hi) =
                        (_mm256_loadu_si256(lo.add(at).cast()), _mm256_loadu_si256(hi.add(at).cast()));
                    // Unsigned order by way of maximum and minimum; `lo < to` is `lo <= to - 1`, as to > 0.
                    _mm256_and_si256(
                        _mm256_cmpeq_epi16(_mm256_max_epu16(hi, from), hi),
                        _mm256_cmpeq_epi16(_mm256_min_epu16(lo, last), lo),
                    )
                };
                // Packing works in 128-bit halves; the permutation puts them back in order.
                let packed =
                    _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi16(inside(0), inside(16)));
                _mm256_movemask_epi8(packed).cast_unsigned()
            }
        }

        #[inline(always)]
        unsafe fn add(sum: &mut Self::Sum, values: *const f32, mask: u32) {
            // SAFETY: as the trait demands of the caller.
            unsafe {
                let bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                for (i, sum) in sum.iter_mut().enumerate() {
                    let bits = _mm256_set1_epi32((mask >> (8 * i)).cast_signed());
                    let lanes = _mm256_cmpeq_epi32(_mm256_and_si256(bits, bit), bit);
                    let values = _mm256_loadu_ps(values.add(8 * i));
                    *sum = _mm256_add_ps(*sum, _mm256_and_ps(values, _mm256_castsi256_ps(lanes)));
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
            for at in (0..LANES).step_by(8) {
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
