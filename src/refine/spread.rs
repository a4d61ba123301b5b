//! What became of sharp depth in a map, and how much of something the map has lost.

use super::plane::{Plane, Tile, fade, gaussian, mean};
use super::steps::LEAST_CONTRAST;

/// The deviations of Gaussians that are tried, as parts of the width of edges. A Gaussian's edges are 2.5 deviations wide,
/// those of a mean over a square 3.5 of its own.
const DEVIATIONS: [f32; 5] = [0.29, 0.34, 0.39, 0.44, 0.49];
/// Pixels along a side of the squares in which filters are compared with a map.
const SQUARE: usize = 8;
/// Where the best filter leaves so much of the map's variance unexplained, the sharp depth itself is not known.
const UNEXPLAINED: [f32; 2] = [0.002, 0.02];

/// What became of sharp depth.
#[derive(Debug, Clone)]
pub enum Spread {
    /// It was filtered, along both axes, with the weights of offsets 0, 1, 2 ...
    Filter(Vec<f32>),
    /// It was averaged over squares of so many pixels, and enlarged.
    Blocks(usize),
}

impl Spread {
    /// What becomes of a plane.
    pub fn of(&self, plane: &Plane) -> Plane {
        match self {
            Spread::Filter(weights) => plane.filtered(weights),
            Spread::Blocks(side) => plane.averaged(*side).resized(plane.width, plane.height),
        }
    }

    /// The filter that made `depth`, whose edges are `width_px` wide, of sharp depth: a Gaussian, a mean over squares, or
    /// something between both. It is measured in the tiles of which `counts` says so of the third plane; `None` if there
    /// are none.
    ///
    /// In each small square, the filtered depth is compared with the map by what a line through both leaves unexplained.
    /// So it does not count that ramps which do not end have made the contrast of sharp depth too small, which would make
    /// the filter too narrow.
    pub fn measured(
        planes: [&Plane; 3],
        width_px: f32,
        range: f32,
        counts: impl Fn(&Plane) -> bool + Sync,
    ) -> Option<Spread> {
        let gaussians = DEVIATIONS.map(|part| gaussian(part * width_px));
        let square = mean(width_px);
        let filters: Vec<&[f32]> = gaussians.iter().chain([&square]).map(|weights| &weights[..]).collect();
        let margin = filters.iter().map(|weights| weights.len()).max().unwrap_or(0).next_multiple_of(SQUARE);
        let least = (0.5 * LEAST_CONTRAST * range).powi(2);
        let sums = Tile::each(planes, margin, |Tile { planes: [depth, sharp, light], .. }| {
            counts(&light).then(|| {
                let tries: Vec<Plane> = filters.iter().map(|weights| sharp.filtered(weights)).collect();
                let mut sums = vec![0.0f64; tries.len()];
                let [columns, rows] =
                    [depth.width, depth.height].map(|n| margin..(n - margin + 1).saturating_sub(SQUARE));
                for (x, y) in
                    rows.step_by(SQUARE).flat_map(|y| columns.clone().step_by(SQUARE).map(move |x| (x, y)))
                {
                    let of: Vec<Unexplained> =
                        tries.iter().map(|tried| unexplained(&depth, tried, (x, y))).collect();
                    let variance = of[0].of;
                    if variance <= least {
                        continue;
                    }
                    let best = of.iter().fold(variance, |best, one| best.min(one.left)) / variance;
                    let weight =
                        fade(variance, least, 4.0 * least) * fade(-best, -UNEXPLAINED[1], -UNEXPLAINED[0]);
                    sums.iter_mut().zip(&of).for_each(|(sum, one)| *sum += f64::from(weight * one.left));
                }
                sums
            })
        });
        let mut left = vec![0.0; filters.len()];
        let mut any = false;
        for sums in sums.iter().flatten() {
            any = true;
            left.iter_mut().zip(sums).for_each(|(left, sum)| *left += sum);
        }
        any.then(|| {
            let (deviation, of_gaussian) = least_of(&left[..DEVIATIONS.len()]);
            let of_square = left[DEVIATIONS.len()];
            let (a, b) = (of_gaussian * of_gaussian, of_square * of_square);
            let share = if a + b > 0.0 { (a / (a + b)) as f32 } else { 0.0 };
            Spread::Filter(mixed(&gaussian(deviation * width_px), &square, share))
        })
    }
}

/// The variance of a map in a square, and what a filter leaves of it.
struct Unexplained {
    of: f32,
    left: f32,
}

