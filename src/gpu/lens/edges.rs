//! Where surfaces end, in the form of `shaders/lens/neighbours.wgsl`.
//!
//! A pixel's connections to its neighbours need not be told: each that is broken makes edge pixels of both.

use crate::scene::edges::EDGE;
use crate::scene::layer::{Role, SceneLayer};
use rayon::prelude::*;
use std::ops::Range;

/// In place of where the bits of a layer begin: its cells are no pixels of the picture.
pub const NO_EDGES: u32 = u32::MAX;
/// The same for a holdout.
pub const OF_HOLDOUT: u32 = u32::MAX - 1;
/// Pixels that one word has a bit of each for.
pub const BITS: usize = 32;
/// Number of words that one worker makes at a time.
const PART: usize = 1 << 10;

/// For each layer where its bits begin, or that it has none; then a bit for each of these pixels of the other layers.
pub fn words(layers: &[SceneLayer], pixels: Range<usize>) -> Vec<u32> {
    let of_layer = pixels.len().div_ceil(BITS);
    let mut first = layers.len();
    let head = |layer: &SceneLayer| match layer.role {
        Role::Holdout => OF_HOLDOUT,
        Role::Surface if layer.connectivity.is_empty() => NO_EDGES,
        Role::Surface => {
            first += of_layer;
            (first - of_layer) as u32
        }
    };
    let mut words: Vec<u32> = layers.iter().map(head).collect();
    words.resize(first, 0);
    let connected = layers.iter().filter(|layer| !layer.connectivity.is_empty());
    for (bits, layer) in words[layers.len()..].chunks_mut(of_layer).zip(connected) {
        let parts = bits.par_chunks_mut(PART).zip(layer.connectivity[pixels.clone()].par_chunks(PART * BITS));
        parts.for_each(|(bits, pixels)| {
            for (bits, pixels) in bits.iter_mut().zip(pixels.chunks(BITS)) {
                let bit = |(i, own): (usize, &u8)| u32::from(own & EDGE != 0) << i;
                *bits = pixels.iter().enumerate().map(bit).sum();
            }
        });
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Size;
    use crate::scene::colors::Colors;
    use crate::scene::edges::{DOWN, RIGHT};
    use std::sync::Arc;

    #[test]
    fn each_pixel_has_its_bit_in_the_layers_that_have_any() {
        let size = Size { width: 45, height: 2, channels: 1 };
        let layer = |role, connectivity| SceneLayer {
            role,
            connectivity: Arc::new(connectivity),
            ..SceneLayer::of_cells(size, std::iter::empty(), Vec::<Colors>::new())
        };
        let connectivity = |edge: usize| {
            (0..90).map(|i| RIGHT | DOWN | if i % edge == 0 { EDGE } else { 0 }).collect::<Vec<u8>>()
        };
        let layers = [
            layer(Role::Holdout, Vec::new()),
            layer(Role::Surface, connectivity(7)),
            layer(Role::Surface, Vec::new()),
            layer(Role::Surface, connectivity(5)),
        ];
        let words = words(&layers, 45..90);
        assert_eq!(words[..4], [OF_HOLDOUT, 4, NO_EDGES, 6]);
        for (first, edge) in [(4, 7), (6, 5)] {
            for i in 0..45 {
                let bit = words[first + i / 32] >> (i % 32) & 1;
                assert_eq!(bit == 1, (45 + i) % edge == 0, "{i}");
            }
        }
        assert_eq!(words.len(), 8);
    }
}
