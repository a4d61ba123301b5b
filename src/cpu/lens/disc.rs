//! Tiles that see one closed surface of nearly constant depth: the exact, area-weighted opening by running sums.

use super::colors::Colors;
use super::kernels::{self, Kernels};
use super::pack::TILE;
use super::sweep::TileColor;
use crate::aperture::Kernel;
use crate::cancel::Cancel;
use crate::cpu::border::mirrored;
use crate::cpu::simd::Simd;
use crate::error::Result;
use crate::picture::{Size, range};
use std::ops::{Add, RangeInclusive, Sub};

/// On a tilted surface a pixel's disc is interpolated between two, this many radius steps apart: a quarter of a
/// pixel, or a sixteenth for small ones. Only rims differ, by less than the rounding to a single step would cost.
pub const APART: i32 = 4;

/// Pixels convolved together.
const LANES: usize = 16;

/// What runs are summed up in.
///
/// In `f32`, a run that ends far along a row keeps the colour of its pixels to a hundred-thousandth, as long as none
/// outshines the rest; a disc averages over many runs. Where highlights are still in the picture it takes `f64`.
pub trait Real: Copy + Default + From<f32> + Add<Output = Self> + Sub<Output = Self> {
    /// Rounded to what pictures hold.
    fn to_f32(self) -> f32;
}

impl Real for f32 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

impl Real for f64 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self as f32
    }
}

/// A tile's surroundings as rows of running sums, with mirrored borders.
#[derive(Default)]
pub struct Surroundings<T> {
    reach: usize,
    across: usize,
    down: usize,
    /// Colour planes, and [`LANES`] more so that whole groups can be read.
    color: Vec<f32>,
    /// Running sums along each row of each plane, one more than there are columns, and [`LANES`] more.
    sums: Vec<T>,
    /// One row of the frame, all channels.
    row: Vec<f32>,
}

/// The group of values that begins at `at`.
#[inline(always)]
fn group<T>(values: &[T], at: usize) -> &[T; LANES] {
    values[at..].first_chunk().expect("planes are longer by a group")
}

impl<T: Real> Surroundings<T> {
    /// Takes in the surroundings of the tile at `origin`.
    fn fill(&mut self, size: Size, colors: &Colors, origin: (usize, usize), reach: usize) {
        let (across, down) = (TILE.0 + 2 * reach, TILE.1 + 2 * reach);
        (self.reach, self.across, self.down) = (reach, across, down);
        self.color.resize(size.channels * across * down + LANES, 0.0);
        self.sums.resize(size.channels * (across + 1) * down + LANES, T::default());
        let from = |start: usize, n: usize, extent: usize| -> Vec<usize> {
            (0..n).map(|i| mirrored((start + i) as i64 - reach as i64, extent).0).collect()
        };
        let (columns, rows) = (from(origin.0, across, size.width), from(origin.1, down, size.height));
        let (first, last) = columns.iter().fold((usize::MAX, 0), |(lo, hi), &x| (lo.min(x), hi.max(x)));
        let n = last + 1 - first;
        self.row.resize(n * size.channels, 0.0);
        for (j, &y) in rows.iter().enumerate() {
            colors.copy_row(y, first..last + 1, n, &mut self.row);
            for (c, row) in self.row.chunks_exact(n).enumerate() {
                let color = &mut self.color[(c * down + j) * across..][..across];
                if n == across {
                    // Nothing is mirrored.
                    color.copy_from_slice(row);
                } else {
                    color.iter_mut().zip(&columns).for_each(|(v, &x)| *v = row[x - first]);
                }
            }
            // The sums of the channels are made side by side: each waits for its own last one.
            let line = |c: usize| (c.min(size.channels - 1) * down + j) * across;
            let color: [&[f32]; 4] = std::array::from_fn(|c| &self.color[line(c)..][..across]);
            let mut sum = [T::default(); 4];
            for x in 0..=across {
                for c in 0..size.channels {
                    self.sums[line(c) + c * down + j + x] = sum[c];
                    if x < across {
                        sum[c] = sum[c] + T::from(color[c][x]);
                    }
                }
            }
        }
    }

    /// Convolves pixels `x .. x + LANES` of tile row `y` with one kernel.
    #[inline(always)]
    fn convolve(&self, kernel: &Kernel, channel: usize, x: usize, y: usize) -> [f32; LANES] {
        let (mut runs, mut edges) = ([T::default(); LANES], [0.0f32; LANES]);
        for row in &kernel.rows {
            let line = channel * self.down + (y + self.reach).wrapping_add_signed(row.dy as isize);
            let at = |dx: i32| (x + self.reach).wrapping_add_signed(dx as isize);
            if row.run.0 < row.run.1 {
                let sums = |dx: i32| group(&self.sums, line * (self.across + 1) + at(dx));
                let (before, after) = (sums(row.run.0), sums(row.run.1));
                runs = std::array::from_fn(|i| runs[i] + (after[i] - before[i]));
            }
            for &(dx, weight) in &row.partial {
                let values = group(&self.color, line * self.across + at(dx));
                edges = std::array::from_fn(|i| edges[i] + weight * values[i]);
            }
        }
        std::array::from_fn(|i| kernel.run_weight * runs[i].to_f32() + edges[i])
    }
}

