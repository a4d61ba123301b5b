//! What several views see behind a pixel of the reference, as one surface behind another.

use super::depth_map::{DepthMap, SAME_PX};
use super::fragments::Fragment;
use super::source::Source;
use super::view::AGREES;
use std::cmp::Ordering;

/// A hidden surface at a pixel of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// The pixel.
    pub index: usize,
    /// The inverse of its `z`.
    pub disparity: f32,
    /// How much of the pixel it covers.
    pub coverage: f32,
    /// Its colour, as of the views, times its coverage.
    pub color: [f32; 4],
}

/// Sorts fragments by pixel, the nearest first, and then by their other values: the order of the views does not matter.
pub fn sort(fragments: &mut [Fragment]) {
    let order = |a: &Fragment, b: &Fragment| {
        let values = |f: &Fragment| {
            let [r, g, b, a] = f.color;
            [f.weight, f.tolerance, f.coverage, r, g, b, a]
        };
        let by_value = || values(a).iter().zip(values(b)).map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne());
        (a.index.cmp(&b.index))
            .then(b.disparity.total_cmp(&a.disparity))
            .then_with(|| by_value().unwrap_or(Ordering::Equal))
    };
    fragments.sort_unstable_by(order);
}

/// The surfaces of sorted fragments, each of one pixel.
pub fn surfaces(fragments: &[Fragment]) -> impl Iterator<Item = &[Fragment]> {
    fragments.chunk_by(|a, b| {
        a.index == b.index && a.disparity - b.disparity <= SAME_PX * a.tolerance.max(b.tolerance)
    })
}

/// The squared distance of the light of two colours.
fn distance2(a: &[f32; 4], b: &[f32; 4], lights: usize) -> f32 {
    (0..lights).map(|c| (a[c] - b[c]).powi(2)).sum()
}

/// One surface out of what the views see of it, at least one fragment; `None` if it covers nothing of the pixel.
///
/// Where views disagree, as on mirrors, the colour that most of them are near to counts, and the others the less the
/// farther they are from it. How much of the pixel is covered is another question: colours are compared without it.
pub fn merged(fragments: &[Fragment], lights: usize) -> Option<Cell> {
    let pure = |f: &Fragment| f.color.map(|c| c / f.coverage);
    let shown = || fragments.iter().filter(|f| f.coverage > 0.0);
    let away = |color: &[f32; 4]| -> f32 {
        shown().map(|f| f.weight * f.coverage * distance2(&pure(f), color, lights).sqrt()).sum()
    };
    // Of equals the first one, in an order that the views have no part in.
    let colors = shown().map(|f| (away(&pure(f)), pure(f)));
    let (away, center) = colors.reduce(|best, next| if next.0 < best.0 { next } else { best })?;
    let dark = distance2(&center, &[0.0; 4], lights);
    let spread = away / shown().map(|f| f.weight * f.coverage).sum::<f32>();
    let scale2 = spread * spread + AGREES * AGREES * dark + f32::MIN_POSITIVE;
    let (mut weights, mut disparity, mut bare, mut color) = (0.0, 0.0, 0.0, [0.0; 4]);
    for f in fragments {
        let apart2 = if f.coverage > 0.0 { distance2(&pure(f), &center, lights) } else { 0.0 };
        let weight = f.weight / (1.0 + apart2 / scale2);
        weights += weight;
        disparity += weight * f.disparity;
        bare += weight * (1.0 - f.coverage);
        color.iter_mut().zip(f.color).for_each(|(sum, c)| *sum += weight * c);
    }
    let [disparity, bare] = [disparity, bare].map(|sum| sum / weights);
    Some(Cell {
        index: fragments[0].index,
        disparity,
        coverage: 1.0 - bare,
        color: color.map(|c| c / weights),
    })
}

/// Whether the views allow that there is a surface: more of them see it than see through its place.
pub fn is_there(cell: &Cell, reference: &DepthMap, sources: &[Source]) -> bool {
    let (x, y) = ((cell.index % reference.width) as f64, (cell.index / reference.width) as f64);
    let (mut see, mut see_through) = (0, 0);
    for source in sources {
        let found = source.from_reference.at(x, y, f64::from(cell.disparity));
        let Some((found, at)) = found.and_then(|s| Some((s, source.depth.pixel_at(s.x, s.y)?))) else {
            continue;
        };
        let d = found.disparity as f32;
        let in_front = |i: usize| source.depth.behind_px(i, d, source.k);
        // Beside a silhouette, the next pixel may be on the surface that this one is on; and where it covers its pixel in
        // part, the one after that.
        let reach = if cell.coverage < 1.0 { 2 } else { 1 };
        let nearest = source.depth.within(at, reach).map(in_front).fold(f32::NEG_INFINITY, f32::max);
        if nearest < -SAME_PX {
            see_through += 1;
        } else if nearest <= SAME_PX {
            see += 1;
        }
    }
    see > see_through
}
