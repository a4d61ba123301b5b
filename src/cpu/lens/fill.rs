//! What lies hidden behind foreground edges: colour and depth of the surface that the lens sees there and the
//! pinhole did not.

use super::AT_ONCE;
use super::blocks::BLOCK;
use super::surfaces::{self, CONNECTED_PX, EDGE};
use super::unmix::{Frame, Mixed};
use crate::cancel::Cancel;
use crate::error::Result;
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
    /// From one index to the other.
    offset: isize,
    distance: f32,
}

/// Where looks start.
#[derive(Clone, Copy)]
struct From {
    x: usize,
    y: usize,
    index: usize,
    /// Whether no look can leave the frame.
    inside: bool,
}

/// The pixels met in each direction, up to a distance.
fn rays(reach: usize, width: usize) -> Vec<Vec<Step>> {
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
                    let offset = dy as isize * width as isize + dx as isize;
                    Step { dx: dx as i32, dy: dy as i32, offset, distance: dx.hypot(dy) as f32 }
                })
                .collect()
        })
        .collect()
}

/// Least shift at a silhouette, and least and greatest shift of all, of each block of pixels.
struct Blocks {
    across: usize,
    edge_s: Vec<f32>,
    min_s: Vec<f32>,
    max_s: Vec<f32>,
}

impl Blocks {
    fn new(frame: &Frame) -> Blocks {
        let across = frame.size.width.div_ceil(BLOCK);
        let down = frame.size.height.div_ceil(BLOCK);
        let all: Vec<[f32; 3]> = (0..across * down)
            .into_par_iter()
            .map(|b| {
                let (x0, y0) = (b % across * BLOCK, b / across * BLOCK);
                let (mut edge, mut min, mut max) = (f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY);
                for y in y0..(y0 + BLOCK).min(frame.size.height) {
                    let start = y * frame.size.width;
                    let row = start + x0..start + (x0 + BLOCK).min(frame.size.width);
                    for (&s, &links) in frame.s[row.clone()].iter().zip(&frame.links[row]) {
                        let at_edge = if links & EDGE != 0 { s } else { f32::INFINITY };
                        edge = if at_edge < edge { at_edge } else { edge };
                        min = if s < min { s } else { min };
                        max = if s > max { s } else { max };
                    }
                }
                [edge, min, max]
            })
            .collect();
        let column = |i: usize| all.iter().map(|block| block[i]).collect();
        Blocks { across, edge_s: column(0), min_s: column(1), max_s: column(2) }
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
    /// The edge pixels that were taken apart, by rising index.
    mixed: &'a [Mixed],
    /// See [`surfaces::distance_to_edges`].
    edge_distance: &'a [u8],
}

impl Surroundings<'_> {
    /// An edge pixel taken apart.
    fn mixed(&self, index: usize) -> Option<&Mixed> {
        self.mixed.binary_search_by_key(&index, |m| m.index).ok().map(|i| &self.mixed[i])
    }

    /// The pixel that a step leads to, if it is in the frame.
    #[inline(always)]
    fn at(&self, from: From, step: &Step) -> Option<usize> {
        if from.inside {
            Some(from.index.wrapping_add_signed(step.offset))
        } else {
            self.frame.offset(from.x, from.y, step.dx, step.dy)
        }
    }

    /// Follows one direction at shift `s_start` until it leaves the foreground; no farther than a surface at
    /// `s_farthest` could be uncovered.
    fn look(&self, from: From, s_start: f32, s_farthest: f32, ray: &[Step]) -> Option<Hit> {
        let Frame { s, links, .. } = *self.frame;
        let at = |step: &Step| self.at(from, step);
        // Each step moves one pixel, so no edge is met sooner than after the distance to the nearest.
        let mut k = usize::from(self.edge_distance[from.index]).saturating_sub(1);
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
            let previous = k.checked_sub(1).map_or(Some(from.index), |k| at(&ray[k]))?;
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
                        color: self.pure_beyond(from, here, &ray[k..]),
                    };
                    return uncovered.then(hit);
                }
            }
            k += 1;
        }
    }

    /// The colour of the first pixel beyond a silhouette that mixes with nothing, or else the unmixed one there.
    fn pure_beyond(&self, from: From, hit: usize, ray: &[Step]) -> [f32; 4] {
        let Frame { s, links, .. } = *self.frame;
        let beyond = ray.iter().take(BEYOND_EDGE).map_while(|step| self.at(from, step));
        let pure =
            beyond.take_while(|&q| (s[q] - s[hit]).abs() < SAME_SURFACE_PX).find(|&q| links[q] & EDGE == 0);
        match pure {
            Some(q) => self.frame.color_at(q),
            None => self.mixed(hit).map_or_else(|| self.frame.color_at(hit), |mixed| mixed.back),
        }
    }
}

