//! How wide the edges of depth are.

use super::plane::{Plane, Tile, fade};

/// Half of the window within which an edge begins and ends.
const REACH: usize = 10;
/// A crease, where a slope ends, is as wide as half the window, and no edge.
const WIDEST: f32 = 9.0;
/// Edges of a smaller share of all depths do not count.
const LEAST_CONTRAST: f32 = 0.04;
/// Bins of the histogram of widths.
const BINS: usize = 640;

/// The width of edges in pixels: their contrast over their steepest slope. Between two pixels of a sharp map there is
/// the whole contrast, and its edges are one pixel wide; those of a Gaussian blur of `sigma` are 2.5 `sigma` wide.
///
/// Of all edges this is the median, each of which counts as much as its contrast; of a map without edges, 1. The
/// second number is how many pixels of edges there are, each times its contrast.
pub fn width_px(depth: &Plane, range: f32, noise: f32) -> (f32, f32) {
    // Noise makes slopes of its own, and a difference of extremes of up to eight deviations.
    let least = LEAST_CONTRAST + 8.0 * noise / range;
    let counts = Tile::each([depth], REACH, |tile| counted(&tile, least, range));
    let mut total = vec![0u64; BINS];
    counts.iter().flatten().for_each(|counts| total.iter_mut().zip(counts).for_each(|(a, b)| *a += b));
    let counts = total;
    let total: u64 = counts.iter().sum();
    let mut below = 0;
    let median = counts.iter().position(|count| {
        below += count;
        2 * below > total
    });
    let width_px = median.map_or(1.0, |bin| (bin as f32 + 0.5) * (WIDEST / BINS as f32));
    (width_px, total as f32 / 65536.0)
}

/// The widths of a tile's edges, counted by their contrast; of a tile without edges, none.
fn counted(tile: &Tile<1>, least: f32, range: f32) -> Option<Vec<u64>> {
    let [depth] = &tile.planes;
    let (low, high) = depth.range();
    if high - low <= least * range {
        return None;
    }
    // Squared slopes. The last column is in the margin.
    let slopes = depth.like(|y, out| {
        let (row, below) = (depth.row(y as isize), depth.row(y as isize + 1));
        out[row.len() - 1] = 0.0;
        for (out, ((own, right), below)) in out.iter_mut().zip(row.iter().zip(&row[1..]).zip(below)) {
            let (across, down) = (right - own, below - own);
            *out = across * across + down * down;
        }
    });
    let steepest = slopes.maxima(2);
    let (high, low) = (depth.maxima(REACH), depth.minima(REACH));
    let mut counts = vec![0; BINS];
    for y in tile.margin..depth.height - tile.margin {
        let y = y as isize;
        let (slopes, steepest) = (slopes.row(y), steepest.row(y));
        let (high, low) = (high.row(y), low.row(y));
        for x in tile.margin..depth.width - tile.margin {
            let slope = slopes[x];
            if slope <= 0.0 || slope < steepest[x] {
                continue;
            }
            let slope = slope.sqrt();
            let contrast = (high[x] - low[x]) / range;
            let width = contrast * range / slope;
            let weight =
                contrast.min(1.0) * fade(contrast, least, 2.0 * least) * fade(-width, -WIDEST, -0.8 * WIDEST);
            // Whole numbers have the same sum in any order.
            if weight > 0.0 {
                counts[((width * (BINS as f32 / WIDEST)) as usize).min(BINS - 1)] +=
                    (65536.0 * weight) as u64;
            }
        }
    }
    Some(counts)
}
