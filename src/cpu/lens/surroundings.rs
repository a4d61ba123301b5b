//! The depths in each block and beside it, for beams that are as wide as a pixel.

use super::padded::Padded;
use crate::scene::depth_bounds::{DepthBits, any_bin};
use crate::scene::grid::BLOCK;
use rayon::prelude::*;

/// The depths of the cells of every block and of those within one pixel around it.
#[derive(Default)]
pub struct Surroundings {
    across: usize,
    layers: usize,
    /// For each block, then each layer.
    occupied: Vec<DepthBits>,
    /// For each block, the nearest code of all layers.
    nearest: Vec<u16>,
}

impl Surroundings {
    pub fn new(padded: &Padded) -> Surroundings {
        let bounds = &padded.bounds;
        let (across, layers) = (bounds.across, bounds.layers);
        let mut occupied = bounds.occupied.clone();
        let mut nearest: Vec<u16> = bounds.range.iter().map(|range| range.1).collect();
        let blocks = occupied.par_chunks_mut(layers).zip(&mut nearest).enumerate();
        blocks.for_each(|(b, (bits, nearest))| {
            for cell in border(padded, b % across, b / across) {
                for (bits, layer) in bits.iter_mut().zip(&padded.layers) {
                    let (lo, hi) = (layer.lo[cell], layer.hi[cell]);
                    if hi > 0 {
                        *nearest = (*nearest).max(hi);
                        (lo >> 8..=hi >> 8).for_each(|bin| bits[usize::from(bin / 64)] |= 1 << (bin % 64));
                    }
                }
            }
        });
        Surroundings { across, layers, occupied, nearest }
    }

    /// Whether a block, or what is beside it, has cells of these codes. In layer `own`, they count from code `from` on.
    pub fn has(&self, [bx, by]: [usize; 2], codes: [u16; 2], (own, from): (usize, u16)) -> bool {
        let block = by * self.across + bx;
        self.nearest[block] >= codes[0]
            && self.occupied[block * self.layers..][..self.layers].iter().enumerate().any(|(layer, bits)| {
                let first = if layer == own { codes[0].max(from) } else { codes[0] };
                first <= codes[1] && any_bin(bits, usize::from(first >> 8), usize::from(codes[1] >> 8))
            })
    }
}

/// The padded cells around a block.
fn border(padded: &Padded, bx: usize, by: usize) -> impl Iterator<Item = usize> + use<> {
    let (stride, rows) = (padded.padding.stride, padded.padding.rows);
    let around = move |first: usize, n: usize| first.saturating_sub(1)..(first + BLOCK + 1).min(n);
    let (columns, lines) = (around(bx * BLOCK, stride), around(by * BLOCK, rows));
    let inside = move |v: usize, first: usize| (first..first + BLOCK).contains(&v);
    lines.flat_map(move |y| {
        let whole = !inside(y, by * BLOCK);
        let cells = columns.clone().filter(move |&x| whole || !inside(x, bx * BLOCK));
        cells.map(move |x| y * stride + x)
    })
}
