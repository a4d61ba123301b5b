//! The innermost loops of the sweep: some rows of a few pixels, over all samples.

use super::dimming::{Left, Weights};
use super::lanes::Lanes;
use super::planes::Planes;
use super::segments::{MOST, ROWS, Segment, Segments};
use crate::picture::ChannelGroup;

/// Cells that some of the pixels that are swept together have met: those with a bit, at one offset in one layer.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    pub layer: u32,
    pub offset: i32,
    /// The number of the segment.
    pub number: u32,
    pub cells: [u32; ROWS],
    /// The number of the [weights](Hits::weights) with which the cells are seen, if that is not whole.
    pub weights: Option<u32>,
}

/// What samples have met of pixels that are swept together, beside what all of these have met.
#[derive(Default)]
pub struct Hits {
    /// In the order in which it was met.
    pub all: Vec<Hit>,
    /// How much of cells is seen, where light passes through some.
    weights: Vec<Weights>,
}

impl Hits {
    pub fn clear(&mut self) {
        self.all.clear();
        self.weights.clear();
    }

    /// How much of the cells of a hit is seen, if that is not whole.
    pub fn weights_of(&self, hit: &Hit) -> Option<&Weights> {
        hit.weights.map(|number| &self.weights[number as usize])
    }

    /// Adds what a segment has met, by the weights that the cells are seen with, if that is not whole.
    pub fn push(&mut self, segment: &Segment, cells: [u32; ROWS], weights: Option<&Weights>) {
        let Segment { layer, offset, number, .. } = *segment;
        let weights = weights.map(|weights| {
            self.weights.push(*weights);
            self.weights.len() as u32 - 1
        });
        self.all.push(Hit { layer, offset, number, cells, weights });
    }
}

/// What samples have met of pixels that are swept together.
pub struct Swept<const C: usize> {
    pub sums: [[[f32; MOST]; C]; ROWS],
    /// How many samples have met nothing; of one that light has passed through everything, the part that was left.
    pub missed: [[f32; MOST]; ROWS],
}

impl<const C: usize> Swept<C> {
    pub const NOTHING: Swept<C> = Swept { sums: [[[0.0; MOST]; C]; ROWS], missed: [[0.0; MOST]; ROWS] };
}

/// Sweeps `CELLS` x `ROWS` pixels and adds up every sample. The first pixel is at `at_tile` in the tile and at `base`
/// in the padded frame. `hit` is told what the samples have met that are not in [`Segments::met`], and how much of it is seen
/// where light passes through something.
///
/// # Safety
///
/// The instructions of `L` have been detected, segments have been culled, and every segment's cells lie inside the
/// padded arrays.
#[inline(always)]
pub unsafe fn sweep_rows<L: Lanes, const C: usize>(
    layers: &[Planes<C>],
    stride: usize,
    segments: &Segments,
    at_tile: (usize, usize),
    base: usize,
    Swept { sums, missed }: &mut Swept<C>,
    mut hit: impl FnMut(&Segment, [L::Mask; ROWS], Option<&Weights>),
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
                    hit(segment, hits, Some(&weights));
                    for row in 0..ROWS {
                        for c in 0..C {
                            let color = layer.color[c].add(first + row * stride);
                            L::add_weighted(&mut sum[row][c], color, weights[row].as_ptr(), hits[row]);
                        }
                        waiting[row] = L::without(waiting[row], L::mask(ended[row]));
                    }
                } else {
                    hit(segment, hits, None);
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
pub unsafe fn add_hits<L: Lanes, const C: usize>(
    color: &[[*const f32; ChannelGroup::MOST]],
    stride: usize,
    (met, hits): (&[Segment], &Hits),
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
        for hit in &hits.all {
            let color = color.get_unchecked(hit.layer as usize);
            let first = base.wrapping_add_signed(hit.offset as isize);
            for row in 0..ROWS {
                let cells = L::mask(hit.cells[row]);
                let weights =
                    hit.weights.map(|number| hits.weights.get_unchecked(number as usize)[row].as_ptr());
                for c in 0..C {
                    let color = color[c].add(first + row * stride);
                    match weights {
                        None => L::add(&mut sum[row][c], color, cells),
                        Some(weights) => L::add_weighted(&mut sum[row][c], color, weights, cells),
                    }
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
