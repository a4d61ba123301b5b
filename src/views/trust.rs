//! How far the pixels of a view are to be trusted.
//!
//! Where the view and the reference do not fit together (something has moved, a pose is wrong, depth has another scale),
//! silhouettes are displaced, and along them a strip as wide as the displacement contradicts. And what both see has its
//! colours elsewhere: on surfaces where they agree, the picture of the reference fits better some pixels beside.

use super::depth_map::DepthMap;
use super::evidence::Evidence;
use super::motion::ToReference;
use super::view::{AGREES, View};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::scene::grid::BLOCK;
use rayon::prelude::*;

/// How far each pixel is to be trusted.
pub struct Trust {
    across: usize,
    of_block: Vec<f32>,
}

/// The strip of a displacement by one pixel is this part of the three by three blocks around, if a silhouette crosses
/// them. That much may be, and three times as much may not.
const DISPLACED: f32 = 1.0 / (3 * BLOCK) as f32;

/// Where blocks know less than this many pixels, as a row of them, the whole view speaks for them.
const FEW: f32 = BLOCK as f32;

/// The least of the differences of colour beside, as a part of those in place. From 1 on colours are where they ought to be;
/// what is displaced by a pixel fits as well two pixels away. The chance of noise makes it a tenth less.
const FITS: [f32; 2] = [0.75, 1.0];

/// Along both axes, the colours of one pixel of so many are compared.
const STEP: usize = 4;

/// The view as a whole counts as much as the pixels of three by three blocks.
const WHOLE: f32 = (9 * BLOCK * BLOCK / (STEP * STEP)) as f32;

/// Places beside: those two and three pixels away, and twice as far. A displacement that is larger still leaves wide strips.
const PLACES: usize = 56;

/// Differences of colour in place, and at each of the places beside.
pub type Differences = [f32; 1 + PLACES];

fn places() -> [[isize; 2]; 1 + PLACES] {
    let ring = (-3..=3).flat_map(|y: isize| (-3..=3).map(move |x: isize| [x, y]));
    let ring: Vec<_> = ring.filter(|[x, y]| (4..=10).contains(&(x * x + y * y))).collect();
    let mut places = [[0; 2]; 1 + PLACES];
    let all = [1, 2].iter().flat_map(|scale| ring.iter().map(move |place| place.map(|v| scale * v)));
    places[1..].iter_mut().zip(all).for_each(|(out, place)| *out = place);
    places
}

/// The farthest place along an axis.
const FARTHEST: usize = 6;

/// How well the colours of a view and those of the reference fit.
pub struct Fit<'a> {
    pub map: DepthMap<'a>,
    pub to_reference: &'a ToReference<'a>,
    /// Of the view and of the reference.
    pub colors: (&'a View, &'a View),
    /// How many channels hold light.
    pub lights: usize,
}

impl Fit<'_> {
    /// The sums of differences of each block, and how many pixels they are of.
    pub fn of_blocks(&self, evidence: &[Evidence], cancel: &Cancel) -> Result<Vec<(Differences, f32)>> {
        let DepthMap { width, height, .. } = self.map;
        let places = places();
        let of_band = |band: usize| {
            cancel.check()?;
            let mut sums = vec![([0.0; 1 + PLACES], 0.0); width.div_ceil(BLOCK)];
            let rows = (band * BLOCK..height.min((band + 1) * BLOCK)).step_by(STEP);
            for i in rows.flat_map(|y| (0..width).step_by(STEP).map(move |x| y * width + x)) {
                if evidence[i] == Evidence::Agrees {
                    let (sum, count) = &mut sums[i % width / BLOCK];
                    *count += f32::from(u8::from(self.add(i, &places, sum)));
                }
            }
            Ok(sums)
        };
        let bands: Result<Vec<_>> = (0..height.div_ceil(BLOCK)).into_par_iter().map(of_band).collect();
        Ok(bands?.concat())
    }

    /// Adds the differences of a pixel, unless places beside it are beyond the border.
    fn add(&self, index: usize, places: &[[isize; 2]; 1 + PLACES], sum: &mut Differences) -> bool {
        let DepthMap { width, height, .. } = self.map;
        let Some(seen) = self.to_reference.at(index) else { return false };
        let Some(at) = self.map.pixel_at(seen.x, seen.y) else { return false };
        let inside = |v: usize, n: usize| v >= FARTHEST && v + FARTHEST < n;
        if !inside(at % width, width) || !inside(at / width, height) {
            return false;
        }
        let (view, reference) = self.colors;
        let own = view.color_at(index);
        // Half a pixel beside is no other place: in place, the reference is interpolated.
        let in_place = interpolated(reference, width, seen.x, seen.y);
        sum[0] += relative_difference(&own[..self.lights], &in_place[..self.lights]);
        for (sum, [x, y]) in sum.iter_mut().zip(places).skip(1) {
            let other = reference.color_at(at.wrapping_add_signed(y * width as isize + x));
            *sum += relative_difference(&own[..self.lights], &other[..self.lights]);
        }
        true
    }
}