/// The shift that most hits, the nearest ones above all, agree on.
fn surface_of(hits: &[Hit]) -> Option<f32> {
    // Beside those that there are, some that agree with nothing, so that all are asked together.
    let (mut s, mut weight, mut votes) = ([f32::NAN; DIRECTIONS], [0.0; DIRECTIONS], [0.0f32; DIRECTIONS]);
    for (i, h) in hits.iter().enumerate() {
        (s[i], weight[i]) = (h.s, 1.0 / (h.distance * h.distance));
    }
    for (other, weight) in s.iter().zip(weight).take(hits.len()) {
        for (votes, s) in votes.iter_mut().zip(s) {
            *votes += if (other - s).abs() < CONNECTED_PX { weight } else { 0.0 };
        }
    }
    let found = votes.into_iter().zip(s).take(hits.len());
    found.reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, s)| s)
}

/// One hidden pixel out of what was found around it.
fn merge(index: usize, s_start: f32, hits: &[Hit]) -> Option<Hidden> {
    let surface = surface_of(hits)?;
    let on_surface = |h: &&Hit| (h.s - surface).abs() < SAME_SURFACE_PX;

    // A highlight that one look happens to meet must not be smeared over the whole hidden region.
    let brightness = |h: &Hit| h.color.iter().sum::<f32>();
    let (mut all, mut n) = ([0.0; DIRECTIONS], 0);
    for h in hits.iter().filter(on_surface) {
        all[n] = brightness(h);
        n += 1;
    }
    let (_, median, _) = all[..n].select_nth_unstable_by(n / 2, f32::total_cmp);
    let limit = 4.0 * median.max(f32::MIN_POSITIVE);
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

/// Fills every pixel that a lens can look behind and whose background is still unknown.
pub fn hidden(frame: &Frame, mixed: &[Mixed], cancel: &Cancel) -> Result<Vec<Hidden>> {
    let (width, height) = (frame.size.width, frame.size.height);
    let blocks = Blocks::new(frame);
    let s_min = blocks.min_s.iter().copied().fold(f32::INFINITY, f32::min);
    let s_max = blocks.max_s.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let reach = (s_max - s_min + MARGIN_PX).ceil() as usize;
    let reach = reach.min(width.max(height));
    let rays = rays(reach, width);

    let edge_distance = surfaces::distance_to_edges(frame.links, width);
    let around = Surroundings { frame, mixed, edge_distance: &edge_distance };

    let fill_pixel = |index: usize, s_farthest: f32| {
        // What lies behind a mixed pixel is known, unless it turned out to show only that.
        let at_edge = edge_distance[index] == 0;
        let s_front = match if at_edge { around.mixed(index) } else { None } {
            Some(mixed) if mixed.coverage > 0.0 => return None,
            Some(mixed) => mixed.s_back,
            None => frame.s[index],
        };
        let behind = s_front - s_farthest;
        let too_far = f32::from(edge_distance[index]) > behind + MARGIN_PX;
        if behind < CONNECTED_PX || too_far {
            return None;
        }
        let mut hits = [Hit { distance: 0.0, s: 0.0, color: [0.0; 4] }; DIRECTIONS];
        let mut found = 0;
        let (x, y) = (index % width, index / width);
        let from_border = x.min(width - 1 - x).min(y).min(height - 1 - y);
        let from = From { x, y, index, inside: from_border > reach };
        for ray in &rays {
            if let Some(hit) = around.look(from, s_front, s_farthest, ray) {
                hits[found] = hit;
                found += 1;
            }
        }
        merge(index, s_front, &hits[..found])
    };
    let fill_block = |b: usize| {
        cancel.check()?;
        let Some(s_farthest) = blocks.farthest_uncovered(b, s_min) else { return Ok(Vec::new()) };
        let (x0, y0) = (b % blocks.across * BLOCK, b / blocks.across * BLOCK);
        let rows = y0..(y0 + BLOCK).min(height);
        let pixels = rows.flat_map(|y| (x0..(x0 + BLOCK).min(width)).map(move |x| y * width + x));
        Ok(pixels.filter_map(|index| fill_pixel(index, s_farthest)).collect())
    };
    let numbers = (0..blocks.edge_s.len()).into_par_iter().with_max_len(AT_ONCE);
    let filled = numbers.map(fill_block).collect::<Result<Vec<_>>>()?;
    Ok(filled.into_iter().flatten().collect())
}
