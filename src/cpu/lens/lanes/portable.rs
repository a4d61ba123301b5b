//! The implementation for any processor.

use super::operations::{HalfPlaneRow, Lanes, bit_masks};

/// Works on any processor.
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
    unsafe fn add_weighted(sum: &mut Self::Sum, values: *const f32, weights: *const f32, mask: u32) {
        // SAFETY: the caller guarantees CELLS readable values.
        let (values, weights) =
            unsafe { (&*values.cast::<[f32; Self::CELLS]>(), &*weights.cast::<[f32; Self::CELLS]>()) };
        for i in 0..Self::CELLS {
            sum[i] += if mask >> i & 1 != 0 { weights[i] * values[i] } else { 0.0 };
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
