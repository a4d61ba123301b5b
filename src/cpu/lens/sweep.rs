//! The sweep: for every sample, the nearest cell that each pixel's ray meets.
//!
//! While the shift of a sample stays within one pixel, all rays of a tile meet the cells at the same offset. So a ray
//! through the scene is a list of segments, near to far. Each segment says: read the cells at this offset and take
//! those whose depth lies in this interval. This needs contiguous loads only, no z-buffer and no gather.

use super::culling::PART;
use super::dimming::Left;
use super::lanes::{Lanes, Portable};
use super::padded::Padded;
use super::padded_layer::PaddedLayer;
use super::planes::Planes;
use super::segments::{MOST, ROWS, Segment, Segments};
use super::tile_color::TileColor;
use crate::picture::ChannelGroup;
use crate::plan::lens::Missed;
use crate::rows::with_channels;
use crate::scene::grid::TILE;
use crate::simd::{InstructionSet, Simd};

/// Cells that some of the pixels that are swept together have met: those with a bit, at one offset in one layer.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    pub layer: u32,
    pub offset: i32,
    /// The number of the segment.
    pub number: u32,
    pub cells: [u32; ROWS],
}

/// What samples have met of pixels that are swept together.
struct Swept<const C: usize> {
    sums: [[[f32; MOST]; C]; ROWS],
    /// How many samples have met nothing; of one that light has passed through everything, the part that was left.
    missed: [[f32; MOST]; ROWS],
}

impl<const C: usize> Swept<C> {
    const NOTHING: Swept<C> = Swept { sums: [[[0.0; MOST]; C]; ROWS], missed: [[0.0; MOST]; ROWS] };
}

/// Sweeps `CELLS` x `ROWS` pixels and adds up every sample. The first pixel is at `at_tile` in the tile and at `base`
/// in the padded frame. `hit` is told what the samples have met that are not in [`Segments::met`].
///
/// # Safety
///
/// The instructions of `L` have been detected, segments have been culled, and every segment's cells lie inside the
/// padded arrays.
#[inline(always)]
unsafe fn sweep_rows<L: Lanes, const C: usize>(
    layers: &[Planes<C>],
    stride: usize,
    segments: &Segments,
    at_tile: (usize, usize),
    base: usize,
    Swept { sums, missed }: &mut Swept<C>,
    mut hit: impl FnMut(&Segment, [L::Mask; ROWS]),
) {
    // SAFETY: per the function's contract.
    unsafe {
        let mut sum = [[L::zero(); C]; ROWS];
        for met in &segments.met {
            let layer = layers.get_unchecked(met.layer as usize);
            let first = base.wrapping_add_signed(met.offset as isize);
            for row in 0..ROWS {
                for c in 0..C {
                    L::add_all(&mut sum[row][c], layer.color[c].add(first + row * stride));
                }
            }
        }
        let everywhere = L::mask(u32::MAX);
        let mut left = Left::ALL;
        let mut start = 0;
        'samples: for &(sample, end) in &segments.unknown {
            let kept = segments.kept.get_unchecked(start..end as usize);
            start = end as usize;
            left.dimmed = false;
            let mut waiting = [everywhere; ROWS];
            if !segments.seen.is_empty() {
                let seen = segments.seen_by(sample as usize, at_tile);
                waiting = [L::mask(seen[0]), L::mask(seen[1])];
                if L::is_none(L::union(waiting[0], waiting[1])) {
                    continue;
                }
            }
            for segment in kept {
                let layer = layers.get_unchecked(segment.layer as usize);
                let first = base.wrapping_add_signed(segment.offset as isize);
                let mut hits = waiting;
                for row in 0..ROWS {
                    let at = first + row * stride;
                    hits[row] =
                        L::hits(waiting[row], layer.lo.add(at), layer.hi.add(at), segment.from, segment.to);
                }
                let any = L::bits(L::union(hits[0], hits[1]));
                if any == 0 {
                    continue;
                }
                let any_partial = (layer.partial(first) | layer.partial(first + stride)) & any != 0;
                if any_partial {
                    let ray = segments.traced.get_unchecked(segment.number as usize).ray;
                    for row in 0..ROWS {
                        hits[row] = layer.covering::<L>(hits[row], first + row * stride, ray);
                    }
                }
                if left.dimmed || any_partial && layer.partial.translucent {
                    let cells = hits.map(|hits| L::bits(hits));
                    let number = (segments, segment.number);
                    let (weights, ended) = left.dim::<L, C>(layer, (base, stride), number, cells);
                    for row in 0..ROWS {
                        for c in 0..C {
                            let color = layer.color[c].add(first + row * stride);
                            L::add_weighted(&mut sum[row][c], color, weights[row].as_ptr(), hits[row]);
                        }
                        waiting[row] = L::without(waiting[row], L::mask(ended[row]));
                    }
                } else {
                    hit(segment, hits);
                    for row in 0..ROWS {
                        for c in 0..C {
                            let color = layer.color[c].add(first + row * stride);
                            L::add(&mut sum[row][c], color, hits[row]);
                        }
                        waiting[row] = L::without(waiting[row], hits[row]);
                    }
                }
                if L::is_none(L::union(waiting[0], waiting[1])) {
                    continue 'samples;
                }
            }
            for row in 0..ROWS {
                let mut rays = L::bits(waiting[row]);
                while rays != 0 {
                    let i = rays.trailing_zeros() as usize;
                    missed[row][i] += if left.dimmed { left.light[row][i] } else { 1.0 };
                    rays &= rays - 1;
                }
            }
        }
        for row in 0..ROWS {
            for c in 0..C {
                L::store(sum[row][c], sums[row][c].as_mut_ptr());
            }
        }
    }
}

