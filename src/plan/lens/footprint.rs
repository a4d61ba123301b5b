//! The size at which a cell is drawn, matched to the density of the lens samples.
//!
//! Shifting by fractions of a pixel blurs a little; where lens samples are dense, that blur is undone. Where lens
//! samples are so sparse that the positions at which a cell is drawn come apart, cells are widened along their own
//! surface instead, so that texture finer than the spacing of the samples does not turn into noise.

use super::aberrated::Reaches;
use crate::picture::Weighting;

/// Standard deviation of a cell's footprint, as a fraction of the distance between the positions at which `samples` lens
/// samples draw it.
///
/// Gaussians of deviation `sigma` on a lattice of unit spacing leave a ripple of `2 exp(-2 pi^2 sigma^2)` of the texture
/// that remains: 1.4 % at a half. But a footprint blurs. On a disc of radius `r`, the spacing is `r sqrt(pi / n)`, and of
/// a sinusoid of `w` radians a pixel the footprint takes `sigma^2 w^2 r^2 pi / 2 n` of what the lens leaves,
/// `2 J1(w r) / (w r)`. The product is at most `0.9 sigma^2 pi / n` below `w r = 3`. For `sigma = 0.35` and 64 samples that
/// is half a percent, and `sigma^2 / n` is kept there.
fn fraction_of_spacing(samples: usize) -> f64 {
    (0.35 * (samples as f64 / 64.0).sqrt()).min(0.5)
}

/// Entries of the footprint table per pixel of shift.
pub const STEPS_PER_PX: f32 = 8.0;
/// The largest weight of a neighbour in one pass; four neighbours then leave a fifth to the cell itself.
pub const MAX_WEIGHT: f32 = 0.2;
/// The variance that the four direct neighbours can add.
pub const NEXT_CELLS: f32 = 2.0 * MAX_WEIGHT;
/// Distances of the neighbours in the widening passes that follow.
pub const REACHES: [usize; 4] = [2, 4, 8, 16];

/// From this shift on in pixels, drawing at fractions of a pixel blurs always alike.
const EVEN_PX: f64 = 4.0;

/// The factor of the Laplacian that undoes the blur of drawing a cell at fractions of a pixel, under shift `t`.
///
/// A cell whose place lies a fraction `f` between two pixels is drawn `1 - f` in one and `f` in the other. Over the lens
/// points of a disc, that leaves of a sinusoid along one axis a little less than the lens does, `A` in place of `H`. The
/// factor is the one for which `A (1 + kappa (2 - 2 cos w))` is nearest to `H`, by least squares over all frequencies up
/// to a quarter of a cycle a pixel.
fn sharpening_of_splats(t: f64) -> f32 {
    const FREQUENCIES: usize = 16;
    const POSITIONS: usize = 256;
    let t = t.abs().min(EVEN_PX);
    let middle = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
    let (mut along, mut squared) = (0.0, 0.0);
    for w in (0..FREQUENCIES).map(|i| std::f64::consts::FRAC_PI_2 * middle(i, FREQUENCIES)) {
        let (mut of_lens, mut drawn, mut all) = (0.0, 0.0, 0.0);
        for u in (0..POSITIONS).map(|i| middle(i, POSITIONS)) {
            // The chord of the disc at this distance from its centre.
            let weight = (1.0 - u * u).sqrt();
            let place = t * u;
            let (first, f) = (place.floor(), place.fract());
            all += weight;
            of_lens += weight * (w * place).cos();
            drawn += weight * ((1.0 - f) * (w * first).cos() + f * (w * (first + 1.0)).cos());
        }
        let sharper = drawn / all * (2.0 - 2.0 * w.cos());
        along += sharper * (of_lens - drawn) / all;
        squared += sharper * sharper;
    }
    (along / squared) as f32
}

/// The amount that sharpening by `kappa` moves from a cell to a neighbour: `kappa` times their difference, towards
/// the brighter one. A cell gives no more than a quarter of its light to each of four neighbours, so that none turns
/// negative.
#[inline(always)]
pub fn flow(kappa: f32, own: f32, other: f32) -> f32 {
    // Plain comparisons, which are single instructions: colours are never NaN.
    let least = |a: f32, b: f32| if a < b { a } else { b };
    let greatest = |a: f32, b: f32| if a > b { a } else { b };
    let wanted = kappa * (other - own);
    let most = if kappa > 0.0 { 0.25 * greatest(least(own, other), 0.0) } else { f32::MAX };
    greatest(least(wanted, most), -most)
}

/// The weight with which a channel that is carried moves from a neighbour to a cell by sharpening or widening by `kappa`:
/// all of `kappa`, or as much as [`flow`] would let of the light of the picture that carries it. `own` and `other` are the
/// picture's colours, all of light.
#[inline(always)]
pub fn guided<const L: usize>(kappa: f32, own: [f32; L], other: [f32; L]) -> f32 {
    let (mut wanted, mut most) = (f32::MIN_POSITIVE, f32::MIN_POSITIVE);
    for c in 0..L {
        let (a, b) = (own[c], other[c]);
        wanted += (kappa * (b - a)).abs();
        let lesser = if a < b { a } else { b };
        most += 0.25 * if lesser > 0.0 { lesser } else { 0.0 };
    }
    if kappa > 0.0 && wanted > most { kappa * (most / wanted) } else { kappa }
}

