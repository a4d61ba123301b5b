//! Culling of taps: bounds on how far light can travel to each block of a tile, so that few taps find nothing.

use super::lanes::{LANES, Lane, lane, reduce};
use crate::plan::hexagonal::{Line, Plan, Tap};
use crate::rows::{greater, lesser};
use crate::simd::Simd;

/// Columns and rows of a block.
pub const BLOCK: (usize, usize) = (32, 8);

/// The range of radii of some circles of confusion. An empty range has a least radius above its greatest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    least: f32,
    most: f32,
}

impl Span {
    const NONE: Span = Span { least: f32::INFINITY, most: 0.0 };

    #[inline(always)]
    fn with(self, other: Span) -> Span {
        Span { least: self.least.min(other.least), most: self.most.max(other.most) }
    }
}

/// The circles of confusion of a block's pixels.
#[derive(Debug, Clone, Copy)]
struct Circles {
    in_front: Span,
    behind: Span,
    /// Least and greatest signed radius of all pixels.
    least: f32,
    most: f32,
}

impl Circles {
    const NONE: Circles =
        Circles { in_front: Span::NONE, behind: Span::NONE, least: f32::INFINITY, most: f32::NEG_INFINITY };

    #[inline(always)]
    fn add(&mut self, coc: &Lane) {
        let none = [Span::NONE.least; LANES];
        let (mut in_front, mut behind) = ((none, [0.0; LANES]), (none, [0.0; LANES]));
        for i in 0..LANES {
            in_front.0[i] = if coc[i] < 0.0 { -coc[i] } else { none[i] };
        }
        for i in 0..LANES {
            in_front.1[i] = if coc[i] < 0.0 { -coc[i] } else { 0.0 };
        }
        for i in 0..LANES {
            behind.0[i] = if coc[i] > 0.0 { coc[i] } else { none[i] };
        }
        for i in 0..LANES {
            behind.1[i] = if coc[i] > 0.0 { coc[i] } else { 0.0 };
        }
        let span = |of: (Lane, Lane)| Span { least: reduce(of.0, lesser), most: reduce(of.1, greater) };
        self.in_front = self.in_front.with(span(in_front));
        self.behind = self.behind.with(span(behind));
        self.least = self.least.min(reduce(*coc, lesser));
        self.most = self.most.max(reduce(*coc, greater));
    }

    /// Whether some pixels are not in front.
    fn is_open(&self) -> bool {
        self.most >= 0.0
    }
}

/// The offset from one block to another.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    dx: i32,
    dy: i32,
    /// Circles of confusion up to this radius do not reach this far.
    from_px: f32,
}

/// The blocks that taps along a line read.
struct BlockPath(Vec<Step>);

impl BlockPath {
    fn new(line: &Line) -> BlockPath {
        let mut steps: Vec<Step> = Vec::new();
        for tap in &line.taps {
            let [across, down] = [(tap.dx, BLOCK.0), (tap.dy, BLOCK.1)].map(|(d, side)| {
                let side = side as i32;
                d.div_euclid(side)..=(d + side - 1).div_euclid(side)
            });
            for (dx, dy) in down.flat_map(|dy| across.clone().map(move |dx| (dx, dy))) {
                // Taps are sorted by distance, so the first tap in a block is the nearest.
                if !steps.iter().any(|step| (step.dx, step.dy) == (dx, dy)) {
                    steps.push(Step { dx, dy, from_px: tap.from_px });
                }
            }
        }
        BlockPath(steps)
    }
}

/// The lines of a plan, as the blocks that their taps read.
pub struct BlockPaths {
    /// For each target: the lines of the first pass and those of the second.
    targets: Vec<[Vec<BlockPath>; 2]>,
}

impl BlockPaths {
    pub fn new(plan: &Plan) -> BlockPaths {
        let of = |lines: &[Line]| lines.iter().map(BlockPath::new).collect();
        BlockPaths { targets: plan.targets.iter().map(|t| [of(&t.gathered), of(&t.spread)]).collect() }
    }
}

/// The taps along a line that need to be evaluated.
#[derive(Clone, Copy)]
pub struct Taps<'a> {
    /// Taps that all circles of confusion reach completely.
    pub all: &'a [Tap],
    /// Taps that only some circles of confusion reach.
    pub some: &'a [Tap],
}

impl<'a> Taps<'a> {
    const NONE: Taps<'static> = Taps { all: &[], some: &[] };

