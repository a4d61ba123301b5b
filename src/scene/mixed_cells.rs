//! The cells into which mixed pixels are separated: colours, shifts and half-planes.

use super::colors::CellColor;
use super::front_layer::FrontLayer;
use super::half_plane::HalfPlane;
use super::matting::MixedPixel;
use rayon::prelude::*;

/// Gives mixed pixels the shifts of their surfaces in front. Returns these surfaces' colours, and the pixels that have both
/// surfaces.
pub fn split(mixed: &[MixedPixel], s: &mut [f32]) -> (Vec<CellColor>, Vec<MixedPixel>) {
    // A mixed pixel has both surfaces. If its coverage turns out to be zero, it belongs to the surface behind alone.
    let (both, behind): (Vec<MixedPixel>, Vec<MixedPixel>) = mixed.iter().partition(|m| m.coverage > 0.0);
    let own = |index: usize, color: [f32; 4]| CellColor { index, color };
    let colors = both.iter().map(|m| own(m.index, m.front));
    let colors = colors.chain(behind.iter().map(|m| own(m.index, m.back))).collect();
    both.iter().for_each(|m| s[m.index] = m.s_front);
    behind.iter().for_each(|m| s[m.index] = m.s_back);
    (colors, both)
}

/// Half-planes of the pixels whose coverage is neither 0 nor 1.
pub fn half_planes(frame: &FrontLayer, mixed: &[MixedPixel]) -> Vec<(usize, HalfPlane)> {
    let (width, height) = (frame.size.width, frame.size.height);
    let first_from = |index: usize| mixed.partition_point(|m| m.index < index);
    let starts: Vec<usize> = (0..=height).into_par_iter().map(|y| first_from(y * width)).collect();
    let row = |y: usize| {
        let row_of = |y: usize| &mixed[starts[y]..starts[y + 1]];
        // The rows above, here and below, each without the pixels too far left to be neighbours of any pixel still to
        // come.
        let mut rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(row_of);
        let mut planes = Vec::new();
        for m in row_of(y) {
            let x = m.index % width;
            for row in &mut rows {
                let left = row.iter().take_while(|q| q.index % width + 1 < x).count();
                *row = &row[left..];
            }
            if m.coverage <= 0.0 || m.coverage >= 1.0 {
                continue;
            }
            let middle = 0.5 * (m.s_front + m.s_back);
            let coverage_of = |j: usize, q: usize| {
                let own = rows[j].iter().take(3).find(|other| other.index == q);
                own.map_or_else(|| f32::from(frame.s[q] > middle), |own| own.coverage)
            };
            let around = std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    let q = frame.offset(x, y, i as i32 - 1, j as i32 - 1);
                    q.map_or(m.coverage, |q| coverage_of(j, q))
                })
            });
            planes.push((m.index, HalfPlane::from_coverage(around, m.index)));
        }
        planes
    };
    (0..height).into_par_iter().flat_map_iter(row).collect()
}
