//! The samples of the lens that a frame is integrated over.

use crate::aperture::{Aperture, Side};

/// Samples that a tile gets for every pixel of the area of its largest disc. Neighbouring samples draw a point at places
/// `1 / sqrt(0.4) = 1.6` pixels apart, which a [footprint](super::footprint) of 0.55 pixels bridges: twice the deviation
/// of a pixel, `1 / sqrt(12)`.
const SAMPLES_PER_PIXEL: f64 = 0.4;
/// Numbers of samples to choose from: the noise of too few, and the time of too many, are both bounded.
const COUNTS: [usize; 7] = [64, 96, 128, 192, 256, 384, 512];

/// A lens point and the place inside the pixel that its ray starts from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensSample {
    /// Lens point, in units of the aperture's radius, that the ray seems to come from in front of the focus.
    pub in_front: [f64; 2],
    /// The same behind it: another one where the lens is aberrated.
    pub behind: [f64; 2],
    /// Where the ray passes the opening itself, for what the second stop clips.
    pub pupil: [f64; 2],
    /// Start of the ray relative to the pixel's centre, within half a pixel.
    pub start: [f64; 2],
}

/// How many samples a disc of radius `r_px` needs.
pub fn count_for(r_px: f64) -> usize {
    let wanted = SAMPLES_PER_PIXEL * std::f64::consts::PI * r_px * r_px;
    let enough = COUNTS.iter().copied().find(|&n| n as f64 >= wanted);
    enough.unwrap_or(COUNTS[COUNTS.len() - 1])
}

/// Distance in pixels between the places at which `n` samples draw a point under shift `t_px`, the opening's area being
/// the fraction `area` of the unit disc's.
pub fn spacing_px(t_px: f64, area: f64, n: usize) -> f64 {
    t_px.abs() * (std::f64::consts::PI * area / n as f64).sqrt()
}

/// `n` samples, the same for every pixel.
///
/// Starts traverse the additive recurrence of the plastic number, which fills the square evenly and has no
/// relation to the golden ratio of the lens points.
pub fn lens_samples(aperture: &Aperture, n: usize) -> Vec<LensSample> {
    const PLASTIC: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let start = |i: usize| PLASTIC.map(|a| (0.5 + (i + 1) as f64 * a).fract() - 0.5);
    let in_front = aperture.lens_points(n, Side::InFront);
    let behind = if aperture.has_sides() { aperture.lens_points(n, Side::Behind) } else { in_front.clone() };
    let pupil = aperture.pupil_points(n);
    let sample =
        |i: usize| LensSample { in_front: in_front[i], behind: behind[i], pupil: pupil[i], start: start(i) };
    let mut samples: Vec<LensSample> = (0..n).map(sample).collect();
    // Neighbours look at nearly the same cells, which one after another are still in the first level of the cache:
    // to and fro along strips that hold about as many samples as there are strips.
    let strips = (n as f64).sqrt();
    let strip = |sample: &LensSample| ((0.5 + 0.5 * sample.in_front[1]) * strips) as usize;
    let along =
        |sample: &LensSample| if strip(sample) % 2 == 0 { sample.in_front[0] } else { -sample.in_front[0] };
    samples.sort_by(|a, b| strip(a).cmp(&strip(b)).then(along(a).total_cmp(&along(b))));
    samples
}