/// The frame that discs are gathered from.
pub struct Gather<'a> {
    pub size: Size,
    /// Colours of the surface.
    pub colors: &'a Colors,
    /// Its shifts relative to infinity.
    pub s: &'a [f32],
    pub s_focus: f64,
    pub kernels: &'a Kernels,
    pub simd: Simd,
    pub cancel: &'a Cancel,
}

impl Gather<'_> {
    /// The tile at `origin`, in strips of [`LANES`] columns: what a pixel sums up is then still near when the one below
    /// it is summed up.
    pub fn tile<T: Real>(
        &self,
        origin: (usize, usize),
        around: &mut Surroundings<T>,
        out: &mut TileColor,
    ) -> Result<()> {
        let extent = extent(self.size, origin);
        let strips = (0..extent.0).step_by(LANES);
        match Surface::new(self.s, self.size, self.s_focus, origin) {
            Surface::Level(s) => {
                let kernel = self.kernels.level(s);
                around.fill(self.size, self.colors, origin, kernel.reach as usize);
                for x in strips {
                    self.simd.run(
                        #[inline(always)]
                        || level_strip(around, kernel, x, extent.1, self.cancel, out),
                    )?;
                }
            }
            Surface::Tilted(steps) => {
                let reach = steps.map(|step| self.kernels.get(step * APART).reach).max();
                around.fill(self.size, self.colors, origin, reach.unwrap_or(0) as usize);
                for x in strips {
                    self.tilted_strip(around, origin, x, extent, out)?;
                }
            }
        }
        Ok(())
    }

    /// Columns `x .. x + LANES` of a tile of different depths: of each disc in turn, what the pixels between it and the
    /// next ones take.
    fn tilted_strip<T: Real>(
        &self,
        around: &Surroundings<T>,
        origin: (usize, usize),
        x: usize,
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
            for step in range_of(positions[..n].iter().copied()) {
                let share = |p: f64| (1.0 - (p - f64::from(step)).abs()).max(0.0) as f32;
                let shares = positions.map(share);
                if shares[..n] == [0.0; LANES][..n] {
                    continue;
                }
                let kernel = self.kernels.get(step * APART);
                self.simd.run(
                    #[inline(always)]
                    || add_shares(around, kernel, (x, y), &shares, out),
                );
            }
        }
        Ok(())
    }
}

/// Adds the share that each of the pixels from `(x, y)` on has in one disc.
#[inline(always)]
fn add_shares<T: Real>(
    around: &Surroundings<T>,
    kernel: &Kernel,
    (x, y): (usize, usize),
    shares: &[f32; LANES],
    out: &mut TileColor,
) {
    for (c, plane) in out.planes.iter_mut().enumerate() {
        let means = around.convolve(kernel, c, x, y);
        let row = &mut plane[y * TILE.0 + x..][..LANES];
        row.iter_mut().zip(means).zip(shares).for_each(|((out, mean), share)| *out += share * mean);
    }
}

/// Columns `x .. x + LANES` of a tile of one depth.
#[inline(always)]
fn level_strip<T: Real>(
    around: &Surroundings<T>,
    kernel: &Kernel,
    x: usize,
    rows: usize,
    cancel: &Cancel,
    out: &mut TileColor,
) -> Result<()> {
    for (c, plane) in out.planes.iter_mut().enumerate() {
        for y in 0..rows {
            cancel.check()?;
            plane[y * TILE.0 + x..][..LANES].copy_from_slice(&around.convolve(kernel, c, x, y));
        }
    }
    Ok(())
}

/// Columns and rows of the frame in the tile at `origin`.
fn extent(size: Size, origin: (usize, usize)) -> (usize, usize) {
    (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1))
}

/// Where a shift lies between the discs that are interpolated.
#[inline(always)]
fn position(s: f32, s_focus: f64) -> f64 {
    kernels::position(f64::from(s) - s_focus) / f64::from(APART)
}

/// The discs between which some positions lie.
fn range_of(positions: impl Iterator<Item = f64>) -> RangeInclusive<i32> {
    let (least, greatest) =
        positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    least.floor() as i32..=greatest.ceil() as i32
}

/// The surface that a tile shows.
pub enum Surface {
    /// All has this shift relative to infinity.
    Level(f32),
    /// The discs that its pixels lie between, in steps of [`APART`].
    Tilted(RangeInclusive<i32>),
}

impl Surface {
    /// That of the tile at `origin`.
    pub fn new(s: &[f32], size: Size, s_focus: f64, origin: (usize, usize)) -> Surface {
        let extent = extent(size, origin);
        let rows = (origin.1..origin.1 + extent.1).map(|y| &s[y * size.width + origin.0..][..extent.0]);
        let (least, greatest) = rows.fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), row| {
            let [least, greatest] = range(row);
            (lo.min(least), hi.max(greatest))
        });
        if least == greatest {
            return Surface::Level(least);
        }
        // The position rises with the shift, so that the extremes of one are those of the other.
        Surface::Tilted(range_of([least, greatest].into_iter().map(|s| position(s, s_focus))))
    }

    /// The radius steps that it needs.
    pub fn keys(&self) -> impl Iterator<Item = i32> + use<> {
        let steps = match self {
            Surface::Level(_) => 0..0,
            Surface::Tilted(steps) => *steps.start()..*steps.end() + 1,
        };
        steps.map(|step| step * APART)
    }

    /// The shift that it has all over, if any.
    pub fn level(&self) -> Option<f32> {
        match self {
            Surface::Level(s) => Some(*s),
            Surface::Tilted(_) => None,
        }
    }
}
