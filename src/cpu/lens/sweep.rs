//! The sweep: for every sample, the nearest cell that each pixel's ray meets.
//!
//! While the shift of a sample stays within one pixel, all rays of a tile meet the cells at the same offset. So a ray
//! through the scene is a list of segments, near to far. Each segment says: read the cells at this offset and take
//! those whose depth lies in this interval. This needs contiguous loads only, no z-buffer and no gather.

use super::lanes::Portable;
use super::padded::Padded;
use super::segments::Segments;
use super::sweep_rows::Hits;
use super::sweep_tiles::{Pixels, sweep_tile, sweep_tile_of_groups, visit_hits};
use super::tile_color::TileColor;
use crate::plan::lens::Missed;
use crate::simd::{InstructionSet, Simd};

/// One compiled sweep: an instruction set, and a number of channels or groups.
type SweepFn<Out> = unsafe fn(&Padded, &mut Segments, (usize, usize), Missed, &mut Out);

macro_rules! instantiate {
    ($($name:ident, $of_groups:ident, $hits:ident, $lanes:ty, $($feature:literal)?;)*) => {
        $(
            /// # Safety
            ///
            /// As for [`sweep_tile`].
            $(#[target_feature(enable = $feature)])?
            unsafe fn $name<const C: usize>(
                padded: &Padded,
                segments: &mut Segments,
                origin: (usize, usize),
                missed: Missed,
                out: &mut TileColor,
            ) {
                // SAFETY: per the function's contract.
                unsafe { sweep_tile::<$lanes, C>(padded, segments, origin, missed, out) }
            }

            /// # Safety
            ///
            /// As for [`sweep_tile_of_groups`].
            $(#[target_feature(enable = $feature)])?
            unsafe fn $of_groups(
                padded: &Padded,
                segments: &mut Segments,
                origin: (usize, usize),
                missed: Missed,
                out: &mut [TileColor],
            ) {
                // SAFETY: per the function's contract.
                unsafe { sweep_tile_of_groups::<$lanes>(padded, segments, origin, missed, out) }
            }

            /// # Safety
            ///
            /// As for [`visit_hits`].
            $(#[target_feature(enable = $feature)])?
            unsafe fn $hits(
                padded: &Padded,
                segments: &mut Segments,
                origin: (usize, usize),
                missed: Missed,
                visit: impl FnMut(&Pixels, &Segments, &Hits),
            ) {
                // SAFETY: per the function's contract.
                unsafe { visit_hits::<$lanes>(padded, segments, origin, missed, visit) }
            }
        )*
    };
}

instantiate! {
    portable, portable_groups, portable_hits, Portable, ;
}
#[cfg(target_arch = "x86_64")]
instantiate! {
    avx2, avx2_groups, avx2_hits, super::lanes::Avx2, "avx2";
    avx512, avx512_groups, avx512_hits, super::lanes::Avx512, "avx512f,avx512bw";
}

macro_rules! by_channels {
    ($name:ident) => {
        [$name::<1>, $name::<2>, $name::<3>, $name::<4>]
    };
}

/// The sweep for an instruction set and a number of channels.
fn sweep_for(simd: Simd, channels: usize) -> SweepFn<TileColor> {
    let by_channels: [SweepFn<TileColor>; 4] = match simd.instruction_set() {
        InstructionSet::Portable => by_channels!(portable),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => by_channels!(avx2),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => by_channels!(avx512),
    };
    by_channels[channels - 1]
}

/// The sweep of all groups for an instruction set.
fn sweep_of_groups_for(simd: Simd) -> SweepFn<[TileColor]> {
    match simd.instruction_set() {
        InstructionSet::Portable => portable_groups,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => avx2_groups,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => avx512_groups,
    }
}

/// Visits what a tile meets, as [`visit_hits`] does.
///
/// # Safety
///
/// As for [`sweep`].
pub unsafe fn visit_tile(
    simd: Simd,
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed: Missed,
    visit: impl FnMut(&Pixels, &Segments, &Hits),
) {
    // SAFETY: the instructions have been detected, otherwise this `Simd` would not exist; the rest is this function's
    // contract.
    unsafe {
        match simd.instruction_set() {
            InstructionSet::Portable => portable_hits(padded, segments, origin, missed, visit),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => avx2_hits(padded, segments, origin, missed, visit),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => avx512_hits(padded, segments, origin, missed, visit),
        }
    }
}

/// Sweeps the tile at `origin` over all samples of `segments`, for each group of channels.
///
/// # Safety
///
/// The segments were traced in `padded`, from the tile at `origin`: the padding is at least as wide as the largest
/// shift plus the offset of rays in focus and the half pixel of a ray's start, so that every segment stays inside.
pub unsafe fn sweep(
    simd: Simd,
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed: Missed,
    out: &mut [TileColor],
) {
    // SAFETY: the instructions have been detected, otherwise this `Simd` would not exist; the rest is this function's
    // contract.
    unsafe {
        match out {
            [only] => sweep_for(simd, only.planes.len())(padded, segments, origin, missed, only),
            groups => sweep_of_groups_for(simd)(padded, segments, origin, missed, groups),
        }
    }
}