/// How the blur of drawing cells at fractions of a pixel is undone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharpening {
    /// Each channel as far as its own values allow.
    Own,
    /// As far as the values of the picture allow that carries the channels.
    Guided,
    /// Not at all, since it needs negative weights.
    Never,
}

impl Sharpening {
    /// That of channels that a picture carries.
    pub fn of_carried(weighting: Weighting) -> Sharpening {
        match weighting {
            Weighting::Light => Sharpening::Guided,
            Weighting::Mean => Sharpening::Never,
        }
    }
}

/// The variance to add to a cell as a function of its shift; negative where blur is to be undone.
pub struct Footprint {
    table: Vec<f32>,
    /// Set if the lens spreads what is in focus as well.
    spread: Option<Reaches>,
}

impl Footprint {
    /// The footprint for `samples(t)` lens samples that draw a cell of shift `t` at positions `spacing(t)` pixels apart.
    /// Where aberrations spread a cell, it is drawn as one of a larger shift.
    pub fn new(
        max_shift_px: f64,
        samples: impl Fn(f64) -> usize,
        spacing: impl Fn(f64, usize) -> f64,
        spread: Option<Reaches>,
    ) -> Footprint {
        let entries = (max_shift_px as f32 * STEPS_PER_PX) as usize + 2;
        let until_even = (EVEN_PX as f32 * STEPS_PER_PX) as usize + 1;
        let of_entry = |i: usize| f64::from(i as f32 / STEPS_PER_PX);
        let sharpening: Vec<f32> = (0..until_even).map(|i| sharpening_of_splats(of_entry(i))).collect();
        let table = (0..entries)
            .map(|i| {
                // Sharpening by `kappa` takes away the variance `2 kappa`.
                let undone = 2.0 * sharpening[i.min(until_even - 1)];
                let samples = samples(of_entry(i));
                let deviation = fraction_of_spacing(samples) * spacing(of_entry(i), samples);
                deviation.powi(2) as f32 - undone
            })
            .collect();
        Footprint { table, spread }
    }

    /// The spread of cells `x ..` of row `y` in focus, as the radius of a disc; `None` if there is none anywhere.
    pub fn spread<'a>(&self, y: usize, x: usize, into: &'a mut [f32]) -> Option<&'a [f32]> {
        let spread = self.spread.as_ref()?;
        spread.spread_px(y, x, into);
        Some(into)
    }

    /// The variances, [`STEPS_PER_PX`] per pixel of shift, from shift 0 on.
    pub fn table(&self) -> &[f32] {
        &self.table
    }

    #[inline(always)]
    pub fn variance(&self, t: f32) -> f32 {
        let last = self.table.len() - 2;
        let at = t.abs() * STEPS_PER_PX;
        let within = if at < last as f32 { at } else { last as f32 };
        // SAFETY: the place is a number from 0 to `last`, and so fits; two entries from there on are in the table.
        let (i, [a, b]) = unsafe {
            let i: i32 = within.to_int_unchecked();
            (i, [0, 1].map(|next| *self.table.get_unchecked(i as usize + next)))
        };
        let beyond = at - i as f32;
        a + if beyond < 1.0 { beyond } else { 1.0 } * (b - a)
    }

    /// The factor of the Laplacian that is subtracted from a cell of shift `s` relative to infinity. It is positive
    /// where blur is to be undone, negative where the cell is to be widened (by as much as its direct neighbours
    /// allow), and 0 where there is no cell.
    #[inline(always)]
    pub fn sharpening(&self, s: &[f32], s_focus: f64, kappa: &mut [f32]) {
        for (kappa, &s) in kappa.iter_mut().zip(s) {
            *kappa = self.factor(s, (f64::from(s) - s_focus) as f32);
        }
    }

    /// The same for cells that are [spread](Footprint::spread) in focus.
    #[inline(always)]
    pub fn sharpening_of_spread(&self, s: &[f32], spread: &[f32], s_focus: f64, kappa: &mut [f32]) {
        for ((kappa, &s), &spread) in kappa.iter_mut().zip(s).zip(spread) {
            *kappa = self.factor(s, together((f64::from(s) - s_focus) as f32, spread));
        }
    }

    #[inline(always)]
    fn factor(&self, s: f32, t: f32) -> f32 {
        let variance = self.variance(t);
        if s.is_nan() { 0.0 } else { -0.5 * if variance < NEXT_CELLS { variance } else { NEXT_CELLS } }
    }
}

/// The radius of a disc with the variance of one of shift `t` and of one of radius `spread`. Aberrations of third order
/// are uncorrelated with defocus, so that their variances add up.
#[inline(always)]
pub fn together(t: f32, spread: f32) -> f32 {
    (t * t + spread * spread).sqrt()
}
