//! Ramps of depth become steps.
//!
//! Whatever blurred a depth map, a filter, a network or interpolation, did so alike on both sides of an edge. So the edge
//! is where the ramp passes the middle between both surfaces, to a fraction of a pixel, whether the picture shows it
//! there or not. Each pixel of a ramp gets the depth of the surface on whose side of the middle it is, and that depth
//! is taken from where the ramp has ended.

use super::plane::{Plane, fade};
use crate::picture::KnownCoverage;
use rayon::prelude::*;

/// Contrasts below this share of all depths stay as they are, and those above twice as much are steps.
pub const LEAST_CONTRAST: f32 = 0.02;

/// Depth with steps.
pub struct Steps {
    /// The depth.
    pub depth: Plane,
    /// Where the steps are, to a fraction of a pixel.
    pub edges: Edges,
}

/// How the pixels of edges are divided between two surfaces.
pub struct Edges {
    /// The share of each pixel that the nearer of two surfaces covers.
    pub coverage: Plane,
    /// How far that is known, 0 to 1; 0 away from edges.
    pub trust: Plane,
}

impl Edges {
    /// No edges, in a plane of this size.
    pub fn none(size: &Plane) -> Edges {
        Edges { coverage: size.like(|_, out| out.fill(1.0)), trust: size.like(|_, out| out.fill(0.0)) }
    }

    /// The same edges, of which less is known.
    pub fn trusted(&self, share: f32) -> Edges {
        let trust = self.trust.with(&self.trust, |trust, _| share * trust);
        Edges { coverage: self.coverage.clone(), trust }
    }

    /// The coverage of each pixel by the nearer of two surfaces, and 1 away from edges.
    pub fn faded(&self) -> Plane {
        self.coverage.with(&self.trust, |coverage, trust| 1.0 + trust * (coverage - 1.0))
    }

    /// What is known of the pixels of edges, in the order of rows.
    pub fn known(&self) -> Vec<KnownCoverage> {
        let row = |y: usize| {
            let rows = self.coverage.row(y as isize).iter().zip(self.trust.row(y as isize));
            let all = rows.enumerate().map(move |(x, (coverage, trust))| KnownCoverage {
                index: y * self.trust.width + x,
                coverage: *coverage,
                trust: *trust,
            });
            all.filter(|known| known.trust > 0.0)
        };
        (0..self.trust.height).into_par_iter().flat_map_iter(row).collect()
    }
}

/// How far away a pixel may be that has a say in a step: the window of surfaces, and the one that finds ramps.
pub fn margin_px(width_px: f32) -> usize {
    2 * reach_px(width_px) + 2
}

/// How far away a ramp may end.
pub fn reach_px(width_px: f32) -> usize {
    width_px.ceil().max(2.0) as usize
}

/// Turns ramps that are `width_px` wide into steps. `range` is the extent of all depths.
pub fn steps(depth: &Plane, width_px: f32, range: f32) -> Steps {
    let reach = reach_px(width_px);
    let (high, low) = (depth.maxima(reach), depth.minima(reach));
    let slopes = slopes(depth);
    let across = 2.0 * reach as f32;
    // Steepness relative to a plane that has the window's whole contrast: about 1 on a plane, more on a ramp.
    let steepness = slopes.like(|y, out| {
        let y = y as isize;
        let rows = slopes.row(y).iter().zip(high.row(y).iter().zip(low.row(y)));
        out.iter_mut().zip(rows).for_each(|(out, (slope, (high, low)))| {
            *out = slope * across / (high - low).max(f32::MIN_POSITIVE);
        });
    });
    let steepness = steepness.maxima(reach.div_ceil(2));
    // How well a pixel tells the depth of a surface: where a ramp is, it does not.
    let kept = slopes.like(|y, out| {
        let y = y as isize;
        let rows = slopes.row(y).iter().zip(high.row(y).iter().zip(low.row(y)));
        out.iter_mut().zip(rows).for_each(|(out, (slope, (high, low)))| {
            let share = slope * width_px / (0.25 * (high - low)).max(f32::MIN_POSITIVE);
            let square = 1.0 + 0.25 * share * share;
            *out = (square * square * square * square).recip();
        });
    });
    let window = Window::new(reach + 1);
    let surfaces = |x: usize, y: usize| {
        let i = y * depth.width + x;
        window.surfaces(depth, &kept, x, y, low.values[i], high.values[i])
    };
    let is_ramp = |x: usize, y: usize| {
        let i = y * depth.width + x;
        let contrast = high.values[i] - low.values[i];
        fade(contrast / range, LEAST_CONTRAST, 2.0 * LEAST_CONTRAST)
            * fade(steepness.values[i], 1.3, 1.9)
            * fade(slopes.values[i] * width_px / contrast.max(f32::MIN_POSITIVE), 0.02, 0.06)
    };
    let mut edges = Edges::none(depth);
    let mut out = depth.clone();
    let rows = out.values.par_chunks_mut(depth.width).zip(edges.coverage.values.par_chunks_mut(depth.width));
    let rows = rows.zip(edges.trust.values.par_chunks_mut(depth.width));
    rows.enumerate().for_each(|(y, ((out, coverage), trust))| {
        for x in 0..out.len() {
            let weight = is_ramp(x, y);
            if weight <= 0.0 {
                continue;
            }
            let (far, near) = surfaces(x, y);
            let v = depth.values[y * depth.width + x];
            let share = (v - far) / (near - far).max(f32::MIN_POSITIVE);
            let step = if share > 0.5 { near } else { far };
            out[x] = v + weight * (step - v);
            // Pixels to the middle of the ramp, within the nearer surface positive.
            let inside_px = width_px * (share - 0.5);
            (coverage[x], trust[x]) = ((0.5 + inside_px).clamp(0.0, 1.0), weight);
        }
    });
    Steps { depth: out, edges }
}

