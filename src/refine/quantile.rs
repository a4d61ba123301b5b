//! Quantiles of a great many values, by counting. Counts do not depend on the order of addition.

use rayon::prelude::*;

/// Values that share the upper half of their bits are counted together: 256 steps an octave.
const SHIFT: u32 = 16;
const BINS: usize = 1 << (32 - SHIFT);

/// The bits of a value in the order of the values.
fn ordered(v: f32) -> u32 {
    let bits = v.to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

/// The value whose bits these are.
fn value(ordered: u32) -> f32 {
    f32::from_bits(if ordered >> 31 == 1 { ordered & !(1 << 31) } else { !ordered })
}

/// The values below which the shares `shares` of all values lie, to 0.4 %. Of no values, zeros.
pub fn quantiles<const N: usize>(values: impl ParallelIterator<Item = f32>, shares: [f64; N]) -> [f32; N] {
    let counts = values
        .fold(
            || vec![0u64; BINS],
            |mut counts, v| {
                counts[(ordered(v) >> SHIFT) as usize] += 1;
                counts
            },
        )
        .reduce(
            || vec![0; BINS],
            |mut a, b| {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                a
            },
        );
    let total: u64 = counts.iter().sum();
    shares.map(|share| {
        let wanted = (share * total as f64) as u64;
        let mut below = 0;
        let found = counts.iter().position(|count| {
            below += count;
            below > wanted
        });
        found.map_or(0.0, |bin| value((bin as u32) << SHIFT | 1 << (SHIFT - 1)))
    })
}