/// Adds up, in other channels, what [`sweep_rows`] has met: in the same order, and so with the same bits.
///
/// # Safety
///
/// As for [`sweep_rows`].
#[inline(always)]
unsafe fn add_hits<L: Lanes, const C: usize>(
    color: &[[*const f32; ChannelGroup::MOST]],
    stride: usize,
    (met, hits): (&[Segment], &[Hit]),
    base: usize,
    sums: &mut [[[f32; MOST]; C]; ROWS],
) {
    // SAFETY: per the function's contract.
    unsafe {
        let mut sum = [[L::zero(); C]; ROWS];
        for met in met {
            let color = color.get_unchecked(met.layer as usize);
            let first = base.wrapping_add_signed(met.offset as isize);
            for row in 0..ROWS {
                for c in 0..C {
                    L::add_all(&mut sum[row][c], color[c].add(first + row * stride));
                }
            }
        }
        for hit in hits {
            let color = color.get_unchecked(hit.layer as usize);
            let first = base.wrapping_add_signed(hit.offset as isize);
            for row in 0..ROWS {
                let cells = L::mask(hit.cells[row]);
                for c in 0..C {
                    L::add(&mut sum[row][c], color[c].add(first + row * stride), cells);
                }
            }
        }
        for row in 0..ROWS {
            for c in 0..C {
                L::store(sum[row][c], sums[row][c].as_mut_ptr());
            }
        }
    }
}

/// Sweeps a whole tile for all groups of channels: what is met is found once, and then added up in every group.
///
/// # Safety
///
/// As for [`sweep_rows`].
#[inline(always)]
unsafe fn sweep_tile_of_groups<L: Lanes>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed_rule: Missed,
    out: &mut [TileColor],
) {
    let stride = padded.padding.stride;
    let firsts = out.iter().scan(0, |end, group| {
        let first = *end;
        *end += group.planes.len();
        Some(first)
    });
    let firsts: Vec<usize> = firsts.collect();
    // Channels that a group does not have are not read.
    let planes = |first: usize, n: usize| {
        let of =
            move |layer: &PaddedLayer| std::array::from_fn(|c| layer.color[first + c.min(n - 1)].as_ptr());
        padded.layers.iter().map(of).collect()
    };
    let colors = firsts.iter().zip(&*out).map(|(first, out)| planes(*first, out.planes.len()));
    let colors: Vec<Vec<[*const f32; ChannelGroup::MOST]>> = colors.collect();
    // SAFETY: per the function's contract.
    unsafe {
        visit_hits::<L>(
            padded,
            segments,
            origin,
            missed_rule,
            #[inline(always)]
            |pixels, segments, hits| {
                let base = padded.padding.index(origin.0 + pixels.at.0, origin.1 + pixels.at.1);
                for ((out, color), first) in out.iter_mut().zip(&colors).zip(&firsts) {
                    with_channels!(out.planes.len(), C => {
                        let mut sums = [[[0.0; MOST]; C]; ROWS];
                        add_hits::<L, C>(color, stride, (&segments.met, hits), base, &mut sums);
                        let own = std::array::from_fn(|c| &padded.layers[padded.front].color[first + c][base..]);
                        pixels.divide(&sums, own, stride, out);
                    });
                }
            },
        );
    }
}