/// The colour of a view between the centres of its pixels.
fn interpolated(view: &View, width: usize, x: f64, y: f64) -> [f32; 4] {
    let (left, top) = (x.floor(), y.floor());
    let (across, down) = ((x - left) as f32, (y - top) as f32);
    let index = top as usize * width + left as usize;
    let mix = |a: [f32; 4], b: [f32; 4], share: f32| -> [f32; 4] {
        std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))
    };
    let row = |index: usize| mix(view.color_at(index), view.color_at(index + 1), across);
    mix(row(index), row(index + width), down)
}

/// The squared difference of two colours in units of their squares, so that bright things do not count more.
fn relative_difference(a: &[f32], b: &[f32]) -> f32 {
    let (mut apart, mut together) = (0.0, f32::MIN_POSITIVE);
    for (a, b) in a.iter().zip(b) {
        apart += (a - b) * (a - b);
        together += a * a + b * b;
    }
    apart / together
}

impl Trust {
    /// Of how many pixels of each block agree and contradict, and of the differences of their colours.
    pub fn new(votes: &[[u32; 2]], fits: &[(Differences, f32)], across: usize) -> Trust {
        let down = votes.len() / across;
        let sum = |all: &mut dyn Iterator<Item = [u32; 2]>| {
            all.fold([0, 0], |[a, c], [agree, contradict]| [a + agree, c + contradict])
        };
        let [agree, contradict] = sum(&mut votes.iter().copied());
        let whole = contradict as f32 / (agree + contradict).max(1) as f32;
        let mut all: Differences = [0.0; 1 + PLACES];
        let mut count = 0.0;
        for (differences, of) in fits {
            all.iter_mut().zip(differences).for_each(|(sum, v)| *sum += v);
            count += of;
        }
        let share = WHOLE / f32::max(count, WHOLE);
        let (all, count) = (all.map(|v| v * share), count * share);
        let of_block = |i: usize| {
            let (x, y) = (i % across, i / across);
            let rows = y.saturating_sub(1)..(y + 2).min(down);
            let columns = || x.saturating_sub(1)..(x + 2).min(across);
            let around = || rows.clone().flat_map(|y| columns().map(move |x| y * across + x));
            let [agree, contradict] = sum(&mut around().map(|i| votes[i]));
            let share = (contradict as f32 + FEW * whole) / ((agree + contradict) as f32 + FEW);
            let in_place = (1.5 - 0.5 * share / DISPLACED).clamp(0.0, 1.0);
            let (mut differences, mut count) = (all, count);
            for i in around() {
                differences.iter_mut().zip(&fits[i].0).for_each(|(sum, v)| *sum += v);
                count += fits[i].1;
            }
            in_place * fits_best(&differences, count)
        };
        Trust { across, of_block: (0..votes.len()).map(of_block).collect() }
    }

    /// Interpolated between the centres of the blocks.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        let down = self.of_block.len() / self.across;
        let along = |v: usize, n: usize| {
            let place = ((v as f32 + 0.5) / BLOCK as f32 - 0.5).clamp(0.0, (n - 1) as f32);
            (place as usize, (place as usize + 1).min(n - 1), place.fract())
        };
        let ((left, right, u), (top, bottom, v)) = (along(x, self.across), along(y, down));
        let at = |x: usize, y: usize| self.of_block[y * self.across + x];
        let row = |y: usize| (1.0 - u) * at(left, y) + u * at(right, y);
        (1.0 - v) * row(top) + v * row(bottom)
    }
}

/// How far the colours of so many pixels fit in place and not beside, from 0 to 1. A difference that is none counts nowhere.
fn fits_best(differences: &Differences, count: f32) -> f32 {
    let none = 0.5 * AGREES * AGREES * count + f32::MIN_POSITIVE;
    let least = differences[1..].iter().copied().fold(f32::INFINITY, f32::min);
    let [nowhere, everywhere] = FITS;
    let fits = (least + none) / (differences[0] + none);
    ((fits - nowhere) / (everywhere - nowhere)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_as_many_as_are_counted() {
        let places = places();
        assert_eq!(places.iter().filter(|place| **place == [0, 0]).count(), 1);
        assert!(places.iter().flatten().all(|v| v.unsigned_abs() <= FARTHEST));
        assert!(places.contains(&[-6, 2]) && places.contains(&[0, 2]));
    }
}
