//! Where depth lies beside the picture, or is larger than what it shows.
//!
//! A phone's depth is seen from a second lens, a network's foreground is often a pixel or two too large. Both leave one trace in
//! the whole picture: across the edges of the depth, colours change most not at the edges but somewhere beside them. The
//! one displacement and the one growth for which they change most are those of the map.

use super::plane::{Plane, fade};
use rayon::prelude::*;

/// How far edges are looked for in pixels.
const REACH: i32 = 3;
/// Edges of a smaller share of all depths do not count.
const LEAST_CONTRAST: f32 = 0.05;
/// A colour that changes by more than this share of white is an edge, whatever it changes by.
const STRONG: f32 = 0.3;
/// About as many edges are looked at.
const EDGES: usize = 16_384;
/// By how much more colours must change beside the edges than at them, and than anywhere near.
const BETTER: [f32; 2] = [1.15, 1.35];
const CLEAR: [f32; 2] = [1.25, 1.5];

/// Less is the measurement's own error, and no misfit.
const LEAST_PX: [f32; 2] = [0.25, 0.5];

/// What a map is to be corrected by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// The place of what the map has at (0, 0), in pixels right and down.
    pub shift: [f32; 2],
    /// By how many pixels the nearer of two surfaces is too large.
    pub growth: f32,
}

/// An edge of depth: its place, the direction in which depth becomes nearer, and its weight.
struct Edge {
    place: [f32; 2],
    normal: [f32; 2],
    weight: f32,
}

/// Measures the misfit of a map with steps, if there is one. `colors` are the channels of linear light, `range` is the extent of all depths.
pub fn misfit(depth: &Plane, colors: &[Plane], range: f32) -> Option<Misfit> {
    let edges = edges(depth, range);
    let total: f64 = edges.iter().map(|edge| f64::from(edge.weight)).sum();
    if total <= 0.0 {
        return None;
    }
    let score = |[x, y, growth]: [i32; 3]| -> f32 {
        let changes = edges.iter().map(|edge| {
            let at = |color: &Plane, along: f32| {
                let along = growth as f32 + along;
                let place = [0, 1].map(|i| edge.place[i] + [x, y][i] as f32 + along * edge.normal[i]);
                // About as the eye sees it.
                interpolated(color, place[0], place[1]).clamp(0.0, 1.0).sqrt()
            };
            let changes = colors.iter().map(|color| at(color, 0.75) - at(color, -0.75));
            let change = changes.map(|v| v * v).sum::<f32>().sqrt();
            f64::from(edge.weight * change.min(STRONG))
        });
        (changes.sum::<f64>() / total) as f32
    };
    let candidates: Vec<[i32; 3]> = (-REACH..=REACH)
        .flat_map(|x| (-REACH..=REACH).flat_map(move |y| (-REACH..=REACH).map(move |growth| [x, y, growth])))
        .filter(|[x, y, growth]| x * x + y * y + growth * growth <= (REACH + 1) * (REACH + 1))
        .collect();
    let scores: Vec<f32> = candidates.par_iter().map(|candidate| score(*candidate)).collect();
    let best = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    let of = |candidate: [i32; 3]| {
        candidates
            .iter()
            .position(|other| *other == candidate)
            .map_or_else(|| score(candidate), |i| scores[i])
    };
    let mean = scores.iter().sum::<f32>() / scores.len() as f32;
    let (highest, here) = (scores[best], of([0; 3]));
    let trust = fade(highest / here.max(1e-6), BETTER[0], BETTER[1])
        * fade(highest / mean.max(1e-6), CLEAR[0], CLEAR[1]);
    if trust <= 0.0 {
        return None;
    }
    // The vertex of a parabola along each axis.
    let found: [f32; 3] = std::array::from_fn(|axis| {
        let beside = |step: i32| {
            let mut candidate = candidates[best];
            candidate[axis] += step;
            of(candidate)
        };
        let (before, after) = (beside(-1), beside(1));
        let curvature = before - 2.0 * highest + after;
        let offset =
            if curvature < 0.0 { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) } else { 0.0 };
        let measured = trust * (candidates[best][axis] as f32 + offset);
        measured * fade(measured.abs(), LEAST_PX[0], LEAST_PX[1])
    });
    if found == [0.0; 3] {
        return None;
    }
    Some(Misfit { shift: [found[0], found[1]], growth: found[2] })
}

/// Edges of depth all over the picture.
fn edges(depth: &Plane, range: f32) -> Vec<Edge> {
    let margin = 2 * REACH as usize + 2;
    if depth.width <= 2 * margin || depth.height <= 2 * margin {
        return Vec::new();
    }
    let smooth = depth.blurred(1.0);
    let rows = margin..depth.height - margin;
    let found: Vec<Edge> = rows
        .into_par_iter()
        .flat_map_iter(|y| {
            let (row, below) = (depth.row(y as isize), depth.row(y as isize + 1));
            let smooth = &smooth;
            (margin..depth.width - margin).flat_map(move |x| {
                let across = (row[x + 1] - row[x], [0.5, 0.0]);
                let down = (below[x] - row[x], [0.0, 0.5]);
                [across, down].into_iter().filter_map(move |(step, offset)| {
                    let share = step.abs() / range;
                    let weight = fade(share, LEAST_CONTRAST, 2.0 * LEAST_CONTRAST) * share.min(STRONG);
                    if weight <= 0.0 {
                        return None;
                    }
                    let (x, y) = (x as isize, y as isize);
                    let slope = [
                        smooth.at(x + 1, y) - smooth.at(x - 1, y),
                        smooth.at(x, y + 1) - smooth.at(x, y - 1),
                    ];
                    let steep = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt().max(f32::MIN_POSITIVE);
                    let normal = slope.map(|v| v / steep);
                    let along = if offset[0] > 0.0 { normal[0] } else { normal[1] };
                    let place = [x as f32 + offset[0], y as f32 + offset[1]];
                    Some(Edge { place, normal, weight: weight * along.abs() })
                })
            })
        })
        .collect();
    let step = found.len().div_ceil(EDGES).max(1);
    found.into_iter().step_by(step).collect()
}

fn interpolated(plane: &Plane, x: f32, y: f32) -> f32 {
    let (left, top) = (x.floor(), y.floor());
    let (across, down) = (x - left, y - top);
    let (left, top) = (left as isize, top as isize);
    let row = |y: isize| {
        let (a, b) = (plane.at(left, y), plane.at(left + 1, y));
        a + across * (b - a)
    };
    let (above, below) = (row(top), row(top + 1));
    above + down * (below - above)
}

impl Misfit {
    /// Depth where the picture shows it.
    pub fn shifted(&self, depth: &Plane) -> Plane {
        if self.shift == [0.0; 2] {
            return depth.clone();
        }
        depth.like(|y, out| {
            for (x, out) in out.iter_mut().enumerate() {
                *out = interpolated(depth, x as f32 - self.shift[0], y as f32 - self.shift[1]);
            }
        })
    }

    /// Sharp depth whose nearer surfaces are as large as the picture shows them, if they are not already.
    pub fn shrunk(&self, depth: &Plane) -> Option<Plane> {
        let radius = self.growth.abs().round() as usize;
        match radius {
            0 => None,
            _ if self.growth > 0.0 => Some(depth.minima(radius)),
            _ => Some(depth.maxima(radius)),
        }
    }
}