/// Finds what a whole tile meets, and visits its pixels, as many as are swept together, with the segments that all of them
/// have met and with what some of them have.
///
/// # Safety
///
/// As for [`sweep_rows`].
#[inline(always)]
unsafe fn visit_hits<L: Lanes>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed_rule: Missed,
    mut visit: impl FnMut(&Pixels, &Segments, &[Hit]),
) {
    let layers: Vec<Planes<0>> = padded.layers.iter().map(Planes::of).collect();
    let stride = padded.padding.stride;
    // Channels are carried by pictures of one layer, which is opaque.
    debug_assert!(!padded.translucent);
    let mut hits = Vec::new();
    visit_pixels::<L>(
        padded,
        segments,
        origin,
        #[inline(always)]
        |segments, (x, y), base| {
            let mut swept = Swept::<0>::NOTHING;
            hits.clear();
            // SAFETY: per the function's contract.
            unsafe {
                let hit = |segment: &Segment, cells: [L::Mask; ROWS]| {
                    let Segment { layer, offset, number, .. } = *segment;
                    hits.push(Hit { layer, offset, number, cells: cells.map(|cells| L::bits(cells)) });
                };
                sweep_rows::<L, 0>(&layers, stride, segments, (x, y), base, &mut swept, hit);
            }
            let pixels = Pixels::new(segments, &swept.missed, missed_rule, (x, y), L::CELLS);
            visit(&pixels, segments, &hits);
        },
    );
}

/// Pixels that were swept together.
pub struct Pixels {
    /// The number of samples by which the sums of each are divided.
    met: [[f32; MOST]; ROWS],
    /// The first of them in the tile, and how many there are in a row.
    pub at: (usize, usize),
    pub cells: usize,
}

impl Pixels {
    #[inline(always)]
    fn new(
        segments: &Segments,
        missed: &[[f32; MOST]; ROWS],
        missed_rule: Missed,
        at: (usize, usize),
        cells: usize,
    ) -> Pixels {
        let mut met = [[0.0; MOST]; ROWS];
        for row in 0..ROWS {
            for lane in 0..cells {
                let samples = segments.seen_from(at.0 + lane, at.1 + row) as f32;
                met[row][lane] = match missed_rule {
                    Missed::Nothing => samples,
                    Missed::Unknown => samples - missed[row][lane],
                };
            }
        }
        Pixels { met, at, cells }
    }

    /// The number of samples by which the sum of a pixel is divided.
    #[inline(always)]
    pub fn met(&self, row: usize, lane: usize) -> f32 {
        self.met[row][lane]
    }

    /// Divides sums by the number of samples. If no sample met a cell, a pixel keeps the colour of its `own` cell.
    #[inline(always)]
    fn divide<const C: usize>(
        &self,
        sums: &[[[f32; MOST]; C]; ROWS],
        own: [&[f32]; C],
        stride: usize,
        out: &mut TileColor,
    ) {
        for row in 0..ROWS {
            for lane in 0..self.cells {
                let met = self.met[row][lane];
                let at = (self.at.1 + row) * TILE.0 + self.at.0 + lane;
                for c in 0..C {
                    out.planes[c][at] =
                        if met > 0.0 { sums[row][c][lane] / met } else { own[c][row * stride + lane] };
                }
            }
        }
    }
}

/// Sweeps a whole tile.
///
/// # Safety
///
/// As for [`sweep_rows`].
#[inline(always)]
unsafe fn sweep_tile<L: Lanes, const C: usize>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed_rule: Missed,
    out: &mut TileColor,
) {
    let layers: Vec<Planes<C>> = padded.layers.iter().map(Planes::of).collect();
    let stride = padded.padding.stride;
    visit_pixels::<L>(
        padded,
        segments,
        origin,
        #[inline(always)]
        |segments, (x, y), base| {
            let mut swept = Swept::<C>::NOTHING;
            // SAFETY: per the function's contract.
            unsafe {
                sweep_rows::<L, C>(&layers, stride, segments, (x, y), base, &mut swept, |_, _| {});
            }
            let own = std::array::from_fn(|c| &padded.layers[padded.front].color[c][base..]);
            let pixels = Pixels::new(segments, &swept.missed, missed_rule, (x, y), L::CELLS);
            pixels.divide(&swept.sums, own, stride, out);
        },
    );
}

/// Culls the segments for each part of a tile, and visits its pixels, as many as are swept together: the place of the first
/// of them in the tile, and its cell in the padded frame.
#[inline(always)]
fn visit_pixels<L: Lanes>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    mut visit: impl FnMut(&Segments, (usize, usize), usize),
) {
    for (x, part_y) in segments.parts.origins() {
        let place = (origin.0 + padded.padding.pad + x, origin.1 + padded.padding.pad + part_y);
        segments.cull(&padded.patches, place, (x, part_y));
        let columns = || (x..x + PART.0).step_by(L::CELLS);
        let rows = (part_y..part_y + PART.1).step_by(ROWS);
        for (x, y) in rows.flat_map(|y| columns().map(move |x| (x, y))) {
            visit(segments, (x, y), padded.padding.index(origin.0 + x, origin.1 + y));
        }
    }
}

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
                visit: impl FnMut(&Pixels, &Segments, &[Hit]),
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
    visit: impl FnMut(&Pixels, &Segments, &[Hit]),
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