/// The steepest slope on either side of each pixel.
fn slopes(depth: &Plane) -> Plane {
    depth.like(|y, out| {
        let y = y as isize;
        let (above, row, below) = (depth.row(y - 1), depth.row(y), depth.row(y + 1));
        for (x, out) in out.iter_mut().enumerate() {
            let (left, right) = (row[x.saturating_sub(1)], row[(x + 1).min(row.len() - 1)]);
            let across = (right - row[x]).abs().max((row[x] - left).abs());
            let down = (below[x] - row[x]).abs().max((row[x] - above[x]).abs());
            *out = (across * across + down * down).sqrt();
        }
    })
}

/// The pixels around one, each with a weight.
struct Window {
    reach: usize,
    /// Weights of a quadrant: of offsets 0 to `reach` along both axes.
    weights: Vec<f32>,
}

impl Window {
    fn new(reach: usize) -> Window {
        let side = reach + 1;
        let sigma = 0.5 * reach as f32;
        let weight = |i: usize| {
            let (x, y) = ((i % side) as f32, (i / side) as f32);
            (-0.5 * (x * x + y * y) / (sigma * sigma)).exp()
        };
        Window { reach, weights: (0..side * side).map(weight).collect() }
    }

    /// The depths of the farther and the nearer surface around a pixel: means of what the ramp does not reach, on either
    /// side of the middle between `low` and `high`.
    fn surfaces(&self, depth: &Plane, kept: &Plane, x: usize, y: usize, low: f32, high: f32) -> (f32, f32) {
        let (reach, side) = (self.reach, self.reach + 1);
        let (first, last) = (x.saturating_sub(reach), (x + reach).min(depth.width - 1));
        let (middle, contrast) = (0.5 * (low + high), high - low);
        let scale = 1.0 / contrast;
        let (mut far, mut near) = ([0.0f32; 2], [0.0f32; 2]);
        for row in y.saturating_sub(reach)..=(y + reach).min(depth.height - 1) {
            let weights = &self.weights[y.abs_diff(row) * side..][..side];
            let start = row * depth.width;
            let values = &depth.values[start + first..=start + last];
            let kept = &kept.values[start + first..=start + last];
            for (i, (v, kept)) in values.iter().zip(kept).enumerate() {
                let weight = kept * weights[x.abs_diff(first + i)];
                let side = (v - middle) * scale;
                let (of_near, of_far) = (weight * fade(side, 0.1, 0.4), weight * fade(-side, 0.1, 0.4));
                near[0] += of_near * (v - high);
                near[1] += of_near;
                far[0] += of_far * (v - low);
                far[1] += of_far;
            }
        }
        // Where there is nothing but ramp, its ends are all that is known.
        let mean = |[sum, weight]: [f32; 2]| sum / weight.max(1e-3);
        (low + mean(far), high + mean(near))
    }
}