    fn new(line: &'a Line, least_px: f32, most_px: f32) -> Taps<'a> {
        let (all, some) = line.split(least_px, most_px);
        Taps { all, some }
    }
}

/// The taps that the pixels of a block read along a line.
pub struct BlockTaps<'a> {
    /// For light in front.
    pub near: Taps<'a>,
    /// For pixels behind the focus: light from behind the focus.
    pub behind: Taps<'a>,
    /// For pixels in front: the light behind them.
    pub through: Taps<'a>,
}

/// The ranges of radii that can reach each block along one line.
struct LineBounds {
    near: Vec<Span>,
    behind: Vec<Span>,
}

/// Bounds for the blocks of a tile and its surroundings.
#[derive(Default)]
pub struct Reach {
    across: usize,
    blocks: Vec<Circles>,
    /// For each block, whether its pixels in front can find pixels behind themselves that are not in front.
    open: Vec<bool>,
    /// The lines of the first pass and those of the second.
    passes: [Vec<LineBounds>; 2],
}

impl Reach {
    pub fn new(coc: &[f32], stride: usize, paths: &BlockPaths, simd: Simd) -> Reach {
        let (across, down) = (stride.div_ceil(BLOCK.0), (coc.len() / stride).div_ceil(BLOCK.1));
        let mut blocks = vec![Circles::NONE; across * down];
        for (y, row) in coc.chunks(stride).enumerate() {
            for (block, coc) in blocks[y / BLOCK.1 * across..].iter_mut().zip(row.chunks(BLOCK.0)) {
                simd.run(
                    #[inline(always)]
                    || coc.chunks_exact(LANES).for_each(|coc| block.add(lane(coc, 0))),
                );
            }
        }
        let mut reach = Reach { across, blocks, open: Vec::new(), passes: Default::default() };
        if reach.is_none() {
            return reach;
        }
        reach.open = reach.find_open();
        // The first pass passes on the largest circle of confusion of the near light that a target gathers.
        let mut carried: Vec<Span> = vec![Span::NONE; reach.blocks.len()];
        let in_front: Vec<Span> = reach.blocks.iter().map(|block| block.in_front).collect();
        for [gathered, spread] in &paths.targets {
            for path in gathered {
                let near = reach.near(&in_front, path);
                carried.iter_mut().zip(&near).for_each(|(carried, near)| *carried = carried.with(*near));
                let behind = reach.behind(path);
                reach.passes[0].push(LineBounds { near, behind });
            }
            for path in spread {
                let bounds = LineBounds { near: reach.near(&carried, path), behind: reach.behind(path) };
                reach.passes[1].push(bounds);
            }
        }
        reach
    }

    /// Whether every pixel is in focus.
    pub fn is_none(&self) -> bool {
        self.blocks.iter().all(|block| block.in_front.most == 0.0 && block.behind.most == 0.0)
    }

    /// The block at column `x` and row `y`.
    pub fn block(&self, x: usize, y: usize) -> usize {
        y / BLOCK.1 * self.across + x / BLOCK.0
    }

