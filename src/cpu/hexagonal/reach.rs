//! From how far light may come to each block of a tile, so that few look-ups are made that find nothing.

use super::lanes::{LANES, Lane, lane, reduce};
use crate::plan::hexagonal::{Line, Plan, Tap};
use crate::rows::{greater, lesser};
use crate::simd::Simd;

/// Columns and rows of a block.
pub const BLOCK: (usize, usize) = (32, 8);

/// The radii of some circles of confusion; of none, the least is the greater.
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
    /// Least and greatest of all, with their sign.
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

    /// Whether some are not in front.
    fn is_open(&self) -> bool {
        self.most >= 0.0
    }
}

/// A block, from another one.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    dx: i32,
    dy: i32,
    /// Circles of confusion of no more than this radius do not come from there.
    from_px: f32,
}

/// The blocks that look-ups along a line go to.
struct Course(Vec<Step>);

impl Course {
    fn new(line: &Line) -> Course {
        let mut steps: Vec<Step> = Vec::new();
        for tap in &line.taps {
            let [across, down] = [(tap.dx, BLOCK.0), (tap.dy, BLOCK.1)].map(|(d, side)| {
                let side = side as i32;
                d.div_euclid(side)..=(d + side - 1).div_euclid(side)
            });
            for (dx, dy) in down.flat_map(|dy| across.clone().map(move |dx| (dx, dy))) {
                // Taps come by their distance: the first to get there is the nearest.
                if !steps.iter().any(|step| (step.dx, step.dy) == (dx, dy)) {
                    steps.push(Step { dx, dy, from_px: tap.from_px });
                }
            }
        }
        Course(steps)
    }
}

/// The lines of a plan.
pub struct Courses {
    /// Of each target: those of the first pass, and those of the second.
    targets: Vec<[Vec<Course>; 2]>,
}

impl Courses {
    pub fn new(plan: &Plan) -> Courses {
        let of = |lines: &[Line]| lines.iter().map(Course::new).collect();
        Courses { targets: plan.targets.iter().map(|t| [of(&t.gathered), of(&t.spread)]).collect() }
    }
}

/// Look-ups along a line.
#[derive(Clone, Copy)]
pub struct Taps<'a> {
    /// Those that all circles of confusion get past.
    pub all: &'a [Tap],
    /// Those that only some of them reach.
    pub some: &'a [Tap],
}

impl<'a> Taps<'a> {
    const NONE: Taps<'static> = Taps { all: &[], some: &[] };

    fn new(line: &'a Line, least_px: f32, most_px: f32) -> Taps<'a> {
        let (all, some) = line.split(least_px, most_px);
        Taps { all, some }
    }
}

/// What the pixels of a block look up along a line.
pub struct Looks<'a> {
    /// Light in front.
    pub near: Taps<'a>,
    /// Of pixels behind the focus: light from behind it.
    pub behind: Taps<'a>,
    /// Of pixels in front: what is behind them.
    pub through: Taps<'a>,
}

/// What may come to each block along one line.
struct Along {
    near: Vec<Span>,
    behind: Vec<Span>,
}

/// What may come to the blocks of a tile and its surroundings.
#[derive(Default)]
pub struct Reach {
    across: usize,
    own: Vec<Circles>,
    /// For each block whether pixels in front, looking behind themselves, may find any that are not.
    open: Vec<bool>,
    /// The lines of the first pass, and those of the second.
    passes: [Vec<Along>; 2],
}

impl Reach {
    pub fn new(coc: &[f32], stride: usize, courses: &Courses, simd: Simd) -> Reach {
        let (across, down) = (stride.div_ceil(BLOCK.0), (coc.len() / stride).div_ceil(BLOCK.1));
        let mut own = vec![Circles::NONE; across * down];
        for (y, row) in coc.chunks(stride).enumerate() {
            for (own, coc) in own[y / BLOCK.1 * across..].iter_mut().zip(row.chunks(BLOCK.0)) {
                simd.run(
                    #[inline(always)]
                    || coc.chunks_exact(LANES).for_each(|coc| own.add(lane(coc, 0))),
                );
            }
        }
        let mut reach = Reach { across, own, open: Vec::new(), passes: Default::default() };
        if reach.is_none() {
            return reach;
        }
        reach.open = reach.find_open();
        // The largest circle of confusion of the near light that a target of the first pass gathers is handed on.
        let mut carried: Vec<Span> = vec![Span::NONE; reach.own.len()];
        let in_front: Vec<Span> = reach.own.iter().map(|own| own.in_front).collect();
        for [gathered, spread] in &courses.targets {
            for course in gathered {
                let near = reach.near(&in_front, course);
                carried.iter_mut().zip(&near).for_each(|(carried, near)| *carried = carried.with(*near));
                let behind = reach.behind(course);
                reach.passes[0].push(Along { near, behind });
            }
            for course in spread {
                let along = Along { near: reach.near(&carried, course), behind: reach.behind(course) };
                reach.passes[1].push(along);
            }
        }
        reach
    }

    /// Whether there is nothing but what is in focus.
    pub fn is_none(&self) -> bool {
        self.own.iter().all(|own| own.in_front.most == 0.0 && own.behind.most == 0.0)
    }

    /// The block of column `x` and row `y`.
    pub fn block(&self, x: usize, y: usize) -> usize {
        y / BLOCK.1 * self.across + x / BLOCK.0
    }

