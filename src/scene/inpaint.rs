//! Inpainting of disocclusions: colour and depth of the surfaces behind foreground edges, which the lens sees and the
//! pinhole does not.
//!
//! From a hidden pixel, rays march in sixteen directions until they leave the foreground. The surface that most of
//! them reach continues behind it.

use super::edges::{self, CONNECTED_PX, EDGE};
use super::exits::{DIRECTIONS, Exit, Found, SAME_SURFACE_PX, merge};
use super::front_layer::FrontLayer;
use super::grid::BLOCK;
use super::highlights::Limits;
use super::matting::MixedPixel;
use super::recipe::{Cargo, Source};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::rows::ITEMS_PER_TASK;
use rayon::prelude::*;

/// How far beyond a silhouette an unmixed pixel is searched: as far as around an edge pixel.
const BEYOND_EDGE: usize = 4;
/// The least difference in shift between a hidden surface and the surface that hides it: half of what makes an edge.
const BEHIND_PX: f32 = 0.5;
/// A lens sees no farther behind a silhouette than the difference in shift; the margin allows for rounding.
const MARGIN_PX: f32 = 2.0;
/// Over the last pixel of the margin, what rays reach counts less and less, so that none begins to count all at once.
const FADE_PX: f32 = 1.0;
/// Far from edges, rays march from a grid of pixels only. These are its spacings along each axis of a block, the one
/// for the pixels farthest from edges first.
const SPACINGS_PX: [usize; 2] = [4, 2];

/// A hidden pixel that was inpainted.
pub struct Hidden<L = Vec<[f32; 4]>> {
    pub index: usize,
    pub s: f32,
    pub color: [f32; 4],
    /// What is carried along; for channels, its values in each group of them.
    pub carried: L,
}

/// A pixel on a ray.
#[derive(Clone, Copy)]
struct Step {
    dx: i32,
    dy: i32,
    /// Offset from the index of the origin to that of the pixel.
    offset: isize,
    distance: f32,
}

/// The pixel that rays march from.
#[derive(Clone, Copy)]
struct Origin {
    x: usize,
    y: usize,
    index: usize,
    /// Whether every ray stays inside the frame.
    inside: bool,
    /// How much farther than the difference in shift the rays march.
    margin_px: f32,
}

/// The pixels of the ray of each direction, up to a distance.
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

/// For each block of pixels: the least shift at a silhouette, the least shift of all pixels, and the greatest shift
/// behind which is searched.
struct ShiftBounds {
    across: usize,
    edge_s: Vec<f32>,
    min_s: Vec<f32>,
    max_s: Vec<f32>,
}

impl ShiftBounds {
    fn new(frame: &FrontLayer, hiding: &[f32]) -> ShiftBounds {
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
                    let pixels = frame.s[row.clone()].iter().zip(&frame.connectivity[row.clone()]);
                    for ((&s, &connectivity), &hiding) in pixels.zip(&hiding[row]) {
                        let at_edge = if connectivity & EDGE != 0 { s } else { f32::INFINITY };
                        edge = if at_edge < edge { at_edge } else { edge };
                        min = if s < min { s } else { min };
                        max = if hiding > max { hiding } else { max };
                    }
                }
                [edge, min, max]
            })
            .collect();
        let column = |i: usize| all.iter().map(|block| block[i]).collect();
        ShiftBounds { across, edge_s: column(0), min_s: column(1), max_s: column(2) }
    }

    /// The least shift at a silhouette that any pixel of block `b` could uncover, if a silhouette is in reach.
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

/// The visible surfaces, as rays march over them.
struct Surfaces<'a> {
    frame: &'a FrontLayer<'a>,
    /// The edge pixels that were separated, sorted by index.
    mixed: &'a [MixedPixel],
    /// See [`edges::distance_to_edges`].
    edge_distance: &'a [u8],
    limits: &'a Limits,
}