    /// The taps that block `b` reads along a line, which is line `i` of a pass.
    pub fn taps<'a>(&self, pass: usize, i: usize, line: &'a Line, b: usize) -> BlockTaps<'a> {
        let (block, bounds) = (&self.blocks[b], &self.passes[pass][i]);
        let near = Taps::new(line, bounds.near[b].least, bounds.near[b].most);
        let (mut behind, mut through) = (Taps::NONE, Taps::NONE);
        if block.behind.most > 0.0 {
            let around = bounds.behind[b];
            // If all pixels are behind the focus and no circle is too large for any of them, no circle needs to be
            // tested.
            let known = if around.most < 2.0 * block.least { around.least } else { 0.0 };
            behind = Taps::new(line, known, around.most.min(2.0 * block.most));
        }
        if block.in_front.most > 0.0 && self.open[b] {
            through = Taps::new(line, (-block.most).max(0.0), block.in_front.most);
        }
        BlockTaps { near, behind, through }
    }

    /// The blocks that a line reads from block `b`.
    fn steps<'a>(&self, path: &'a BlockPath, b: usize) -> impl Iterator<Item = (usize, f32)> + use<'a> {
        let (across, down) = (self.across as i32, (self.blocks.len() / self.across) as i32);
        let (x, y) = (b as i32 % across, b as i32 / across);
        path.0.iter().filter_map(move |step| {
            let (x, y) = (x + step.dx, y + step.dy);
            let inside = (0..across).contains(&x) && (0..down).contains(&y);
            inside.then_some(((y * across + x) as usize, step.from_px))
        })
    }

    /// The range of radii in front whose light can reach each block.
    fn near(&self, spans: &[Span], path: &BlockPath) -> Vec<Span> {
        let of_block = |b: usize| {
            let reaching = self.steps(path, b).filter(|(at, from_px)| spans[*at].most > *from_px);
            let most = reaching.map(|(at, _)| spans[at].most).fold(0.0, f32::max);
            // Taps extend as far as the largest circle reaches, and meet smaller ones on the way.
            let met = self.steps(path, b).filter(|(_, from_px)| *from_px < most);
            let least = met.map(|(at, _)| spans[at].least).fold(f32::INFINITY, f32::min);
            Span { least, most }
        };
        (0..spans.len()).map(of_block).collect()
    }

    /// The range of radii behind the focus that the pixels of each block can meet. A pixel receives light from
    /// circles up to twice its own radius.
    fn behind(&self, path: &BlockPath) -> Vec<Span> {
        let of_block = |b: usize| {
            let farthest_px = 2.0 * self.blocks[b].behind.most;
            let met = self.steps(path, b).filter(|(_, from_px)| *from_px < farthest_px);
            met.fold(Span::NONE, |all, (at, _)| all.with(self.blocks[at].behind))
        };
        (0..self.blocks.len()).map(of_block).collect()
    }

    /// See [`Reach::open`].
    fn find_open(&self) -> Vec<bool> {
        let (across, down) = (self.across, self.blocks.len() / self.across);
        let largest_px = self.blocks.iter().map(|block| block.in_front.most).fold(0.0, f32::max);
        let is_open = |b: usize| {
            // A pixel in front may find there the background that other pixels in front saw behind themselves.
            let px = self.blocks[b].in_front.most + largest_px;
            let blocks = |side: usize| (px as usize + 1).div_ceil(side);
            let (x, y, rx, ry) = (b % across, b / across, blocks(BLOCK.0), blocks(BLOCK.1));
            let columns = x.saturating_sub(rx)..(x + rx + 1).min(across);
            let mut rows = y.saturating_sub(ry)..(y + ry + 1).min(down);
            rows.any(|y| self.blocks[y * across..][columns.clone()].iter().any(Circles::is_open))
        };
        (0..self.blocks.len()).map(|b| self.blocks[b].in_front.most > 0.0 && is_open(b)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::hexagonal::Settings;

    /// Every tap that finds light is among the evaluated ones, and every tap in `all` is reached by all circles.
    #[test]
    fn no_look_up_is_left_out_that_finds_something() {
        let plan = Plan::new(&Settings::new(None, 64.0).unwrap(), 20.0);
        let (stride, rows) = (192, 96);
        // Patches in front, behind and in focus, in several sizes.
        let patch = |x: usize, y: usize| {
            [-20.0f32, 0.0, 7.0, -9.0, 3.0, 12.0, 0.0, -17.0][(x / 48 + 3 * (y / 40)) % 8]
        };
        let coc: Vec<f32> = (0..rows).flat_map(|y| (0..stride).map(move |x| patch(x, y))).collect();
        let reach = Reach::new(&coc, stride, &BlockPaths::new(&plan), Simd::PORTABLE);
        let lines = plan.targets.iter().flat_map(|target| &target.gathered);
        for (i, line) in lines.enumerate() {
            for (x, y) in (24..72).flat_map(|y| (24..168).map(move |x| (x, y))) {
                let own = coc[y * stride + x];
                let taps = reach.taps(0, i, line, reach.block(x, y));
                for (k, tap) in line.taps.iter().enumerate() {
                    let (x, y) = ((x as i32 + tap.dx) as usize, (y as i32 + tap.dy) as usize);
                    let there = coc[y * stride + x];
                    let check = |taps: Taps, radius: f32, name: &str| {
                        let (asked, made) = (taps.all.len(), taps.all.len() + taps.some.len());
                        assert!(radius <= tap.from_px || k < made, "{name} {x} {y} {k} is left out");
                        let whole = radius >= tap.from_px + tap.step_px;
                        assert!(radius == 0.0 || whole || k >= asked, "{name} {x} {y} {k} is not asked");
                    };
                    check(taps.near, (-there).max(0.0), "near");
                    if own > 0.0 {
                        check(taps.behind, if there < 2.0 * own { there.max(0.0) } else { 0.0 }, "behind");
                    }
                    if own < 0.0 {
                        check(taps.through, -own, "through");
                    }
                }
            }
        }
    }
}
