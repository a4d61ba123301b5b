//! Tiles that see one closed surface of nearly constant depth: the exact, area-weighted opening by running sums.

use super::colors::Colors;
use super::kernels::{self, Kernels};
use super::pack::TILE;
use super::sweep::TileColor;
use crate::aperture::{Aperture, Kernel};
use crate::cancel::Cancel;
use crate::cpu::border::mirrored;
use crate::cpu::simd::Simd;
use crate::error::Result;
use crate::picture::Size;
use std::ops::{Add, Mul, RangeInclusive, Sub};

/// On a tilted surface a pixel's disc is interpolated between two, this many radius steps apart: a quarter of a
/// pixel, or a sixteenth for small ones. Only rims differ, by less than the rounding to a single step would cost.
pub const APART: i32 = 4;

/// Pixels convolved together.
const LANES: usize = 16;

/// What discs are summed up in.
///
/// In `f32`, a run that ends far along a row keeps the colour of its pixels to a hundred-thousandth, as long as none
/// outshines the rest; a disc averages over many runs. Where highlights are still in the picture it takes `f64`.
pub trait Real:
    Copy + Default + From<f32> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
    /// Rounded to what pictures hold.
    fn to_f32(self) -> f32;
    /// Rounded to what is summed up.
    fn from_f64(v: f64) -> Self;
}

impl Real for f32 {
    fn to_f32(self) -> f32 {
        self
    }

    fn from_f64(v: f64) -> f32 {
        v as f32
    }
}

impl Real for f64 {
    fn to_f32(self) -> f32 {
        self as f32
    }

    fn from_f64(v: f64) -> f64 {
        v
    }
}

/// A tile's surroundings as rows of running sums, with mirrored borders.
#[derive(Default)]
pub struct Surroundings<T> {
    reach: usize,
    across: usize,
    down: usize,
    /// Colour planes, and [`LANES`] more so that whole groups can be read.
    color: Vec<T>,
    /// Running sums along each row of each plane, one more than there are columns, and [`LANES`] more.
    sums: Vec<T>,
    /// One row of the frame, all channels.
    row: Vec<f32>,
}

impl<T: Real> Surroundings<T> {
    /// Takes in the surroundings of the tile at `origin`.
    fn fill(&mut self, size: Size, colors: &Colors, origin: (usize, usize), reach: usize) {
        let (across, down) = (TILE.0 + 2 * reach, TILE.1 + 2 * reach);
        (self.reach, self.across, self.down) = (reach, across, down);
        self.color.resize(size.channels * across * down + LANES, T::default());
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
                    color.iter_mut().zip(row).for_each(|(v, &own)| *v = own.into());
                } else {
                    color.iter_mut().zip(&columns).for_each(|(v, &x)| *v = row[x - first].into());
                }
            }
            // The sums of the channels are made side by side: each waits for its own last one.
            let line = |c: usize| (c.min(size.channels - 1) * down + j) * across;
            let color: [&[T]; 4] = std::array::from_fn(|c| &self.color[line(c)..][..across]);
            let mut sum = [T::default(); 4];
            for x in 0..=across {
                for c in 0..size.channels {
                    self.sums[line(c) + c * down + j + x] = sum[c];
                    if x < across {
                        sum[c] = sum[c] + color[c][x];
                    }
                }
            }
        }
    }

    /// Convolves pixels `x .. x + LANES` of tile row `y` with one kernel.
    #[inline(always)]
    fn convolve(&self, kernel: &Kernel, channel: usize, x: usize, y: usize) -> [T; LANES] {
        let group =
            |values: &[T], at: usize| -> [T; LANES] { std::array::from_fn(|i| values[at..at + LANES][i]) };
        let (mut runs, mut edges) = ([T::default(); LANES], [T::default(); LANES]);
        for row in &kernel.rows {
            let line = channel * self.down + (y + self.reach).wrapping_add_signed(row.dy as isize);
            let at = |dx: i32| (x + self.reach).wrapping_add_signed(dx as isize);
            if row.run.0 < row.run.1 {
                let start = line * (self.across + 1);
                let (before, after) =
                    (group(&self.sums, start + at(row.run.0)), group(&self.sums, start + at(row.run.1)));
                runs = std::array::from_fn(|i| runs[i] + (after[i] - before[i]));
            }
            for &(dx, weight) in &row.partial {
                let values = group(&self.color, line * self.across + at(dx));
                edges = std::array::from_fn(|i| edges[i] + T::from(weight) * values[i]);
            }
        }
        let weight = T::from(kernel.run_weight);
        std::array::from_fn(|i| weight * runs[i] + edges[i])
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
    pub aperture: &'a Aperture,
    pub kernels: &'a Kernels,
    pub simd: Simd,
    pub cancel: &'a Cancel,
}

