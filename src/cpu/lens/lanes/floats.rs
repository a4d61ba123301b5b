//! Sixteen numbers, for each instruction set.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

/// How many numbers are worked on together.
pub const FLOATS: usize = 16;

/// Sixteen numbers. A subset of them is a bit for each.
///
/// # Safety
///
/// The caller must have detected the instructions that an implementation uses.
pub unsafe trait Floats: Copy {
    /// The same number sixteen times.
    unsafe fn all(value: f32) -> Self;
    unsafe fn load(from: &[f32; FLOATS]) -> Self;
    unsafe fn store(self, to: &mut [f32; FLOATS]);
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn sub(self, other: Self) -> Self;
    unsafe fn mul(self, other: Self) -> Self;
    /// Those from one where this is above 0, the others from another.
    unsafe fn where_above_0(self, from: Self, others: Self) -> Self;
    /// Those of a subset from one, the others from another.
    unsafe fn choose(subset: u16, from: Self, others: Self) -> Self;
    /// The places at which two codes are the same.
    unsafe fn same(a: &[u32; FLOATS], b: &[u32; FLOATS]) -> u16;
}

/// A subset as a sum of bits.
#[inline(always)]
fn subset(is_in: impl Fn(usize) -> bool) -> u16 {
    let mut bits = 0;
    for i in 0..FLOATS {
        bits |= u16::from(is_in(i)) << i;
    }
    bits
}

/// The value of a function of each place.
#[inline(always)]
fn each(of: impl Fn(usize) -> f32) -> [f32; FLOATS] {
    let mut values = [0.0; FLOATS];
    for i in 0..FLOATS {
        values[i] = of(i);
    }
    values
}

// SAFETY: no special instructions.
unsafe impl Floats for [f32; FLOATS] {
    #[inline(always)]
    unsafe fn all(value: f32) -> Self {
        [value; FLOATS]
    }

    #[inline(always)]
    unsafe fn load(from: &[f32; FLOATS]) -> Self {
        *from
    }

    #[inline(always)]
    unsafe fn store(self, to: &mut [f32; FLOATS]) {
        *to = self;
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        each(|i| self[i] + other[i])
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        each(|i| self[i] - other[i])
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        each(|i| self[i] * other[i])
    }

    #[inline(always)]
    unsafe fn where_above_0(self, from: Self, others: Self) -> Self {
        each(|i| if self[i] > 0.0 { from[i] } else { others[i] })
    }

    #[inline(always)]
    unsafe fn choose(chosen: u16, from: Self, others: Self) -> Self {
        each(|i| if chosen >> i & 1 != 0 { from[i] } else { others[i] })
    }

    #[inline(always)]
    unsafe fn same(a: &[u32; FLOATS], b: &[u32; FLOATS]) -> u16 {
        subset(|i| a[i] == b[i])
    }
}

/// In two registers of AVX2.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub struct Avx2Floats([__m256; 2]);

// SAFETY: the caller has detected avx2.
#[cfg(target_arch = "x86_64")]
unsafe impl Floats for Avx2Floats {
    #[inline(always)]
    unsafe fn all(value: f32) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { Avx2Floats([_mm256_set1_ps(value); 2]) }
    }

    #[inline(always)]
    unsafe fn load(from: &[f32; FLOATS]) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { Avx2Floats([_mm256_loadu_ps(from.as_ptr()), _mm256_loadu_ps(from.as_ptr().add(8))]) }
    }

    #[inline(always)]
    unsafe fn store(self, to: &mut [f32; FLOATS]) {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            _mm256_storeu_ps(to.as_mut_ptr(), self.0[0]);
            _mm256_storeu_ps(to.as_mut_ptr().add(8), self.0[1]);
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { Avx2Floats([_mm256_add_ps(self.0[0], other.0[0]), _mm256_add_ps(self.0[1], other.0[1])]) }
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { Avx2Floats([_mm256_sub_ps(self.0[0], other.0[0]), _mm256_sub_ps(self.0[1], other.0[1])]) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { Avx2Floats([_mm256_mul_ps(self.0[0], other.0[0]), _mm256_mul_ps(self.0[1], other.0[1])]) }
    }

    #[inline(always)]
    unsafe fn where_above_0(self, from: Self, others: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            let half = |i: usize| {
                let above = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0[i], _mm256_setzero_ps());
                _mm256_blendv_ps(others.0[i], from.0[i], above)
            };
            Avx2Floats([half(0), half(1)])
        }
    }

    #[inline(always)]
    unsafe fn choose(chosen: u16, from: Self, others: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let half = |chosen: u16, from: __m256, others: __m256| {
                let own = _mm256_and_si256(_mm256_set1_epi32(i32::from(chosen)), bits);
                let mask = _mm256_castsi256_ps(_mm256_cmpeq_epi32(own, bits));
                _mm256_blendv_ps(others, from, mask)
            };
            Avx2Floats([
                half(chosen & 0xff, from.0[0], others.0[0]),
                half(chosen >> 8, from.0[1], others.0[1]),
            ])
        }
    }

    #[inline(always)]
    unsafe fn same(a: &[u32; FLOATS], b: &[u32; FLOATS]) -> u16 {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            let (a, b) = (a.as_ptr(), b.as_ptr());
            let half = |at: usize| {
                let (a, b) = (_mm256_loadu_si256(a.add(at).cast()), _mm256_loadu_si256(b.add(at).cast()));
                _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b)))
            };
            (half(0) | half(8) << 8) as u16
        }
    }
}

