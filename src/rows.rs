//! Work on the rows of an interleaved picture, in parallel and interruptible.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::picture::Size;
use rayon::prelude::*;
use std::ops::Index;

/// Rows that one worker takes at a time.
const BAND: usize = 8;
/// Rows or blocks that a worker takes at a time, where some cost a hundred times as much as others: what one worker has
/// begun nobody can take over.
pub const AT_ONCE: usize = 8;

/// An interleaved picture of `size` in bands of `rows` rows, each made by `band(scratch, first_y, out)`; every worker
/// has a `scratch` of its own.
pub fn render_bands<S>(
    out: &mut [f32],
    size: Size,
    rows: usize,
    cancel: &Cancel,
    scratch: impl Fn() -> S + Sync + Send,
    band: impl Fn(&mut S, usize, &mut [f32]) + Sync + Send,
) -> Result<()> {
    let length = size.width * size.channels;
    out.par_chunks_mut(rows * length).enumerate().try_for_each_init(scratch, |scratch, (i, out)| {
        cancel.check()?;
        band(scratch, i * rows, out);
        Ok(())
    })
}

/// An interleaved picture of `size`, each row made by `row(scratch, y, out)`; every worker has a `scratch` of its own.
pub fn render_rows<S>(
    out: &mut [f32],
    size: Size,
    cancel: &Cancel,
    scratch: impl Fn() -> S + Sync + Send,
    row: impl Fn(&mut S, usize, &mut [f32]) + Sync + Send,
) -> Result<()> {
    render_bands(out, size, BAND, cancel, scratch, |scratch, first, out| {
        for (i, out) in out.chunks_mut(size.width * size.channels).enumerate() {
            row(scratch, first + i, out);
        }
    })
}

/// From `a` to `b`; exact where they are equal.
#[inline(always)]
pub fn mix(a: f32, b: f32, fraction: f32) -> f32 {
    a + fraction * (b - a)
}

/// The lesser of two values.
#[inline(always)]
pub fn lesser(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// The greater of two values.
#[inline(always)]
pub fn greater(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// Puts the first pixels of a row of planes, or of blocks of them, into an interleaved row, as many as that has.
#[inline(always)]
pub fn interleave<const C: usize, P: Index<usize, Output = f32> + ?Sized>(planes: [&P; C], out: &mut [f32]) {
    for (x, pixel) in out.chunks_exact_mut(C).enumerate() {
        for c in 0..C {
            pixel[c] = planes[c][x];
        }
    }
}

/// Several planes cut into bands of `len` values, side by side.
pub fn bands<'a>(planes: impl Iterator<Item = &'a mut [f32]>, len: usize) -> Vec<Vec<&'a mut [f32]>> {
    let mut bands = Vec::new();
    for plane in planes {
        bands.resize_with(plane.len().div_ceil(len), Vec::new);
        plane.chunks_mut(len).zip(&mut bands).for_each(|(piece, band)| band.push(piece));
    }
    bands
}

/// Calls a function that is generic over the number of channels.
macro_rules! with_channels {
    ($channels:expr, $c:ident => $call:expr) => {
        match $channels {
            1 => {
                const $c: usize = 1;
                $call
            }
            2 => {
                const $c: usize = 2;
                $call
            }
            3 => {
                const $c: usize = 3;
                $call
            }
            _ => {
                const $c: usize = 4;
                $call
            }
        }
    };
}
pub(crate) use with_channels;