impl Gather<'_> {
    /// The tile at `origin`. A tile of one depth has exactly its own kernel.
    pub fn tile<T: Real>(
        &self,
        origin: (usize, usize),
        around: &mut Surroundings<T>,
        out: &mut TileColor,
    ) -> Result<()> {
        let extent = extent(self.size, origin);
        let row = |y: usize| &self.s[(origin.1 + y) * self.size.width + origin.0..][..extent.0];
        if let Some(s) = only_shift(self.s, self.size, origin) {
            let kernel = self.aperture.kernel(f64::from(s) - self.s_focus);
            around.fill(self.size, self.colors, origin, kernel.reach as usize);
            for y in 0..extent.1 {
                self.cancel.check()?;
                self.simd.run(
                    #[inline(always)]
                    || flat_row(around, &kernel, y, out),
                );
            }
            return Ok(());
        }
        let reach =
            steps(self.s, self.size, self.s_focus, origin).map(|key| self.kernels.get(key).reach).max();
        around.fill(self.size, self.colors, origin, reach.unwrap_or(0) as usize);
        for y in 0..extent.1 {
            self.cancel.check()?;
            self.tilted_row(around, row(y), y, out);
        }
        Ok(())
    }

    /// A row of pixels of different depths: of each disc in turn, what the pixels between it and the next ones take.
    fn tilted_row<T: Real>(&self, around: &Surroundings<T>, s: &[f32], y: usize, out: &mut TileColor) {
        let mut positions = [0.0f64; TILE.0];
        let positions = &mut positions[..s.len()];
        positions.iter_mut().zip(s).for_each(|(p, &s)| *p = position(s, self.s_focus));
        out.planes.iter_mut().for_each(|plane| plane[y * TILE.0..][..TILE.0].fill(0.0));
        for step in range_of(positions.iter().copied()) {
            let share = |p: f64| (1.0 - (p - f64::from(step)).abs()).max(0.0);
            let Some(first) = positions.iter().position(|&p| share(p) > 0.0) else { continue };
            let end = positions.iter().rposition(|&p| share(p) > 0.0).map_or(first, |last| last + 1);
            let mut shares = [T::default(); TILE.0];
            shares
                .iter_mut()
                .zip(&positions[first..end])
                .for_each(|(share_of, &p)| *share_of = T::from_f64(share(p)));
            let kernel = self.kernels.get(step * APART);
            self.simd.run(
                #[inline(always)]
                || add_shares(around, kernel, first, y, &shares[..end - first], out),
            );
        }
    }
}

/// A row of pixels of one depth.
#[inline(always)]
fn flat_row<T: Real>(around: &Surroundings<T>, kernel: &Kernel, y: usize, out: &mut TileColor) {
    for (c, plane) in out.planes.iter_mut().enumerate() {
        for (x, out) in plane[y * TILE.0..][..TILE.0].chunks_exact_mut(LANES).enumerate() {
            let means = around.convolve(kernel, c, x * LANES, y);
            out.iter_mut().zip(means).for_each(|(out, mean)| *out = mean.to_f32());
        }
    }
}

/// Adds the share that each pixel from `first` on has in one disc.
#[inline(always)]
fn add_shares<T: Real>(
    around: &Surroundings<T>,
    kernel: &Kernel,
    first: usize,
    y: usize,
    shares: &[T],
    out: &mut TileColor,
) {
    for (c, plane) in out.planes.iter_mut().enumerate() {
        let row = &mut plane[y * TILE.0 + first..][..shares.len()];
        for ((i, out), shares) in row.chunks_mut(LANES).enumerate().zip(shares.chunks(LANES)) {
            let means = around.convolve(kernel, c, first + i * LANES, y);
            for ((out, mean), &share) in out.iter_mut().zip(means).zip(shares) {
                *out += (share * mean).to_f32();
            }
        }
    }
}

/// Columns and rows of the frame in the tile at `origin`.
fn extent(size: Size, origin: (usize, usize)) -> (usize, usize) {
    (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1))
}

/// The shift of all pixels of the tile at `origin`, if it is the same for all.
pub fn only_shift(s: &[f32], size: Size, origin: (usize, usize)) -> Option<f32> {
    let extent = extent(size, origin);
    let row = |y: usize| &s[(origin.1 + y) * size.width + origin.0..][..extent.0];
    let first = row(0)[0];
    (0..extent.1).all(|y| row(y).iter().all(|&s| s == first)).then_some(first)
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

/// The radius steps that a tile needs.
pub fn steps(
    s: &[f32],
    size: Size,
    s_focus: f64,
    origin: (usize, usize),
) -> impl Iterator<Item = i32> + use<> {
    let extent = extent(size, origin);
    let rows = (origin.1..origin.1 + extent.1).flat_map(|y| &s[y * size.width + origin.0..][..extent.0]);
    // The position rises with the shift, so that the extremes of one are those of the other.
    let (least, greatest) =
        rows.fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), &s| (lo.min(s), hi.max(s)));
    range_of([least, greatest].into_iter().map(|s| position(s, s_focus))).map(|step| step * APART)
}
