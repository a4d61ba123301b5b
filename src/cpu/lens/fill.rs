//! What lies hidden behind foreground edges: colour and depth of the surface that the lens sees there and the
//! pinhole did not.

use super::sheets::Sheet;
use super::surfaces::{CONNECTED_PX, EDGE};
use super::unmix::Frame;
use rayon::prelude::*;

/// Directions in which a hidden pixel looks for what continues behind it.
const DIRECTIONS: usize = 16;
/// How far beyond a silhouette a pure pixel is looked for.
const BEYOND_EDGE: usize = 4;
/// Hits this close in shift are one surface.
const SAME_SURFACE_PX: f32 = 2.0;
/// A hidden surface lies at least this far behind what hides it.
const BEHIND_PX: f32 = 0.5;
/// A lens sees no farther behind a silhouette than the difference in shift, and a little more for rounding.
const MARGIN_PX: f32 = 2.0;
/// Side of the blocks that say where silhouettes are.
const BLOCK: usize = 16;

/// A hidden pixel filled in.
pub struct Hidden {
    pub index: usize,
    pub s: f32,
    pub color: [f32; 4],
}

/// Where a look in one direction came out from behind the foreground.
#[derive(Clone, Copy)]
struct Hit {
    distance: f32,
    s: f32,
    color: [f32; 4],
}

/// Offsets of the pixels met in each direction, up to a distance.
fn rays(reach: usize) -> Vec<Vec<(i32, i32)>> {
    (0..DIRECTIONS)
        .map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / DIRECTIONS as f64;
            // Steps of one pixel along the longer axis, so that no pixel is met twice.
            let (x, y) = (angle.cos(), angle.sin());
            let longest = x.abs().max(y.abs());
            let steps = (reach as f64 * longest).ceil() as usize;
            (1..=steps)
                .map(|k| {
                    let along = k as f64 / longest;
                    ((along * x).round() as i32, (along * y).round() as i32)
                })
                .collect()
        })
        .collect()
}

/// Least shift at a silhouette, and greatest shift of all, of each block of pixels.
struct Blocks {
    across: usize,
    edge_s: Vec<f32>,
    max_s: Vec<f32>,
}

impl Blocks {
    fn new(frame: &Frame) -> Blocks {
        let across = frame.size.width.div_ceil(BLOCK);
        let down = frame.size.height.div_ceil(BLOCK);
        let (edge_s, max_s) = (0..across * down)
            .into_par_iter()
            .map(|b| {
                let (x0, y0) = (b % across * BLOCK, b / across * BLOCK);
                let (mut edge_s, mut max_s) = (f32::INFINITY, f32::NEG_INFINITY);
                for y in y0..(y0 + BLOCK).min(frame.size.height) {
                    for x in x0..(x0 + BLOCK).min(frame.size.width) {
                        let i = y * frame.size.width + x;
                        max_s = max_s.max(frame.s[i]);
                        if frame.links[i] & EDGE != 0 {
                            edge_s = edge_s.min(frame.s[i]);
                        }
                    }
                }
                (edge_s, max_s)
            })
            .unzip();
        Blocks { across, edge_s, max_s }
    }

    /// The least shift at a silhouette that any pixel of block `b` could uncover, if there is one.
    fn farthest_uncovered(&self, b: usize, s_min: f32) -> Option<f32> {
        let (bx, by, down) = (b % self.across, b / self.across, self.edge_s.len() / self.across);
        let reach = ((self.max_s[b] - s_min + MARGIN_PX) as usize).div_ceil(BLOCK) + 1;
        let apart = |a: usize, b: usize| (a.abs_diff(b).saturating_sub(1) * BLOCK) as f32;
        let mut farthest = f32::INFINITY;
        for y in by.saturating_sub(reach)..(by + reach + 1).min(down) {
            for x in bx.saturating_sub(reach)..(bx + reach + 1).min(self.across) {
                let s = self.edge_s[y * self.across + x];
                if apart(bx, x).hypot(apart(by, y)) <= self.max_s[b] - s + MARGIN_PX {
                    farthest = farthest.min(s);
                }
            }
        }
        farthest.is_finite().then_some(farthest)
    }
}

/// Follows one direction from pixel `(x, y)`, at shift `s_start`, until it leaves the foreground.
fn look(
    frame: &Frame,
    back: &Sheet,
    (x, y): (usize, usize),
    s_start: f32,
    s_farthest: f32,
    ray: &[(i32, i32)],
) -> Option<Hit> {
    let mut previous = y * frame.size.width + x;
    for (step, &(dx, dy)) in ray.iter().enumerate() {
        let distance = (dx as f32).hypot(dy as f32);
        if distance > s_start - s_farthest + MARGIN_PX {
            return None;
        }
        let here = frame.offset(x, y, dx, dy)?;
        let drop = frame.s[previous] - frame.s[here];
        let silhouette = drop.abs() >= CONNECTED_PX && frame.links[previous] & frame.links[here] & EDGE != 0;
        if silhouette && drop < 0.0 {
            return None;
        }
        if silhouette && frame.s[here] <= s_start - CONNECTED_PX {
            if distance > s_start - frame.s[here] + MARGIN_PX {
                return None;
            }
            let color = pure_beyond(frame, back, (x, y), here, &ray[step..]);
            return Some(Hit { distance, s: frame.s[here], color });
        }
        previous = here;
    }
    None
}