/// What a line through the values of a filtered plane and a map leaves unexplained of the map, in the square at a place.
fn unexplained(map: &Plane, filtered: &Plane, (x, y): (usize, usize)) -> Unexplained {
    // Differences from the first pixel keep their digits.
    let at = y * map.width + x;
    let (first, filtered_first) = (map.values[at], filtered.values[at]);
    let mut sums = [0.0f32; 5];
    for row in (0..SQUARE).map(|row| at + row * map.width) {
        for i in row..row + SQUARE {
            let (a, b) = (map.values[i] - first, filtered.values[i] - filtered_first);
            [a, b, a * a, b * b, a * b].iter().zip(&mut sums).for_each(|(v, sum)| *sum += v);
        }
    }
    let [a, b, aa, bb, ab] = sums.map(|sum| sum / (SQUARE * SQUARE) as f32);
    let (of, own, shared) = ((aa - a * a).max(0.0), bb - b * b, (ab - a * b).max(0.0));
    let explained = if own > 0.0 { shared * shared / own } else { 0.0 };
    Unexplained { of, left: (of - explained).max(0.0) }
}

/// The deviation that leaves the least, as a part of the width of edges, and what it leaves: the vertex of the parabola
/// through the least one and its neighbours.
fn least_of(left: &[f64]) -> (f32, f64) {
    let last = left.len() - 1;
    let best = (1..last).min_by(|a, b| left[*a].total_cmp(&left[*b])).unwrap_or(1);
    let [before, least, after] = [left[best - 1], left[best], left[best + 1]];
    let curvature = before - 2.0 * least + after;
    let offset = if curvature > 0.0 { (0.5 * (before - after) / curvature).clamp(-1.0, 1.0) } else { 0.0 };
    let vertex = least - 0.5 * offset * (before - after) + 0.5 * offset * offset * curvature;
    let step = DEVIATIONS[1] - DEVIATIONS[0];
    (DEVIATIONS[best] + offset as f32 * step, vertex.max(0.0))
}

/// A filter between two.
fn mixed(a: &[f32], b: &[f32], share: f32) -> Vec<f32> {
    let weight = |of: &[f32], i: usize| of.get(i).copied().unwrap_or(0.0);
    (0..a.len().max(b.len())).map(|i| weight(a, i) + share * (weight(b, i) - weight(a, i))).collect()
}

/// Local statistics of planes and of one that they are compared with.
pub struct Local<'a> {
    probe: &'a Plane,
    mean: Plane,
    window_px: f32,
}

impl Local<'_> {
    /// Statistics in a Gaussian window of this standard deviation.
    pub fn new(probe: &Plane, window_px: f32) -> Local<'_> {
        Local { probe, mean: probe.blurred(window_px), window_px }
    }

    /// The covariance of a plane with the probe.
    pub fn covariance(&self, plane: &Plane) -> Plane {
        let products = plane.with(self.probe, |a, b| a * b).blurred(self.window_px);
        let means = plane.blurred(self.window_px).with(&self.mean, |a, b| a * b);
        products.with(&means, |product, means| product - means)
    }

    /// The squared correlation of a plane with the probe.
    pub fn correlation(&self, plane: &Plane) -> Plane {
        let mean = plane.blurred(self.window_px);
        let square = plane.with(plane, |a, b| a * b).blurred(self.window_px);
        let variance = square.with(&mean, |square, mean| square - mean * mean);
        let variances = variance.with(&self.covariance(self.probe), |a, b| a * b);
        self.covariance(plane).with(&variances, |shared, both| shared * shared / both.max(1e-20))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Discs before a wall, and a wall that is even.
    fn sharp() -> Plane {
        Plane::of_rows(400, 120, |y, row| {
            row.iter_mut().enumerate().for_each(|(x, v)| {
                let from_middle = ((x % 50) as f32 - 25.0).hypot((y % 40) as f32 - 20.0);
                *v = if x < 200 && from_middle < 9.0 { 1.0 } else { 0.2 };
            });
        })
    }

    fn measured(weights: &[f32], width_px: f32) -> Vec<f32> {
        let (sharp, light) = (sharp(), sharp());
        // Ramps that do not end have a part of the contrast.
        let weak = sharp.with(&sharp, |v, _| 0.2 + 0.9 * (v - 0.2));
        match Spread::measured([&sharp.filtered(weights), &weak, &light], width_px, 0.8, |_| true) {
            Some(Spread::Filter(weights)) => weights,
            other => panic!("{other:?} is no filter"),
        }
    }

    fn assert_close(found: &[f32], wanted: &[f32]) {
        let at = |of: &[f32], i: usize| of.get(i).copied().unwrap_or(0.0);
        for i in 0..found.len().max(wanted.len()) {
            assert!((at(found, i) - at(wanted, i)).abs() < 0.01, "{found:?} for {wanted:?}");
        }
    }

    #[test]
    fn a_gaussian_is_told_from_a_mean_over_squares_by_what_it_made_of_edges() {
        for sigma in [1.2, 1.6, 2.0, 2.4] {
            assert_close(&measured(&gaussian(sigma), 2.5 * sigma), &gaussian(sigma));
        }
        for width in [3.0, 5.0] {
            assert_close(&measured(&mean(width), width), &mean(width));
        }
    }
}
