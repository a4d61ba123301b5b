//! Averages a super-sampled picture down to the pixels of the output.

use crate::memory::Buffer;
use crate::picture::Size;
use rayon::prelude::*;

/// The mean of every `n` x `n` block of an interleaved picture.
pub fn box_average(full: &[f32], size: Size, n: usize, out: &mut [f32]) {
    let (width, channels) = (size.width / n, size.channels);
    let scale = 1.0 / (n * n) as f32;
    out.par_chunks_mut(width * channels).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_mut(channels).enumerate() {
            pixel.fill(0.0);
            for j in 0..n {
                let source = &full[((y * n + j) * size.width + x * n) * channels..][..n * channels];
                for sample in source.chunks(channels) {
                    for (out, v) in pixel.iter_mut().zip(sample) {
                        *out += scale * v;
                    }
                }
            }
        }
    });
}

/// The adjoint of [`box_average`]: every pixel of `size`, interleaved, with its part of the mean that it is in.
pub fn spread(means: &[f32], size: Size, n: usize) -> Buffer<f32> {
    let channels = size.channels;
    let scale = 1.0 / (n * n) as f32;
    let mut full = Buffer::unset(size.pixels() * channels);
    full.par_chunks_mut(size.width * channels).enumerate().for_each(|(y, row)| {
        let source = &means[y / n * (size.width / n) * channels..];
        for (pixels, v) in row.chunks_exact_mut(n * channels).zip(source.chunks_exact(channels)) {
            for pixel in pixels.chunks_exact_mut(channels) {
                pixel.iter_mut().zip(v).for_each(|(out, v)| *out = scale * v);
            }
        }
    });
    full
}
