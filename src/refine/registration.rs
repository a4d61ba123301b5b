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
/// Pixels along the border that have no edges: what is farther than this from an edge is not looked at.
const MARGIN: usize = 2 * REACH as usize + 2;
/// Pixels along the sides of what is looked at, and those before the edge.
const PATCH: usize = 16;
const BEFORE: usize = 7;
/// Edges whose sum one worker makes.
const EDGES_PER_TASK: usize = 256;

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
    let candidates: Vec<[i32; 3]> = (-REACH..=REACH)
        .flat_map(|x| (-REACH..=REACH).flat_map(move |y| (-REACH..=REACH).map(move |growth| [x, y, growth])))
        .filter(|[x, y, growth]| x * x + y * y + growth * growth <= (REACH + 1) * (REACH + 1))
        .collect();
    let scores = scores(&edges, colors, &candidates, total);
    let best = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    let mean = scores.iter().sum::<f32>() / scores.len() as f32;
    let at_edges = candidates.iter().position(|candidate| *candidate == [0; 3])?;
    let (highest, here) = (scores[best], scores[at_edges]);
    let trust = fade(highest / here.max(1e-6), BETTER[0], BETTER[1])
        * fade(highest / mean.max(1e-6), CLEAR[0], CLEAR[1]);
    if trust <= 0.0 {
        return None;
    }
    // The vertex of a parabola along each axis.
    let beside = |axis: usize, step: i32| {
        let mut candidate = candidates[best];
        candidate[axis] += step;
        candidate
    };
    let neighbours: Vec<[i32; 3]> = (0..3).flat_map(|axis| [beside(axis, -1), beside(axis, 1)]).collect();
    let around = self::scores(&edges, colors, &neighbours, total);
    let found: [f32; 3] = std::array::from_fn(|axis| {
        let (before, after) = (around[2 * axis], around[2 * axis + 1]);
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

/// How much colours change across edges, on average, for each candidate of right, down and growth. `total` is the sum of
/// the edges' weights.
fn scores(edges: &[Edge], colors: &[Plane], candidates: &[[i32; 3]], total: f64) -> Vec<f32> {
    let of_some = |edges: &[Edge]| {
        let mut sums = vec![0.0; candidates.len()];
        for edge in edges {
            let patches: Vec<Patch> = colors.iter().map(|color| Patch::around(color, edge)).collect();
            for (sum, candidate) in sums.iter_mut().zip(candidates) {
                let changes = patches.iter().map(|patch| patch.change(edge, *candidate).powi(2));
                *sum += f64::from(edge.weight * changes.sum::<f32>().sqrt().min(STRONG));
            }
        }
        sums
    };
    let sums: Vec<Vec<f64>> = edges.par_chunks(EDGES_PER_TASK).map(of_some).collect();
    let sum = |i: usize| sums.iter().map(|sums| sums[i]).sum::<f64>();
    (0..candidates.len()).map(|i| (sum(i) / total) as f32).collect()
}

/// A channel around an edge.
struct Patch {
    values: [f32; PATCH * PATCH],
    /// The edge's place in it.
    place: [f32; 2],
}

impl Patch {
    fn around(color: &Plane, edge: &Edge) -> Patch {
        let first = edge.place.map(|v| v as usize - BEFORE);
        let mut values = [0.0; PATCH * PATCH];
        for (row, values) in values.chunks_exact_mut(PATCH).enumerate() {
            let from = &color.values[(first[1] + row) * color.width + first[0]..][..PATCH];
            values.copy_from_slice(from);
        }
        Patch { values, place: std::array::from_fn(|i| edge.place[i] - first[i] as f32) }
    }

    /// By how much it changes across the edge, were the edge elsewhere.
    #[inline(always)]
    fn change(&self, edge: &Edge, [x, y, growth]: [i32; 3]) -> f32 {
        let at = |along: f32| {
            let along = growth as f32 + along;
            let [across, down] = [0, 1].map(|i| self.place[i] + [x, y][i] as f32 + along * edge.normal[i]);
            let (left, top) = (across as usize, down as usize);
            let (across, down) = (across - left as f32, down - top as f32);
            let [above, below] = [top, top + 1].map(|row| {
                let row = &self.values[row * PATCH + left..][..2];
                row[0] + across * (row[1] - row[0])
            });
            // About as the eye sees it.
            (above + down * (below - above)).clamp(0.0, 1.0).sqrt()
        };
        at(0.75) - at(-0.75)
    }
}

/// The axis along which a pixel and its neighbour differ.
#[derive(Clone, Copy)]
enum Axis {
    Across,
    Down,
}

/// Edges of depth all over the picture.
fn edges(depth: &Plane, range: f32) -> Vec<Edge> {
    if depth.width <= 2 * MARGIN || depth.height <= 2 * MARGIN {
        return Vec::new();
    }
    let weight = |step: f32| {
        let share = step.abs() / range;
        fade(share, LEAST_CONTRAST, 2.0 * LEAST_CONTRAST) * share.min(STRONG)
    };
    let found: Vec<(usize, usize, Axis)> = (MARGIN..depth.height - MARGIN)
        .into_par_iter()
        .flat_map_iter(|y| {
            let (row, below) = (depth.row(y as isize), depth.row(y as isize + 1));
            (MARGIN..depth.width - MARGIN).flat_map(move |x| {
                let across = (weight(row[x + 1] - row[x]) > 0.0).then_some((x, y, Axis::Across));
                let down = (weight(below[x] - row[x]) > 0.0).then_some((x, y, Axis::Down));
                across.into_iter().chain(down)
            })
        })
        .collect();
    let step = found.len().div_ceil(EDGES).max(1);
    let edge = |&(x, y, axis): &(usize, usize, Axis)| {
        let (x, y) = (x as isize, y as isize);
        let slope = smooth_slope(depth, x, y);
        let steep = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt().max(f32::MIN_POSITIVE);
        let normal = slope.map(|v| v / steep);
        let (beside, along, offset) = match axis {
            Axis::Across => (depth.at(x + 1, y), normal[0], [0.5, 0.0]),
            Axis::Down => (depth.at(x, y + 1), normal[1], [0.0, 0.5]),
        };
        let place = [x as f32 + offset[0], y as f32 + offset[1]];
        Edge { place, normal, weight: weight(beside - depth.at(x, y)) * along.abs() }
    };
    found.par_iter().step_by(step).map(edge).collect()
}

/// The slope of depth that is blurred by a Gaussian of one pixel, across and down.
fn smooth_slope(depth: &Plane, x: isize, y: isize) -> [f32; 2] {
    const REACH: isize = 3;
    let mut slope = [0.0; 2];
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let weight = (-0.5 * (dx * dx + dy * dy) as f32).exp();
            let (x, y) = (x + dx, y + dy);
            slope[0] += weight * (depth.at(x + 1, y) - depth.at(x - 1, y));
            slope[1] += weight * (depth.at(x, y + 1) - depth.at(x, y - 1));
        }
    }
    slope
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
    ///
    /// What would vanish stays as it is: of a twig that a soft map has widened, both are seen to be too large.
    pub fn shrunk(&self, depth: &Plane) -> Option<Plane> {
        let radius = self.growth.abs().round() as usize;
        if radius == 0 {
            return None;
        }
        type Extremes = fn(&Plane, usize) -> Plane;
        let (sign, toward, back): (f32, Extremes, Extremes) = match self.growth > 0.0 {
            true => (1.0, Plane::minima, Plane::maxima),
            false => (-1.0, Plane::maxima, Plane::minima),
        };
        let out = toward(depth, radius);
        // By how much what is there is nearer, or farther, than all that is left around it.
        let left = back(&out, 2 * radius + 1);
        let lost = depth.with(&left, |depth, left| sign * (sign * (depth - left)).max(0.0));
        Some(out.with(&lost, |out, lost| out + lost))
    }
}
