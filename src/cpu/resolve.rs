//! Averages a super-sampled picture down to the pixels of the output.

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
