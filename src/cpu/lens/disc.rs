//! Tiles that show one closed surface of nearly constant depth: the exact, area-weighted opening by running sums.

use super::tile_color::TileColor;
use crate::aperture::Kernel;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::mirror::mirrored;
use crate::picture::Size;
use crate::plan::lens::disc::{APART, Surface, beside, extent, position, position_slope, share, share_slope};
use crate::plan::lens::kernels::Kernels;
use crate::rows::with_channels;
use crate::scene::colors::Colors;
use crate::scene::grid::TILE;
use crate::simd::Simd;
use std::ops::RangeInclusive;

/// Number of pixels that are convolved together.
const LANES: usize = 16;
/// Rows of a tile of one depth that are convolved together; the rows of a whole tile are a multiple of this.
const ROWS: usize = 2;

/// The surroundings of a tile as rows of running sums, with mirrored borders.
///
/// In `f32`, a run that ends far along a row keeps the colour of its pixels to a hundred-thousandth, as long as no
/// pixel outshines the rest; a disc averages over many runs.
#[derive(Default)]
pub struct RunningSums {
    reach: usize,
    across: usize,
    down: usize,
    /// The columns and the rows after which mirror images repeat, if discs are so large that they meet the same again.
    periods: [Option<usize>; 2],
    /// Colour planes, and [`LANES`] more values so that whole groups can be read.
    color: Vec<f32>,
    /// Running sums along each row of each plane: one more value than there are columns, and [`LANES`] more at the
    /// end.
    sums: Vec<f32>,
    /// One row of the frame, all channels.
    row: Vec<f32>,
}

/// The group of values that starts at `at`.
#[inline(always)]
fn group(values: &[f32], at: usize) -> &[f32; LANES] {
    values[at..].first_chunk().expect("planes are longer by a group")
}

impl RunningSums {
    /// Reads the surroundings of the tile at `origin`: as far as discs reach, or until mirror images repeat.
    fn fill(&mut self, size: Size, colors: &Colors, origin: (usize, usize), reach: usize) {
        self.periods = [size.width, size.height].map(|n| (reach > n).then_some(2 * n));
        let [across, down] = [0, 1].map(|i| [TILE.0, TILE.1][i] + self.periods[i].unwrap_or(2 * reach));
        (self.reach, self.across, self.down) = (reach, across, down);
        self.color.resize(size.channels * across * down + LANES, 0.0);
        self.sums.resize(size.channels * (across + 1) * down + LANES, 0.0);
        let from = |start: usize, n: usize, extent: usize| -> Vec<usize> {
            (0..n).map(|i| mirrored((start + i) as i64 - reach as i64, extent).0).collect()
        };
        let (columns, rows) = (from(origin.0, across, size.width), from(origin.1, down, size.height));
        let (first, last) = columns.iter().fold((usize::MAX, 0), |(lo, hi), &x| (lo.min(x), hi.max(x)));
        let n = last + 1 - first;
        self.row.resize(n * size.channels, 0.0);
        for (j, &y) in rows.iter().enumerate() {
            if n == across {
                // No column is mirrored.
                colors.copy_row(y, first..last + 1, across * down, &mut self.color[j * across..]);
                continue;
            }
            colors.copy_row(y, first..last + 1, n, &mut self.row);
            for (c, row) in self.row.chunks_exact(n).enumerate() {
                let color = &mut self.color[(c * down + j) * across..][..across];
                color.iter_mut().zip(&columns).for_each(|(v, &x)| *v = row[x - first]);
            }
        }
        with_channels!(size.channels, C => self.sum_up::<C>());
    }

    /// Computes the running sums of all rows. The channels are interleaved, as each sum waits for its predecessor.
    fn sum_up<const C: usize>(&mut self) {
        let (across, down) = (self.across, self.down);
        let mut sums = self.sums.chunks_exact_mut((across + 1) * down);
        let mut sums: [_; C] = std::array::from_fn(|_| sums.next().expect("a plane for each channel"));
        for j in 0..down {
            let color: [&[f32]; C] =
                std::array::from_fn(|c| &self.color[(c * down + j) * across..][..across]);
            let sums = sums.each_mut().map(|plane| &mut plane[j * (across + 1)..][..across + 1]);
            let mut sum = [0.0f32; C];
            for x in 0..across {
                for c in 0..C {
                    sums[c][x] = sum[c];
                    sum[c] += color[c][x];
                }
            }
            for c in 0..C {
                sums[c][across] = sum[c];
            }
        }
    }