    /// What block `b` looks up along a line, which is number `i` of a pass.
    pub fn looks<'a>(&self, pass: usize, i: usize, line: &'a Line, b: usize) -> Looks<'a> {
        let (own, along) = (&self.own[b], &self.passes[pass][i]);
        let near = Taps::new(line, along.near[b].least, along.near[b].most);
        let (mut behind, mut through) = (Taps::NONE, Taps::NONE);
        if own.behind.most > 0.0 {
            let around = along.behind[b];
            // Where all pixels are behind the focus and no circle is too large for any, none need be asked.
            let known = if around.most < 2.0 * own.least { around.least } else { 0.0 };
            behind = Taps::new(line, known, around.most.min(2.0 * own.most));
        }
        if own.in_front.most > 0.0 && self.open[b] {
            through = Taps::new(line, (-own.most).max(0.0), own.in_front.most);
        }
        Looks { near, behind, through }
    }

    /// The blocks that a line goes to from block `b`.
    fn steps<'a>(&self, course: &'a Course, b: usize) -> impl Iterator<Item = (usize, f32)> + use<'a> {
        let (across, down) = (self.across as i32, (self.own.len() / self.across) as i32);
        let (x, y) = (b as i32 % across, b as i32 / across);
        course.0.iter().filter_map(move |step| {
            let (x, y) = (x + step.dx, y + step.dy);
            let inside = (0..across).contains(&x) && (0..down).contains(&y);
            inside.then_some(((y * across + x) as usize, step.from_px))
        })
    }

    /// The circles of confusion in front whose light may come to each block.
    fn near(&self, spans: &[Span], course: &Course) -> Vec<Span> {
        let of_block = |b: usize| {
            let reaching = self.steps(course, b).filter(|(at, from_px)| spans[*at].most > *from_px);
            let most = reaching.map(|(at, _)| spans[at].most).fold(0.0, f32::max);
            // Look-ups go as far as the largest gets, and meet smaller ones on the way.
            let met = self.steps(course, b).filter(|(_, from_px)| *from_px < most);
            let least = met.map(|(at, _)| spans[at].least).fold(f32::INFINITY, f32::min);
            Span { least, most }
        };
        (0..spans.len()).map(of_block).collect()
    }

    /// The circles of confusion behind the focus that pixels of each block meet: light comes from no more than twice
    /// a pixel's own.
    fn behind(&self, course: &Course) -> Vec<Span> {
        let of_block = |b: usize| {
            let farthest_px = 2.0 * self.own[b].behind.most;
            let met = self.steps(course, b).filter(|(_, from_px)| *from_px < farthest_px);
            met.fold(Span::NONE, |all, (at, _)| all.with(self.own[at].behind))
        };
        (0..self.own.len()).map(of_block).collect()
    }

    /// See [`Reach::open`].
    fn find_open(&self) -> Vec<bool> {
        let (across, down) = (self.across, self.own.len() / self.across);
        let largest_px = self.own.iter().map(|own| own.in_front.most).fold(0.0, f32::max);
        let is_open = |b: usize| {
            // It finds there what others in front have seen behind themselves.
            let px = self.own[b].in_front.most + largest_px;
            let blocks = |side: usize| (px as usize + 1).div_ceil(side);
            let (x, y, rx, ry) = (b % across, b / across, blocks(BLOCK.0), blocks(BLOCK.1));
            let columns = x.saturating_sub(rx)..(x + rx + 1).min(across);
            let mut rows = y.saturating_sub(ry)..(y + ry + 1).min(down);
            rows.any(|y| self.own[y * across..][columns.clone()].iter().any(Circles::is_open))
        };
        (0..self.own.len()).map(|b| self.own[b].in_front.most > 0.0 && is_open(b)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::hexagonal::Settings;

    /// Every look-up that finds something is among those that are made, and all of those that are not asked find all.
    #[test]
    fn no_look_up_is_left_out_that_finds_something() {
        let plan = Plan::new(&Settings::new(None, 64.0).unwrap(), 20.0);
        let (stride, rows) = (192, 96);
        // Patches in front, behind and in focus, of several sizes.
        let patch = |x: usize, y: usize| {
            [-20.0f32, 0.0, 7.0, -9.0, 3.0, 12.0, 0.0, -17.0][(x / 48 + 3 * (y / 40)) % 8]
        };
        let coc: Vec<f32> = (0..rows).flat_map(|y| (0..stride).map(move |x| patch(x, y))).collect();
        let reach = Reach::new(&coc, stride, &Courses::new(&plan), Simd::PORTABLE);
        let lines = plan.targets.iter().flat_map(|target| &target.gathered);
        for (i, line) in lines.enumerate() {
            for (x, y) in (24..72).flat_map(|y| (24..168).map(move |x| (x, y))) {
                let own = coc[y * stride + x];
                let looks = reach.looks(0, i, line, reach.block(x, y));
                for (k, tap) in line.taps.iter().enumerate() {
                    let (x, y) = ((x as i32 + tap.dx) as usize, (y as i32 + tap.dy) as usize);
                    let there = coc[y * stride + x];
                    let check = |taps: Taps, radius: f32, name: &str| {
                        let (asked, made) = (taps.all.len(), taps.all.len() + taps.some.len());
                        assert!(radius <= tap.from_px || k < made, "{name} {x} {y} {k} is left out");
                        let whole = radius >= tap.from_px + tap.step_px;
                        assert!(radius == 0.0 || whole || k >= asked, "{name} {x} {y} {k} is not asked");
                    };
                    check(looks.near, (-there).max(0.0), "near");
                    if own > 0.0 {
                        check(looks.behind, if there < 2.0 * own { there.max(0.0) } else { 0.0 }, "behind");
                    }
                    if own < 0.0 {
                        check(looks.through, -own, "through");
                    }
                }
            }
        }
    }
}
