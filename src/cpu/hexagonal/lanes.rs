//! Arithmetic on several pixels of a row at once.

use crate::plan::hexagonal::Tap;
use crate::rows::{greater, lesser};

/// Number of pixels that are processed together.
pub const LANES: usize = 16;

pub type Lane = [f32; LANES];

/// The lane of a plane that starts at an index.
#[inline(always)]
pub fn lane(plane: &[f32], at: usize) -> &Lane {
    plane[at..].first_chunk().expect("the surroundings hold whole lanes")
}

/// The same, for writing.
#[inline(always)]
pub fn lane_mut(plane: &mut [f32], at: usize) -> &mut Lane {
    plane[at..].first_chunk_mut().expect("the surroundings hold whole lanes")
}

/// The fraction of a line's step that each circle of confusion reaches, times the step's share.
#[inline(always)]
pub fn parts(tap: Tap, radius: &Lane) -> Lane {
    let mut reached = *radius;
    for i in 0..LANES {
        reached[i] -= tap.from_px;
    }
    for i in 0..LANES {
        reached[i] = greater(0.0, reached[i]);
    }
    for i in 0..LANES {
        reached[i] = lesser(tap.step_px, reached[i]);
    }
    for i in 0..LANES {
        reached[i] *= tap.share;
    }
    reached
}

/// The same for a step that is reached completely.
#[inline(always)]
pub fn whole(tap: Tap) -> Lane {
    [tap.share * tap.step_px; LANES]
}

/// The product of two lanes.
// Each loop holds one operation only. If a loop does more, the compiler leaves some lanes out of its vectors.
#[inline(always)]
pub fn product(a: &Lane, b: &Lane) -> Lane {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = a[i] * b[i];
    }
    out
}

/// Adds a lane to a sum.
#[inline(always)]
pub fn add(sum: &mut Lane, v: &Lane) {
    for i in 0..LANES {
        sum[i] += v[i];
    }
}

/// Reduces a lane to one value with `pick`, halving it at each step.
#[inline(always)]
pub fn reduce(mut values: Lane, pick: impl Fn(f32, f32) -> f32) -> f32 {
    let mut n = LANES / 2;
    while n > 0 {
        for i in 0..n {
            values[i] = pick(values[i], values[i + n]);
        }
        n /= 2;
    }
    values[0]
}