    /// A kernel as indices into these sums and colours.
    fn disc(&self, kernel: &Kernel) -> Disc {
        // The column or row of an offset, and how many periods before it.
        let place = |axis: usize, d: i32| {
            let place = self.reach.wrapping_add_signed(d as isize);
            self.periods[axis].map_or((place, 0), |period| (place % period, place / period))
        };
        let at = |dx: i32, dy: i32, across: usize| place(1, dy).0 * across + place(0, dx).0;
        let rows = || kernel.rows.iter();
        let runs = || rows().filter(|row| row.run.0 < row.run.1);
        let whole = self.periods[0].into_iter().flat_map(|period| {
            runs().map(move |row| {
                let [first, end] = [row.run.0, row.run.1].map(|dx| place(0, dx).1);
                (place(1, row.dy).0 * (self.across + 1) + period, (end - first) as f32)
            })
        });
        let edges = rows().flat_map(|row| row.partial.iter().map(|&(dx, weight)| (dx, row.dy, weight)));
        let edges = edges.map(|(dx, dy, weight)| (at(dx, dy, self.across), weight));
        Disc {
            run_weight: kernel.run_weight,
            runs: runs()
                .map(|row| [row.run.0, row.run.1].map(|dx| at(dx, row.dy, self.across + 1)))
                .collect(),
            whole: whole.collect(),
            edges: edges.collect(),
        }
    }

    /// Convolves pixels `x .. x + LANES` of the `R` tile rows from `y` on with one disc.
    ///
    /// Several rows are processed together, since each sum waits for its predecessor.
    #[inline(always)]
    fn convolve<const R: usize>(&self, disc: &Disc, channel: usize, x: usize, y: usize) -> [[f32; LANES]; R] {
        let line = channel * self.down + y;
        let (mut runs, mut edges) = ([[0.0f32; LANES]; R], [[0.0f32; LANES]; R]);
        let sums = &self.sums[line * (self.across + 1) + x..];
        for &[first, end] in &disc.runs {
            for r in 0..R {
                let row = r * (self.across + 1);
                add_between(&mut runs[r], group(sums, first + row), group(sums, end + row));
            }
        }
        let sums = &self.sums[line * (self.across + 1)..];
        for &(at, times) in &disc.whole {
            for r in 0..R {
                let period = sums[at + r * (self.across + 1)];
                runs[r].iter_mut().for_each(|sum| *sum += times * period);
            }
        }
        let color = &self.color[line * self.across + x..];
        for &(at, weight) in &disc.edges {
            for r in 0..R {
                add_weighted(&mut edges[r], weight, group(color, at + r * self.across));
            }
        }
        for r in 0..R {
            for i in 0..LANES {
                edges[r][i] += disc.run_weight * runs[r][i];
            }
        }
        edges
    }
}

/// A kernel as lists of indices into [`RunningSums`], relative to the square around a pixel.
struct Disc {
    run_weight: f32,
    /// Indices into the running sums: where runs begin and end.
    runs: Vec<[usize; 2]>,
    /// Indices into the running sums, from the beginning of a row: the sums of whole periods, and how many of them lie between
    /// where a run begins and ends.
    whole: Vec<(usize, f32)>,
    /// Indices into the colours: the pixels that the opening covers partly, with their weights.
    edges: Vec<(usize, f32)>,
}

#[inline(always)]
fn add_between(sum: &mut [f32; LANES], before: &[f32; LANES], after: &[f32; LANES]) {
    for i in 0..LANES {
        sum[i] += after[i] - before[i];
    }
}

#[inline(always)]
fn add_weighted(sum: &mut [f32; LANES], weight: f32, values: &[f32; LANES]) {
    for i in 0..LANES {
        sum[i] += weight * values[i];
    }
}

/// The frame from which discs are gathered.
pub struct Gather<'a> {
    pub size: Size,
    /// Colours of the surface.
    pub colors: Colors,
    /// Shifts of the surface relative to infinity.
    pub s: &'a [f32],
    pub s_focus: f64,
    pub kernels: &'a Kernels,
    pub simd: Simd,
    pub cancel: &'a Cancel,
}