impl Surfaces<'_> {
    /// The number of an edge pixel that was separated, and its two surfaces.
    fn mixed(&self, index: usize) -> Option<(usize, &MixedPixel)> {
        self.mixed.binary_search_by_key(&index, |m| m.index).ok().map(|i| (i, &self.mixed[i]))
    }

    /// The pixel that a step leads to, if it is in the frame.
    #[inline(always)]
    fn at(&self, origin: Origin, step: &Step) -> Option<usize> {
        if origin.inside {
            Some(origin.index.wrapping_add_signed(step.offset))
        } else {
            self.frame.offset(origin.x, origin.y, step.dx, step.dy)
        }
    }

    /// Marches along one direction at shift `s_start` until the ray leaves the foreground, but no farther than the
    /// lens could uncover a surface at `s_farthest`.
    fn march(&self, origin: Origin, s_start: f32, s_farthest: f32, ray: &[Step]) -> Option<Exit> {
        let FrontLayer { s, connectivity, .. } = *self.frame;
        let at = |step: &Step| self.at(origin, step);
        // Each step moves one pixel, so no edge is met before the distance to the nearest edge.
        let mut k = usize::from(self.edge_distance[origin.index]).saturating_sub(1);
        loop {
            let step = ray.get(k)?;
            if step.distance > s_start - s_farthest + origin.margin_px {
                return None;
            }
            let here = at(step)?;
            if connectivity[here] & EDGE == 0 {
                k += usize::from(self.edge_distance[here]).max(1);
                continue;
            }
            let previous = k.checked_sub(1).map_or(Some(origin.index), |k| at(&ray[k]))?;
            let drop = s[previous] - s[here];
            if drop.abs() >= CONNECTED_PX && connectivity[previous] & EDGE != 0 {
                if drop < 0.0 {
                    return None;
                }
                if s[here] <= s_start - CONNECTED_PX {
                    let left_px = s_start - s[here] + origin.margin_px - step.distance;
                    let exit = || {
                        let (mut color, source, index) = self.pure_beyond(origin, here, &ray[k..]);
                        let light = self.limits.going_on(&color, index);
                        color[..self.frame.lights].iter_mut().for_each(|v| *v *= light);
                        let share = (left_px / FADE_PX).min(1.0);
                        Exit { distance: step.distance, s: s[here], color, light, source, share }
                    };
                    return (left_px > 0.0).then(exit);
                }
            }
            k += 1;
        }
    }

    /// The colour of the first unmixed pixel beyond a silhouette, or else the background colour of the exit pixel, and the
    /// index of that pixel.
    fn pure_beyond(&self, origin: Origin, exit: usize, ray: &[Step]) -> ([f32; 4], Source, usize) {
        let FrontLayer { s, connectivity, .. } = *self.frame;
        let beyond = ray.iter().take(BEYOND_EDGE).map_while(|step| self.at(origin, step));
        let pure = beyond
            .take_while(|&q| (s[q] - s[exit]).abs() < SAME_SURFACE_PX)
            .find(|&q| connectivity[q] & EDGE == 0);
        let of_pixel = |q: usize| (self.frame.color_at(q), Source::Pixel(q), q);
        match pure {
            Some(q) => of_pixel(q),
            None => {
                let mixed = self.mixed(exit);
                mixed.map_or_else(|| of_pixel(exit), |(i, mixed)| (mixed.back, Source::Behind(i), exit))
            }
        }
    }
}

/// The search for hidden surfaces.
struct Search<'a, C> {
    around: Surfaces<'a>,
    /// See [`hidden`].
    hiding: &'a [f32],
    cargo: C,
    blocks: ShiftBounds,
    /// See [`ShiftBounds::farthest_uncovered`].
    farthest: Vec<Option<f32>>,
    rays: Vec<Vec<Step>>,
    /// The longest distance that a ray marches.
    reach: usize,
}

/// The result of the search behind a pixel.
#[derive(Clone)]
enum Answer<L> {
    /// The pixel has not been searched.
    Unknown,
    /// The lens sees nothing behind it.
    Nothing,
    Surface(Found<L>),
}

/// The results behind a grid of pixels of a block, from which the pixels in between are interpolated.
struct Grid<L> {
    origin: (usize, usize),
    spacing: usize,
    answers: Vec<Answer<L>>,
}

