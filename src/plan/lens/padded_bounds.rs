//! The [bounds of depth](crate::scene::depth_bounds) of the padded frame.

use super::padding::Padding;
use crate::scene::contrast::Contrast;
use crate::scene::depth_bounds::{DepthBits, DepthBounds, unite};
use crate::scene::grid::{BLOCK, TILE};

/// The first and the last column of blocks that each padded column of blocks shows, and the same of rows.
fn shown(padding: &Padding) -> [Vec<(usize, usize)>; 2] {
    let along = |n: usize, place: &dyn Fn(usize) -> usize| -> Vec<(usize, usize)> {
        let block = |b: usize| {
            let at = (b * BLOCK..(b + 1) * BLOCK).map(|i| place(i) / BLOCK);
            at.fold((usize::MAX, 0), |(lo, hi), b| (lo.min(b), hi.max(b)))
        };
        (0..n / BLOCK).map(block).collect()
    };
    let columns = along(padding.stride, &|px| padding.column(px).0);
    [columns, along(padding.rows, &|py| padding.row(py).0)]
}

/// The contrast of each padded block: that of the blocks that it shows, of which there are `across` in a row.
pub fn contrast(of: &[Contrast], across: usize, padding: &Padding) -> Vec<Contrast> {
    let [columns, rows] = &shown(padding);
    let of_blocks = |(rows, columns): (&(usize, usize), &(usize, usize))| {
        let row = |y: usize| &of[y * across + columns.0..=y * across + columns.1];
        Contrast::united((rows.0..=rows.1).flat_map(row))
    };
    rows.iter().flat_map(|rows| columns.iter().map(move |columns| (rows, columns))).map(of_blocks).collect()
}

/// The bounds of the blocks of the padded frame. Each is the union of the bounds of the blocks that it shows.
pub fn padded(bounds: &DepthBounds, padding: &Padding) -> DepthBounds {
    let [columns, rows] = shown(padding);
    let (across, down) = (columns.len(), rows.len());
    let mut padded = DepthBounds {
        across,
        down,
        layers: bounds.layers,
        occupied: vec![[0; 4]; across * down * bounds.layers],
        range: vec![(u16::MAX, 0); across * down],
        smooth: vec![Some(0); across * down],
    };
    for (i, (rows, columns)) in
        rows.iter().flat_map(|rows| columns.iter().map(move |columns| (rows, columns))).enumerate()
    {
        for b in (rows.0..=rows.1).flat_map(|y| (columns.0..=columns.1).map(move |x| y * bounds.across + x)) {
            for k in 0..bounds.layers {
                unite(&mut padded.occupied[i * bounds.layers + k], &bounds.occupied[b * bounds.layers + k]);
            }
            padded.range[i] =
                (padded.range[i].0.min(bounds.range[b].0), padded.range[i].1.max(bounds.range[b].1));
            padded.smooth[i] = padded.smooth[i].zip(bounds.smooth[b]).map(|(a, b)| a.max(b));
        }
    }
    padded
}

/// For each block, then each layer: the depths that occur anywhere within a tile whose first pixel lies in the block.
pub fn windows(bounds: &DepthBounds) -> Vec<DepthBits> {
    // A tile that does not begin with a block overlaps one more block.
    let (wide, high) = (TILE.0 / BLOCK + 1, TILE.1 / BLOCK + 1);
    let row = bounds.across * bounds.layers;
    let along = |source: &[DepthBits], at: usize, step: usize, n: usize| {
        let mut bits = [0; 4];
        (0..n).for_each(|i| unite(&mut bits, &source[at + i * step]));
        bits
    };
    let wide = |at: usize| {
        let x = at % row / bounds.layers;
        along(&bounds.occupied, at, bounds.layers, wide.min(bounds.across - x))
    };
    let across: Vec<DepthBits> = (0..bounds.occupied.len()).map(wide).collect();
    (0..across.len()).map(|at| along(&across, at, row, high.min(bounds.down - at / row))).collect()
}