impl Gather<'_> {
    /// Renders the tile at `origin` in strips of [`LANES`] columns. The values that a pixel sums up are then still in
    /// the cache when the pixel below it is summed up.
    pub fn tile(&self, origin: (usize, usize), around: &mut RunningSums, out: &mut TileColor) -> Result<()> {
        let extent = extent(self.size, origin);
        let strips = (0..extent.0).step_by(LANES);
        match Surface::new(self.s, self.size, self.s_focus, origin) {
            Surface::Level(s) => {
                let kernel = self.kernels.level(s);
                around.fill(self.size, &self.colors, origin, kernel.reach as usize);
                let disc = around.disc(kernel);
                for x in strips {
                    self.simd.run(
                        #[inline(always)]
                        || level_strip(around, &disc, x, extent.1, self.cancel, out),
                    )?;
                }
            }
            Surface::Tilted(steps) => {
                let discs = self.tilted(&steps, origin, around);
                for x in strips {
                    let discs = (*steps.start(), &discs[..]);
                    self.tilted_strip(around, discs, |_, p, step| share(p, step), (origin, x), extent, out)?;
                }
            }
        }
        Ok(())
    }

    /// By how much each pixel of the tile at `origin` rises with its own shift: the discs between which it lies differ. Of
    /// surfaces of one depth, `kernels` has those [beside] theirs.
    pub fn slopes(
        &self,
        kernels: &Kernels,
        origin: (usize, usize),
        around: &mut RunningSums,
        out: &mut TileColor,
    ) -> Result<()> {
        let extent = extent(self.size, origin);
        let strips = (0..extent.0).step_by(LANES);
        match Surface::new(self.s, self.size, self.s_focus, origin) {
            Surface::Level(s) => {
                let ends = beside(s);
                let [less, more] = ends.map(|s| kernels.level(s));
                around.fill(self.size, &self.colors, origin, less.reach.max(more.reach) as usize);
                let discs = [around.disc(less), around.disc(more)];
                let slope = 1.0 / (ends[1] - ends[0]);
                out.planes.iter_mut().for_each(|plane| plane.fill(0.0));
                for (x, y) in strips.flat_map(|x| (0..extent.1).map(move |y| (x, y))) {
                    self.cancel.check()?;
                    for (disc, toward) in discs.iter().zip([-slope, slope]) {
                        self.simd.run(
                            #[inline(always)]
                            || add_shares(around, disc, (x, y), &[toward; LANES], out),
                        );
                    }
                }
            }
            Surface::Tilted(steps) => {
                let discs = self.tilted(&steps, origin, around);
                let slope = |s: f32, position: f64, step: i32| {
                    let per_px = position_slope(f64::from(s) - self.s_focus) as f32;
                    per_px * share_slope(position, step, *steps.end())
                };
                for x in strips {
                    self.tilted_strip(around, (*steps.start(), &discs), slope, (origin, x), extent, out)?;
                }
            }
        }
        Ok(())
    }

    /// The discs between which the pixels of a tile of varying depth lie; `around` then holds their surroundings.
    fn tilted(
        &self,
        steps: &RangeInclusive<i32>,
        origin: (usize, usize),
        around: &mut RunningSums,
    ) -> Vec<Disc> {
        let kernels = steps.clone().map(|step| self.kernels.get(step * APART));
        let reach = kernels.clone().map(|kernel| kernel.reach).max();
        around.fill(self.size, &self.colors, origin, reach.unwrap_or(0) as usize);
        kernels.map(|kernel| around.disc(kernel)).collect()
    }

    /// Sums up the discs in columns `x .. x + LANES` of a tile of varying depth: each in turn, by the shares of it that
    /// pixels have of a shift and at a position. These lie between two discs.
    fn tilted_strip(
        &self,
        around: &RunningSums,
        (first, discs): (i32, &[Disc]),
        share: impl Fn(f32, f64, i32) -> f32,
        (origin, x): ((usize, usize), usize),
        extent: (usize, usize),
        out: &mut TileColor,
    ) -> Result<()> {
        let n = LANES.min(extent.0 - x);
        for y in 0..extent.1 {
            self.cancel.check()?;
            let s = &self.s[(origin.1 + y) * self.size.width + origin.0 + x..][..n];
            let mut positions = [0.0f64; LANES];
            positions.iter_mut().zip(s).for_each(|(p, &s)| *p = position(s, self.s_focus));
            out.planes.iter_mut().for_each(|plane| plane[y * TILE.0 + x..][..LANES].fill(0.0));
            let lower = positions[..n].iter().map(|p| p.floor() as i32);
            let (least, most) = lower.fold((i32::MAX, i32::MIN), |(lo, hi), p| (lo.min(p), hi.max(p)));
            // A pixel at the last disc counts as between that one and the disc before it.
            for step in (least - 1).max(first)..=(most + 1).min(first + discs.len() as i32 - 1) {
                let disc = &discs[(step - first) as usize];
                let mut shares = [0.0f32; LANES];
                for (share_of, (s, p)) in shares.iter_mut().zip(s.iter().zip(positions)) {
                    *share_of = share(*s, p, step);
                }
                if shares[..n] == [0.0; LANES][..n] {
                    continue;
                }
                self.simd.run(
                    #[inline(always)]
                    || add_shares(around, disc, (x, y), &shares, out),
                );
            }
        }
        Ok(())
    }
}

/// Adds one disc to each of the pixels from `(x, y)` on, weighted by the pixel's share of it.
#[inline(always)]
fn add_shares(
    around: &RunningSums,
    disc: &Disc,
    (x, y): (usize, usize),
    shares: &[f32; LANES],
    out: &mut TileColor,
) {
    for (c, plane) in out.planes.iter_mut().enumerate() {
        let [means] = around.convolve(disc, c, x, y);
        let row = &mut plane[y * TILE.0 + x..][..LANES];
        row.iter_mut().zip(means).zip(shares).for_each(|((out, mean), share)| *out += share * mean);
    }
}

/// Renders columns `x .. x + LANES` of a tile of one depth.
#[inline(always)]
fn level_strip(
    around: &RunningSums,
    disc: &Disc,
    x: usize,
    rows: usize,
    cancel: &Cancel,
    out: &mut TileColor,
) -> Result<()> {
    for (c, plane) in out.planes.iter_mut().enumerate() {
        for y in (0..rows).step_by(ROWS) {
            cancel.check()?;
            let means: [_; ROWS] = around.convolve(disc, c, x, y);
            for (row, means) in plane[y * TILE.0..].chunks_mut(TILE.0).zip(&means) {
                row[x..x + LANES].copy_from_slice(means);
            }
        }
    }
    Ok(())
}