impl<C: Cargo> Search<'_, C> {
    /// The shift of the surface that hides something at pixel `index`; `None` where the hidden surface is already
    /// known.
    fn front(&self, index: usize) -> Option<f32> {
        let edge_distance = self.around.edge_distance;
        // The surface behind a mixed pixel is known, unless its coverage turned out to be zero.
        let at_edge = edge_distance[index] == 0;
        match if at_edge { self.around.mixed(index) } else { None } {
            Some((_, mixed)) if mixed.coverage > 0.0 => None,
            Some((_, mixed)) => Some(mixed.s_back),
            None => Some(self.hiding[index]),
        }
    }

    /// Searches behind a pixel in all directions, `margin_px` farther than the lens sees.
    fn find(
        &self,
        (x, y): (usize, usize),
        s_front: f32,
        s_farthest: f32,
        margin_px: f32,
    ) -> Option<Found<C::Load>> {
        let Surfaces { frame, edge_distance, .. } = self.around;
        let index = y * frame.size.width + x;
        let behind = s_front - s_farthest;
        if behind < CONNECTED_PX || f32::from(edge_distance[index]) > behind + margin_px {
            return None;
        }
        let from_border = x.min(frame.size.width - 1 - x).min(y).min(frame.size.height - 1 - y);
        let origin = Origin { x, y, index, inside: from_border > self.reach, margin_px };
        let none = Exit {
            distance: 0.0,
            s: 0.0,
            color: [0.0; 4],
            light: 1.0,
            source: Source::Pixel(index),
            share: 1.0,
        };
        let mut exits = [none; DIRECTIONS];
        let mut found = 0;
        for ray in &self.rays {
            if let Some(exit) = self.around.march(origin, s_front, s_farthest, ray) {
                exits[found] = exit;
                found += 1;
            }
        }
        merge(&exits[..found], frame.lights, &self.cargo)
    }

    /// Searches behind the pixels of a block's grid, where a coarser grid gives no answer.
    ///
    /// The farther away the edges are, the farther apart rays in neighbouring directions leave the foreground. The
    /// hidden surface is known no more finely than that. So only pixels that are nearer to an edge than some distance
    /// need more than the grid.
    fn grid(&self, origin: (usize, usize), spacing: usize, coarser: Option<&Grid<C::Load>>) -> Grid<C::Load> {
        let size = self.around.frame.size;
        let least_px = (spacing * DIRECTIONS) as f32 / std::f32::consts::TAU;
        let answer = |(x, y): (usize, usize)| {
            if x >= size.width || y >= size.height {
                return Answer::Unknown;
            }
            let (index, block) = (y * size.width + x, y / BLOCK * self.blocks.across + x / BLOCK);
            if f32::from(self.around.edge_distance[index]) < least_px {
                return Answer::Unknown;
            }
            match (coarser.map_or(Answer::Unknown, |grid| grid.at((x, y), &self.cargo)), self.farthest[block])
            {
                (Answer::Unknown, None) => Answer::Nothing,
                (Answer::Unknown, Some(s_farthest)) => {
                    // The margin is wider by the spacing, so that pixels between grid points that see nothing see
                    // nothing either.
                    let margin_px = MARGIN_PX + spacing as f32;
                    let found = self.find((x, y), self.hiding[index], s_farthest, margin_px);
                    found.map_or(Answer::Nothing, Answer::Surface)
                }
                (known, _) => known,
            }
        };
        // Neighbouring blocks share the grid points on their common border.
        let along = |first: usize| (first..=first + BLOCK).step_by(spacing);
        let answers = along(origin.1).flat_map(|y| along(origin.0).map(move |x| (x, y))).map(answer);
        Grid { origin, spacing, answers: answers.collect() }
    }
}

impl<L: Clone> Grid<L> {
    /// The result for a pixel, interpolated between the four grid points around it if they agree.
    fn at<C: Cargo<Load = L>>(&self, (x, y): (usize, usize), cargo: &C) -> Answer<L> {
        let (x, y, across) = (x - self.origin.0, y - self.origin.1, BLOCK / self.spacing + 1);
        let first = y / self.spacing * across + x / self.spacing;
        let [right, below] = [x, y].map(|v| (v % self.spacing) as f32 / self.spacing as f32);
        let corners = [
            (first, (1.0 - right) * (1.0 - below)),
            (first + 1, right * (1.0 - below)),
            (first + across, (1.0 - right) * below),
            (first + across + 1, right * below),
        ];
        let corners = corners.into_iter().filter(|(_, weight)| *weight > 0.0);
        let mut corners = corners.map(|(corner, weight)| (&self.answers[corner], weight));
        match &self.answers[first] {
            Answer::Unknown => Answer::Unknown,
            Answer::Nothing => {
                let all = corners.all(|(answer, _)| matches!(answer, Answer::Nothing));
                if all { Answer::Nothing } else { Answer::Unknown }
            }
            Answer::Surface(one) => {
                let mut mean = Found { s: 0.0, color: [0.0; 4], carried: cargo.nothing() };
                for (answer, weight) in corners {
                    let Answer::Surface(found) = answer else { return Answer::Unknown };
                    if (found.s - one.s).abs() >= SAME_SURFACE_PX {
                        return Answer::Unknown;
                    }
                    mean.s += weight * found.s;
                    for c in 0..4 {
                        mean.color[c] += weight * found.color[c];
                    }
                    C::add_load(&mut mean.carried, weight, &found.carried);
                }
                Answer::Surface(mean)
            }
        }
    }
}