// SAFETY: the caller has detected avx512f.
#[cfg(target_arch = "x86_64")]
unsafe impl Floats for __m512 {
    #[inline(always)]
    unsafe fn all(value: f32) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { _mm512_set1_ps(value) }
    }

    #[inline(always)]
    unsafe fn load(from: &[f32; FLOATS]) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { _mm512_loadu_ps(from.as_ptr()) }
    }

    #[inline(always)]
    unsafe fn store(self, to: &mut [f32; FLOATS]) {
        // SAFETY: as the trait demands of the caller.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { _mm512_add_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { _mm512_sub_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { _mm512_mul_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn where_above_0(self, from: Self, others: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            let above = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self, _mm512_setzero_ps());
            _mm512_mask_blend_ps(above, others, from)
        }
    }

    #[inline(always)]
    unsafe fn choose(chosen: u16, from: Self, others: Self) -> Self {
        // SAFETY: as the trait demands of the caller.
        unsafe { _mm512_mask_blend_ps(chosen, others, from) }
    }

    #[inline(always)]
    unsafe fn same(a: &[u32; FLOATS], b: &[u32; FLOATS]) -> u16 {
        // SAFETY: as the trait demands of the caller.
        unsafe {
            _mm512_cmpeq_epi32_mask(
                _mm512_loadu_si512(a.as_ptr().cast()),
                _mm512_loadu_si512(b.as_ptr().cast()),
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What an implementation makes of two rows of numbers, of a subset, and of the numbers' bits as codes.
    unsafe fn found<F: Floats>(
        a: &[f32; FLOATS],
        b: &[f32; FLOATS],
        chosen: u16,
    ) -> (Vec<[u32; FLOATS]>, u16) {
        // SAFETY: the caller has detected the instructions.
        unsafe {
            let (x, y) = (F::load(a), F::load(b));
            let results =
                [x.add(y), x.sub(y), x.mul(y), F::choose(chosen, x, y), F::all(a[3]), x.where_above_0(x, y)];
            let stored = results.map(|result| {
                let mut stored = [0.0; FLOATS];
                result.store(&mut stored);
                stored.map(f32::to_bits)
            });
            let codes = [a, b].map(|values| values.map(f32::to_bits));
            (stored.to_vec(), F::same(&codes[0], &codes[1]))
        }
    }

    proptest! {
        #[test]
        fn all_instruction_sets_find_the_same(
            a in prop::array::uniform16(-2i8..3),
            b in prop::array::uniform16(-2i8..3),
            chosen in any::<u16>(),
        ) {
            let [a, b] = [a, b].map(|values| values.map(|v| 0.1 * f32::from(v)));
            // SAFETY: needs nothing.
            let expected = unsafe { found::<[f32; FLOATS]>(&a, &b, chosen) };
            prop_assert_eq!(expected.0[3][0], if chosen & 1 == 1 { a[0] } else { b[0] }.to_bits());
            prop_assert_eq!(expected.0[5][0], if a[0] > 0.0 { a[0] } else { b[0] }.to_bits());
            prop_assert_eq!(expected.1 & 1 == 1, a[0].to_bits() == b[0].to_bits());
            #[cfg(target_arch = "x86_64")]
            if is_x86_feature_detected!("avx2") {
                // SAFETY: detected.
                prop_assert_eq!(unsafe { found::<Avx2Floats>(&a, &b, chosen) }, expected.clone());
            }
            #[cfg(target_arch = "x86_64")]
            if is_x86_feature_detected!("avx512f") {
                // SAFETY: detected.
                prop_assert_eq!(unsafe { found::<__m512>(&a, &b, chosen) }, expected);
            }
        }
    }
}
