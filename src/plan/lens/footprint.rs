//! The size at which a cell is drawn, matched to the density of the lens samples.
//!
//! Shifting by fractions of a pixel blurs a little; where lens samples are dense, that blur is undone. Where lens
//! samples are so sparse that the positions at which a cell is drawn come apart, cells are widened along their own
//! surface instead, so that texture finer than the spacing of the samples does not turn into noise.

/// Standard deviation of a cell's footprint, as a fraction of the distance between the positions at which it is
/// drawn. Gaussians of deviation `sigma` on a lattice of unit spacing leave a ripple of `2 exp(-2 pi^2 sigma^2)`: 18
/// % here, of the texture that remains. A wider footprint ripples less (1.4 % at 0.5) and blurs more than the lens
/// does.
const FOOTPRINT: f32 = 0.35;
/// Entries of the footprint table per pixel of shift.
pub const STEPS_PER_PX: f32 = 8.0;
/// The largest weight of a neighbour in one pass; four neighbours then leave a fifth to the cell itself.
pub const MAX_WEIGHT: f32 = 0.2;
/// The variance that the four direct neighbours can add.
pub const NEXT_CELLS: f32 = 2.0 * MAX_WEIGHT;
/// Distances of the neighbours in the widening passes that follow.
pub const REACHES: [usize; 4] = [2, 4, 8, 16];

/// Variance per axis that drawing a cell at fractions of a pixel adds under shift `t`.
///
/// A fraction `f` between two positions adds `f (1 - f)`. Over the lens points of a disc its mean is
/// `4 t / (3 pi) - t^2 / 4` up to one pixel and about 1/6 beyond.
fn splat_variance(t: f32) -> f32 {
    let beyond = 1.0 / 6.0;
    if t >= 1.0 { beyond } else { (t * 4.0 / (3.0 * std::f32::consts::PI) - 0.25 * t * t).min(beyond) }
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

/// The variance to add to a cell as a function of its shift; negative where blur is to be undone.
pub struct Footprint {
    table: Vec<f32>,
}

impl Footprint {
    /// The footprint for lens samples that draw a cell of shift `t` at positions `spacing(t)` pixels apart.
    pub fn new(max_shift_px: f64, spacing: impl Fn(f64) -> f64) -> Footprint {
        let entries = (max_shift_px as f32 * STEPS_PER_PX) as usize + 2;
        let table = (0..entries)
            .map(|i| {
                let t = i as f32 / STEPS_PER_PX;
                (FOOTPRINT * spacing(f64::from(t)) as f32).powi(2) - splat_variance(t)
            })
            .collect();
        Footprint { table }
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
            let variance = self.variance((f64::from(s) - s_focus) as f32);
            *kappa = if s.is_nan() {
                0.0
            } else {
                -0.5 * if variance < NEXT_CELLS { variance } else { NEXT_CELLS }
            };
        }
    }
}