/// Fills every pixel behind which the lens sees something and whose background is still unknown. `hiding` is the shift
/// of the surface behind which each pixel is filled: the visible one, or the last one that is known.
pub fn hidden<C: Cargo>(
    frame: &FrontLayer,
    hiding: &[f32],
    mixed: &[MixedPixel],
    limits: &Limits,
    cargo: C,
    cancel: &Cancel,
) -> Result<Vec<Hidden<C::Load>>> {
    let (width, height) = (frame.size.width, frame.size.height);
    let blocks = ShiftBounds::new(frame, hiding);
    let s_min = blocks.min_s.iter().copied().fold(f32::INFINITY, f32::min);
    let s_max = blocks.max_s.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    // Behind the last exit they look on, along diagonals in longer steps.
    let beyond_px = BEYOND_EDGE as f32 * std::f32::consts::SQRT_2;
    let reach = (s_max - s_min + MARGIN_PX + beyond_px).ceil() as usize;
    let reach = reach.min(width.max(height));
    let rays = rays(reach, width);

    let edge_distance = edges::distance_to_edges(frame.connectivity, width);
    let around = Surfaces { frame, mixed, edge_distance: &edge_distance, limits };

    let farthest: Vec<_> = (0..blocks.edge_s.len())
        .into_par_iter()
        .with_max_len(ITEMS_PER_TASK)
        .map(|b| blocks.farthest_uncovered(b, s_min))
        .collect();
    let across = blocks.across;
    let search = Search { around, hiding, cargo, blocks, farthest, rays, reach };
    let fill_block = |b: usize| {
        cancel.check()?;
        let mut filled = Vec::new();
        let Some(s_farthest) = search.farthest[b] else { return Ok(filled) };
        let (x0, y0) = (b % across * BLOCK, b / across * BLOCK);
        let [coarse, fine] = SPACINGS_PX;
        let grid = search.grid((x0, y0), coarse, None);
        let grid = search.grid((x0, y0), fine, Some(&grid));
        for y in y0..(y0 + BLOCK).min(height) {
            for x in x0..(x0 + BLOCK).min(width) {
                let index = y * width + x;
                let Some(s_front) = search.front(index) else { continue };
                let found = match grid.at((x, y), &search.cargo) {
                    Answer::Unknown => search.find((x, y), s_front, s_farthest, MARGIN_PX),
                    Answer::Nothing => None,
                    Answer::Surface(found) => Some(found),
                };
                if let Some(Found { s, color, carried }) = found {
                    filled.push(Hidden { index, s: s.min(s_front - BEHIND_PX), color, carried });
                }
            }
        }
        Ok(filled)
    };
    let numbers = (0..search.farthest.len()).into_par_iter().with_max_len(ITEMS_PER_TASK);
    let filled = numbers.map(fill_block).collect::<Result<Vec<_>>>()?;
    let mut all = Vec::with_capacity(filled.iter().map(Vec::len).sum());
    filled.into_iter().for_each(|of_block| all.extend(of_block));
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::super::colors::Colors;
    use super::super::recipe::Channels;
    use super::*;
    use crate::picture::Size;
    use crate::simd::Simd;
    use std::sync::Arc;

    const SIDE: usize = BLOCK / SPACINGS_PX[0] + 1;

    const NOTHING: Channels = Channels { groups: &[], mixed: &[] };

    type Load = Vec<[f32; 4]>;

    fn grid(answer: impl Fn(usize, usize) -> Answer<Load>) -> Grid<Load> {
        let places = (0..SIDE * SIDE).map(|i| (i % SIDE, i / SIDE));
        Grid {
            origin: (32, 16),
            spacing: SPACINGS_PX[0],
            answers: places.map(|(x, y)| answer(x, y)).collect(),
        }
    }

    fn surface(s: f32, gray: f32) -> Answer<Load> {
        Answer::Surface(Found { s, color: [gray; 4], carried: Vec::new() })
    }

    #[test]
    fn a_grid_tells_what_lies_between_its_pixels() {
        let plane = |x: f32, y: f32| (0.2 * x - 0.1 * y, 3.0 * x + y);
        let grid = grid(|x, y| {
            let (s, gray) = plane((4 * x) as f32, (4 * y) as f32);
            surface(s, gray)
        });
        for (x, y) in (0..BLOCK * BLOCK).map(|i| (i % BLOCK, i / BLOCK)) {
            let Answer::Surface(found) = grid.at((32 + x, 16 + y), &NOTHING) else {
                panic!("({x}, {y}) is unknown")
            };
            let (s, gray) = plane(x as f32, y as f32);
            assert!((found.s - s).abs() < 1e-4 && (found.color[0] - gray).abs() < 1e-4, "({x}, {y})");
        }
    }

    #[test]
    fn a_grid_tells_only_what_all_of_its_pixels_around_agree_on() {
        let known = |grid: &Grid<Load>, at: (usize, usize)| !matches!(grid.at(at, &NOTHING), Answer::Unknown);
        // In the second row and column, one grid point differs from the others.
        for other in [Answer::Unknown, Answer::Nothing, surface(5.0, 1.0)] {
            let grid = grid(|x, y| if (x, y) == (1, 1) { other.clone() } else { surface(0.0, 1.0) });
            assert!([(33, 17), (37, 21), (33, 21)].iter().all(|at| !known(&grid, *at)));
            assert!([(32, 16), (36, 16), (33, 16), (41, 17)].iter().all(|at| known(&grid, *at)));
        }
        let nothing = grid(|x, _| if x < 2 { Answer::Nothing } else { surface(0.0, 1.0) });
        assert!(matches!(nothing.at((35, 18), &NOTHING), Answer::Nothing));
        assert!(matches!(nothing.at((37, 18), &NOTHING), Answer::Unknown));
    }

    #[test]
    fn what_a_square_hides_is_filled_without_steps() {
        // The blur is so large that the lens sees the whole hidden region.
        let (side, first, end, s_front) = (256, 64, 192, 200.0f32);
        let is_front = |i: usize| (first..end).contains(&(i % side)) && (first..end).contains(&(i / side));
        let s: Vec<f32> = (0..side * side).map(|i| if is_front(i) { s_front } else { 0.0 }).collect();
        let color: Vec<f32> =
            (0..side * side).map(|i| if is_front(i) { 1000.0 } else { (i % side) as f32 }).collect();
        let connectivity = edges::connectivity(&s, side, side);
        let size = Size { width: side, height: side, channels: 1 };
        let frame = FrontLayer::new(size, 1, &color, &s, &connectivity);
        let colors = Colors::new(size, Arc::new(color.iter().copied().collect()));
        let limits = Limits::new(size, &colors, Simd::PORTABLE);
        let hidden = hidden(&frame, &s, &[], &limits, NOTHING, &Cancel::default()).unwrap();
        let mut found = vec![None; side * side];
        hidden.iter().for_each(|h| found[h.index] = Some((h.s, h.color[0])));
        for i in (0..side * side).filter(|i| is_front(*i)) {
            let (x, y) = (i % side, i / side);
            let (s, gray) = found[i].expect("all of it can be seen");
            assert!(
                s == 0.0 && (first as f32 - 2.0..end as f32 + 2.0).contains(&gray),
                "({x}, {y}): {s} {gray}"
            );
            let to_edge = (x - first).min(end - 1 - x).min(y - first).min(end - 1 - y);
            if to_edge >= 12 {
                let (_, next) = found[i + 1].expect("all of it can be seen");
                assert!((next - gray).abs() < 2.0, "({x}, {y}): {gray} then {next}");
            }
        }
    }
}
