//! Work on the rows of an interleaved picture, parallel and cancellable.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::picture::Size;
use rayon::prelude::*;
use std::ops::Index;

/// Number of rows that one worker takes at a time.
const BAND: usize = 8;
/// Number of rows or blocks that a worker takes at a time if some cost a hundred times as much as others: no other
/// worker can take over work that one worker has begun.
pub const ITEMS_PER_TASK: usize = 8;

/// Renders an interleaved picture of `size` in bands of `rows` rows; `band(scratch, first_y, out)` renders one band.
/// Every worker has a `scratch` of its own.
pub fn render_bands<S>(
    out: &mut [f32],
    size: Size,
    rows: usize,
    cancel: &Cancel,
    scratch: impl Fn() -> S + Sync + Send,
    band: impl Fn(&mut S, usize, &mut [f32]) + Sync + Send,
) -> Result<()> {
    let worker = || -> Worker {
        let mut scratch = scratch();
        let band = &band;
        Box::new(move |first, out| band(&mut scratch, first, out))
    };
    share_bands(out, rows, size.width * size.channels, cancel, &worker)
}

/// Renders the band that begins at a row.
type Worker<'a> = Box<dyn FnMut(usize, &mut [f32]) + 'a>;

/// Shares bands of `rows` rows of `length` values among workers. Compiled once for all methods and numbers of channels.
fn share_bands<'a>(
    out: &mut [f32],
    rows: usize,
    length: usize,
    cancel: &Cancel,
    worker: &(dyn Fn() -> Worker<'a> + Sync),
) -> Result<()> {
    out.par_chunks_mut(rows * length).enumerate().try_for_each_init(worker, |worker, (i, out)| {
        cancel.check()?;
        worker(i * rows, out);
        Ok(())
    })
}

/// Renders an interleaved picture of `size`; `row(scratch, y, out)` renders one row. Every worker has a `scratch` of
/// its own.
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

/// Interpolates from `a` to `b`; exact if they are equal.
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

/// Interleaves the first pixels of a row of planes, or of blocks of planes: as many as `out` holds.
#[inline(always)]
pub fn interleave<const C: usize, P: Index<usize, Output = f32> + ?Sized>(planes: [&P; C], out: &mut [f32]) {
    for (x, pixel) in out.chunks_exact_mut(C).enumerate() {
        for c in 0..C {
            pixel[c] = planes[c][x];
        }
    }
}

/// Interleaves a row of some planes into one of more channels, which begins with the first of them.
pub fn interleave_among<const C: usize, const N: usize>(
    planes: [&[f32; N]; C],
    channels: usize,
    out: &mut [f32],
) {
    for (x, pixel) in out.chunks_mut(channels).enumerate() {
        for c in 0..C {
            pixel[c] = planes[c][x];
        }
    }
}

/// Cuts several planes into bands of `len` values; each band has its part of every plane.
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
