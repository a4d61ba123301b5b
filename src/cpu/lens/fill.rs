//! What lies hidden behind foreground edges: colour and depth of the surface that the lens sees there and the
//! pinhole did not.

use super::sheets::Sheet;
use super::surfaces::{self, CONNECTED_PX, EDGE};
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

/// A pixel on the way in one direction.
#[derive(Clone, Copy)]
struct Step {
    dx: i32,
    dy: i32,
    distance: f32,
}

/// The pixels met in each direction, up to a distance.
fn rays(reach: usize) -> Vec<Vec<Step>> {
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
                    let (dx, dy) = ((along * x).round(), (along * y).round());
                    Step { dx: dx as i32, dy: dy as i32, distance: dx.hypot(dy) as f32 }
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

/// What a look needs to know of the frame.
struct Surroundings<'a> {
    frame: &'a Frame<'a>,
    /// The unmixed cells behind edges.
    back: &'a Sheet,
    /// See [`surfaces::distance_to_edges`].
    edge_distance: &'a [u8],
}

impl Surroundings<'_> {
    /// Follows one direction from pixel `(x, y)`, at shift `s_start`, until it leaves the foreground; no farther
    /// than a surface at `s_farthest` could be uncovered.
    fn look(&self, (x, y): (usize, usize), s_start: f32, s_farthest: f32, ray: &[Step]) -> Option<Hit> {
        let Frame { s, links, .. } = *self.frame;
        let at = |step: &Step| self.frame.offset(x, y, step.dx, step.dy);
        // Each step moves one pixel, so no edge is met sooner than after the distance to the nearest.
        let mut k = usize::from(self.edge_distance[y * self.frame.size.width + x]).saturating_sub(1);
        loop {
            let step = ray.get(k)?;
            if step.distance > s_start - s_farthest + MARGIN_PX {
                return None;
            }
            let here = at(step)?;
            if links[here] & EDGE == 0 {
                k += usize::from(self.edge_distance[here]).max(1);
                continue;
            }
            let previous = k.checked_sub(1).map_or(Some(y * self.frame.size.width + x), |k| at(&ray[k]))?;
            let drop = s[previous] - s[here];
            if drop.abs() >= CONNECTED_PX && links[previous] & EDGE != 0 {
                if drop < 0.0 {
                    return None;
                }
                if s[here] <= s_start - CONNECTED_PX {
                    let uncovered = step.distance <= s_start - s[here] + MARGIN_PX;
                    let hit = || Hit {
                        distance: step.distance,
                        s: s[here],
                        color: self.pure_beyond((x, y), here, &ray[k..]),
                    };
                    return uncovered.then(hit);
                }
            }
            k += 1;
        }
    }

    /// The colour of the first pixel beyond a silhouette that mixes with nothing, or else the unmixed one there.
    fn pure_beyond(&self, (x, y): (usize, usize), hit: usize, ray: &[Step]) -> [f32; 4] {
        let Frame { size, s, links, .. } = *self.frame;
        let beyond = ray.iter().take(BEYOND_EDGE).map_while(|step| self.frame.offset(x, y, step.dx, step.dy));
        let pure =
            beyond.take_while(|&q| (s[q] - s[hit]).abs() < SAME_SURFACE_PX).find(|&q| links[q] & EDGE == 0);
        match pure {
            Some(q) => self.frame.color_at(q),
            None if self.back.s[hit].is_nan() => self.frame.color_at(hit),
            None => {
                let at = |c: usize| self.back.color[c * size.pixels() + hit];
                std::array::from_fn(|c| if c < size.channels { at(c) } else { 0.0 })
            }
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
    let (s_min, s_max) = front_s
        .par_iter()
        .map(|&s| (s, s))
        .reduce(|| (f32::INFINITY, f32::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let uncovered: Vec<Option<f32>> =
        (0..blocks.edge_s.len()).into_par_iter().map(|b| blocks.farthest_uncovered(b, s_min)).collect();
    let reach = (s_max - s_min + MARGIN_PX).ceil() as usize;
    let rays = rays(reach.min(width.max(height)));

    let edge_distance = surfaces::distance_to_edges(frame.links, width);
    let around = Surroundings { frame, back, edge_distance: &edge_distance };

    let fill_pixel = |x: usize, y: usize| {
        let index = y * width + x;
        let s_farthest = uncovered[y / BLOCK * blocks.across + x / BLOCK]?;
        let behind = front_s[index] - s_farthest;
        let too_far = f32::from(edge_distance[index]) > behind + MARGIN_PX;
        if !back.s[index].is_nan() || behind < CONNECTED_PX || too_far {
            return None;
        }
        let mut hits = [Hit { distance: 0.0, s: 0.0, color: [0.0; 4] }; DIRECTIONS];
        let mut found = 0;
        for ray in &rays {
            if let Some(hit) = around.look((x, y), front_s[index], s_farthest, ray) {
                hits[found] = hit;
                found += 1;
            }
        }
        merge(index, front_s[index], &hits[..found])
    };
    let rows = (0..height).into_par_iter();
    rows.flat_map_iter(|y| (0..width).filter_map(|x| fill_pixel(x, y)).collect::<Vec<_>>()).collect()
}
