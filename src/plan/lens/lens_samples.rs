//! The samples of the lens over which a frame is integrated.

use crate::aperture::{Aperture, Side};

/// Number of samples that a tile gets per pixel of the area of its largest disc. Neighbouring samples then draw a
/// point at positions `1 / sqrt(0.4) = 1.6` pixels apart, which a [footprint](super::footprint) of 0.55 pixels
/// bridges: twice the deviation of a pixel, `1 / sqrt(12)`.
const SAMPLES_PER_PIXEL: f64 = 0.4;
/// The sample counts to choose from. They bound both the noise of too few samples and the time of too many.
const COUNTS: [usize; 11] = [64, 96, 128, 192, 256, 384, MOST, 768, 1024, 1536, 2048];
/// The most samples where nothing bright is left to them.
const MOST: usize = 512;

/// A lens point, and the position inside the pixel at which its ray starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensSample {
    /// Lens point from which the ray appears to come in front of the focus, in units of the aperture's radius.
    pub in_front: [f64; 2],
    /// The same behind the focus: a different point if the lens is aberrated.
    pub behind: [f64; 2],
    /// The point at which the ray passes the opening itself; the second stop clips by this point.
    pub pupil: [f64; 2],
    /// Start of the ray relative to the pixel's centre: within half a pixel, but for [aberrations](super::aberrated).
    pub start: [f64; 2],
    /// Two numbers from 0 to 1 by which pixels decide between neighbouring [fields](super::aberrated::rays).
    pub pick: [f64; 2],
}

/// The number of samples that a disc of radius `r_px` needs. Some of what it is made of is so many times as bright as a
/// highlight begins to be: one of as many more samples changes a pixel by no more.
pub fn count_for(r_px: f64, brightness: f32) -> usize {
    let wanted = SAMPLES_PER_PIXEL * std::f64::consts::PI * r_px * r_px;
    let enough = COUNTS.iter().copied().find(|&n| n as f64 >= wanted);
    let enough = enough.unwrap_or(MOST).min(MOST);
    let most = f64::from(brightness) * enough as f64;
    COUNTS.iter().copied().rfind(|&n| n as f64 <= most).unwrap_or(enough)
}

/// Distance in pixels between the positions at which `n` samples draw a point of shift `t_px`. The opening has the
/// fraction `area` of the unit disc's area.
pub fn spacing_px(t_px: f64, area: f64, n: usize) -> f64 {
    t_px.abs() * (std::f64::consts::PI * area / n as f64).sqrt()
}

/// `n` samples, the same for every pixel.
///
/// Ray starts follow the additive recurrence of the plastic number, which fills the square evenly and has no relation
/// to the golden ratio of the lens points.
pub fn lens_samples(aperture: &Aperture, n: usize) -> Vec<LensSample> {
    const PLASTIC: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let start = |i: usize| PLASTIC.map(|a| (0.5 + (i + 1) as f64 * a).fract() - 0.5);
    // Roots of two and three are related neither to each other nor to the plastic number and the golden ratio.
    let pick = |i: usize| [2.0f64.sqrt(), 3.0f64.sqrt()].map(|a| (0.5 + (i + 1) as f64 * a).fract());
    let in_front = aperture.lens_points(n, Side::InFront);
    let behind = if aperture.has_sides() { aperture.lens_points(n, Side::Behind) } else { in_front.clone() };
    let pupil = aperture.pupil_points(n);
    let sample = |i: usize| LensSample {
        in_front: in_front[i],
        behind: behind[i],
        pupil: pupil[i],
        start: start(i),
        pick: pick(i),
    };
    let mut samples: Vec<LensSample> = (0..n).map(sample).collect();
    // Neighbouring samples look up nearly the same cells. In sequence, these are still in the first-level cache, so
    // samples are ordered to and fro along strips; there are about as many strips as samples in a strip.
    let strips = (n as f64).sqrt();
    let strip = |sample: &LensSample| ((0.5 + 0.5 * sample.in_front[1]) * strips) as usize;
    let along =
        |sample: &LensSample| if strip(sample) % 2 == 0 { sample.in_front[0] } else { -sample.in_front[0] };
    samples.sort_by(|a, b| strip(a).cmp(&strip(b)).then(along(a).total_cmp(&along(b))));
    samples
}
