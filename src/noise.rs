//! How strong the noise of a map of depth is.
//!
//! A surface is nearly a plane between neighbouring pixels, and the disparity of a plane is linear over the picture. So
//! the mean of two opposite neighbours is the pixel's own disparity, and what remains is noise.

use crate::picture::Size;
use rayon::prelude::*;

/// The share of the second differences that is taken for noise alone. The others may be edges and curvature.
const QUIET_SHARE: f64 = 0.2;
/// This share of normally distributed values is smaller in magnitude than so many deviations.
const QUIET_DEVIATIONS: f32 = 0.253_35;
/// The deviation of `a - 2 b + c`, in units of that of each: the root of `1 + 4 + 1`.
const SECOND_DIFFERENCE: f32 = 2.449_49;
/// So many second differences tell their quantile to one percent.
const ENOUGH: usize = 1 << 17;

/// The standard deviation of the noise of `s`, one value a pixel; 0 if they have none. Pixels without a value are NaN.
pub fn deviation(s: &[f32], size: Size) -> f32 {
    let (width, height) = (size.width, size.height);
    let step = (2 * size.pixels() / ENOUGH).max(1);
    let differences = |y: usize| {
        let row = &s[y * width..][..width];
        let along = row.windows(3).map(|s| s[0] - 2.0 * s[1] + s[2]);
        let across = (y > 0 && y + 1 < height).then(|| {
            let beside = |y: usize| &s[y * width..][..width];
            let around = beside(y - 1).iter().zip(row).zip(beside(y + 1));
            around.map(|((above, own), below)| above - 2.0 * own + below)
        });
        along.chain(across.into_iter().flatten()).map(f32::abs).filter(|d| !d.is_nan())
    };
    let rows: Vec<usize> = (0..height).step_by(step).collect();
    let mut all: Vec<f32> = rows.into_par_iter().flat_map_iter(differences).collect();
    if all.is_empty() {
        return 0.0;
    }
    let at = (QUIET_SHARE * all.len() as f64) as usize;
    *all.select_nth_unstable_by(at, f32::total_cmp).1 / (QUIET_DEVIATIONS * SECOND_DIFFERENCE)
}