/// The colour of the first pixel beyond a silhouette that mixes with nothing, or else the unmixed one there.
fn pure_beyond(frame: &Frame, back: &Sheet, (x, y): (usize, usize), hit: usize, ray: &[(i32, i32)]) -> [f32; 4] {
    let beyond = ray.iter().take(BEYOND_EDGE).map_while(|&(dx, dy)| frame.offset(x, y, dx, dy));
    let pure = beyond
        .take_while(|&q| (frame.s[q] - frame.s[hit]).abs() < SAME_SURFACE_PX)
        .find(|&q| frame.links[q] & EDGE == 0);
    match pure {
        Some(q) => frame.color_at(q),
        None if back.s[hit].is_nan() => frame.color_at(hit),
        None => {
            let n = frame.size.pixels();
            std::array::from_fn(|c| if c < frame.size.channels { back.color[c * n + hit] } else { 0.0 })
        }
    }
}

/// One hidden pixel out of what was found around it.
fn merge(index: usize, s_start: f32, hits: &[Hit]) -> Option<Hidden> {
    // The surface that most hits, the nearest ones above all, agree on.
    let votes = |s: f32| -> f32 {
        let same = hits.iter().filter(|h| (h.s - s).abs() < CONNECTED_PX);
        same.map(|h| 1.0 / (h.distance * h.distance)).sum()
    };
    let surface = hits.iter().map(|h| (votes(h.s), h.s)).reduce(|a, b| if b.0 > a.0 { b } else { a })?.1;
    let on_surface = |h: &&Hit| (h.s - surface).abs() < SAME_SURFACE_PX;

    // A highlight that one look happens to meet must not be smeared over the whole hidden region.
    let brightness = |h: &Hit| h.color.iter().sum::<f32>();
    let mut sorted: Vec<f32> = hits.iter().filter(on_surface).map(brightness).collect();
    sorted.sort_by(f32::total_cmp);
    let limit = 4.0 * sorted[sorted.len() / 2].max(f32::MIN_POSITIVE);
    let kept = hits.iter().filter(on_surface).filter(|h| brightness(h) <= limit);

    let (mut weight, mut s, mut color) = (0.0, 0.0, [0.0; 4]);
    for h in kept {
        let w = 1.0 / h.distance;
        weight += w;
        s += w * h.s;
        for (sum, c) in color.iter_mut().zip(h.color) {
            *sum += w * c;
        }
    }
    (weight > 0.0).then(|| Hidden {
        index,
        s: (s / weight).min(s_start - BEHIND_PX),
        color: color.map(|c| c / weight),
    })
}

/// Fills every pixel that a lens can look behind and whose back cell is still unknown.
pub fn hidden(frame: &Frame, front_s: &[f32], back: &Sheet) -> Vec<Hidden> {
    let (width, height) = (frame.size.width, frame.size.height);
    let blocks = Blocks::new(frame);
    let (s_min, s_max) = front_s.par_iter().map(|&s| (s, s)).reduce(
        || (f32::INFINITY, f32::NEG_INFINITY),
        |a, b| (a.0.min(b.0), a.1.max(b.1)),
    );
    let uncovered: Vec<Option<f32>> =
        (0..blocks.edge_s.len()).into_par_iter().map(|b| blocks.farthest_uncovered(b, s_min)).collect();
    let reach = (s_max - s_min + MARGIN_PX).ceil() as usize;
    let rays = rays(reach.min(width.max(height)));

    (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let (rays, uncovered) = (&rays, &uncovered);
            let across = blocks.across;
            (0..width).filter_map(move |x| {
                let index = y * width + x;
                let s_farthest = uncovered[y / BLOCK * across + x / BLOCK]?;
                if !back.s[index].is_nan() || front_s[index] - s_farthest < CONNECTED_PX {
                    return None;
                }
                let mut hits = [Hit { distance: 0.0, s: 0.0, color: [0.0; 4] }; DIRECTIONS];
                let mut found = 0;
                for ray in rays {
                    if let Some(hit) = look(frame, back, (x, y), front_s[index], s_farthest, ray) {
                        hits[found] = hit;
                        found += 1;
                    }
                }
                merge(index, front_s[index], &hits[..found])
            })
        })
        .collect()
}
