//! Taps scattered over each pixel's own circle of confusion.
//!
//! After the first half of Riguer, Tatarchuk and Isidoro, "Real-Time Depth of Field Simulation", ShaderX2. A pixel's
//! blurriness is the diameter of its circle of confusion over the largest one allowed, at most 1. The picture is
//! averaged over the pixel itself and over taps in a Poisson-disc pattern, scaled to the circle of confusion of the
//! pixel's blurriness. A sharp surface in front must not leak onto a blurred surface behind it, so a tap in front of
//! the pixel is weighted by its own blurriness.
//!
//! The article prints the circle of confusion with the distances of object and focus exchanged; here it is that of
//! [`optics`](crate::optics). Its text discards samples *in front*, but its listing discards all that are not
//! farther. The text is followed, so that a plane facing the camera is blurred like any other. Disparity takes the
//! place of depth, so that an infinite background can be interpolated. As with a real lens, the pattern is turned by
//! 180 degrees behind the focus plane.
//!
//! Its section on bokeh changes the distribution and the weights of the taps.

use crate::aperture::{Aperture, Side};
use crate::error::{Result, value_error};
use crate::optics::Optics;

/// The article's twelve outer taps, in units of the circle's radius.
pub const TWELVE: [[f64; 2]; 12] = [
    [-0.326212, -0.40581],
    [-0.840144, -0.07358],
    [-0.695914, 0.457137],
    [-0.203345, 0.620716],
    [0.96234, -0.194983],
    [0.473434, -0.480026],
    [0.519456, 0.767022],
    [0.185461, -0.893124],
    [0.507431, 0.064425],
    [0.89642, 0.412458],
    [-0.32194, -0.932615],
    [-0.791559, -0.59771],
];

/// The largest number of outer taps.
pub const MAX_TAPS: usize = 128;
/// The largest radius of the circle of confusion that may be requested, in pixels.
const MAX_COC_PX: f64 = 512.0;
/// Standard deviation of the Gaussian that weighs taps, as a fraction of the distance from the centre to the rim.
const BELL: f64 = 0.5;

/// The distribution of light within a blurred point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bokeh {
    /// Evenly.
    Uniform,
    /// Only on the rim.
    Ring,
    /// More towards the centre.
    Gaussian,
    /// More towards the rim.
    Inverse,
}

impl Bokeh {
    /// Every bokeh with the name users give it.
    pub const NAMES: [(&'static str, Bokeh); 4] = [
        ("uniform", Bokeh::Uniform),
        ("ring", Bokeh::Ring),
        ("gaussian", Bokeh::Gaussian),
        ("inverse", Bokeh::Inverse),
    ];

    /// Weight of a tap at the fraction `rho` of the distance from the centre to the rim.
    fn weight(self, rho: f64) -> f64 {
        let bell = (-0.5 * (rho / BELL).powi(2)).exp();
        match self {
            Bokeh::Uniform => 1.0,
            Bokeh::Ring => f64::from(rho > 0.0),
            Bokeh::Gaussian => bell,
            Bokeh::Inverse => 1.0 - bell,
        }
    }
}

/// The weight of taps in front of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LeakTest {
    /// They are weighted by their own blurriness.
    On = 0,
    /// They are weighted like all other taps.
    Off = 1,
}

impl LeakTest {
    /// Both with the names users give them.
    pub const NAMES: [(&'static str, LeakTest); 2] = [("on", LeakTest::On), ("off", LeakTest::Off)];
}

/// An outer tap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tap {
    /// Columns to the right, in units of the radius of the circle of confusion.
    pub x: f32,
    /// Rows down, in the same units.
    pub y: f32,
    /// Weight, relative to that of the other taps.
    pub weight: f32,
}

impl Tap {
    fn new([x, y]: [f64; 2], weight: f64) -> Tap {
        Tap { x: x as f32, y: y as f32, weight: weight as f32 }
    }
}

/// The outer taps and the weight of the pixel itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    taps: Vec<Tap>,
    centre: f32,
}

impl Pattern {
    /// `n` outer taps over the opening. They are the article's own if `n` and the opening are the article's, and
    /// generated otherwise.
    pub fn over(aperture: &Aperture, n: usize, bokeh: Bokeh) -> Result<Pattern> {
        check_count(n)?;
        let places = match bokeh {
            Bokeh::Ring => (0..n).map(|i| aperture.rim((i as f64 + 0.5) / n as f64)).collect(),
            _ if n == TWELVE.len() && aperture.is_round() => TWELVE.to_vec(),
            _ => scattered(aperture, n),
        };
        let weight = |l| aperture.transmission(l) * bokeh.weight(aperture.rim_fraction(l));
        let taps = places.into_iter().map(|l| Tap::new(l, weight(l))).collect();
        Ok(Pattern { taps, centre: weight([0.0, 0.0]) as f32 })
    }

    /// Taps given by the caller: columns to the right and rows down in units of the radius, and weights relative to
    /// the weight 1 of the pixel itself.
    pub fn of(taps: &[[f64; 3]]) -> Result<Pattern> {
        check_count(taps.len())?;
        if let Some(tap) = taps.iter().find(|t| !t.iter().all(|v| v.is_finite()) || t[0].hypot(t[1]) > 1.0) {
            return Err(value_error!(
                "taps must lie within 1 of the centre, in units of the radius; got ({}, {})",
                tap[0],
                tap[1]
            ));
        }
        if let Some(tap) = taps.iter().find(|t| t[2] < 0.0) {
            return Err(value_error!("taps must have weights that are not negative; got {}", tap[2]));
        }
        Ok(Pattern { taps: taps.iter().map(|t| Tap::new([t[0], t[1]], t[2])).collect(), centre: 1.0 })
    }
}

fn check_count(n: usize) -> Result<()> {
    if (1..=MAX_TAPS).contains(&n) {
        Ok(())
    } else {
        Err(value_error!("taps must be from 1 to {MAX_TAPS}; got {n}"))
    }
}

/// `n` points that keep away from one another and from the centre; the same points each time.
fn scattered(aperture: &Aperture, n: usize) -> Vec<[f64; 2]> {
    const CANDIDATES: usize = 1024;
    const RELAXATIONS: usize = 4;
    // Points spread evenly over the opening, where the light goes.
    let candidates = aperture.lens_points(CANDIDATES, Side::Behind);
    let squared = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);

    // Each point is the best of many candidates: the one farthest from all previous points. A simple sequence picks
    // the candidates, so that their own order does not show.
    let mut sites = vec![[0.0, 0.0]];
    let mut distance: Vec<f64> = candidates.iter().map(|c| squared(c, &sites[0])).collect();
    let mut state = 1u32;
    while sites.len() <= n {
        let tried = (0..CANDIDATES / 16).map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as usize % CANDIDATES
        });
        let best = tried.max_by(|&a, &b| distance[a].total_cmp(&distance[b])).unwrap_or(0);
        sites.push(candidates[best]);
        for (distance, candidate) in distance.iter_mut().zip(&candidates) {
            *distance = distance.min(squared(candidate, &candidates[best]));
        }
    }

    // Then every point but the centre moves to the mean of the candidates nearest to it, so that all points represent
    // equal areas.
    for _ in 0..RELAXATIONS {
        let mut sums = vec![[0.0; 3]; sites.len()];
        for c in &candidates {
            let near = |a: &usize, b: &usize| squared(c, &sites[*a]).total_cmp(&squared(c, &sites[*b]));
            let sum = &mut sums[(0..sites.len()).min_by(near).unwrap_or(0)];
            *sum = [sum[0] + c[0], sum[1] + c[1], sum[2] + 1.0];
        }
        for (site, [x, y, count]) in sites.iter_mut().zip(sums).skip(1) {
            if count > 0.0 {
                *site = [x / count, y / count];
            }
        }
    }
    sites.split_off(1)
}

/// The choices of the caller.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    pattern: Pattern,
    max_radius_px: f64,
    leak_test: LeakTest,
}

impl Settings {
    /// The default limit of the radius: more would need more than twelve taps. The article gives the diameter, 10
    /// pixels.
    pub const MAX_COC_PX: f64 = 5.0;

    /// The taps, the limit of the radius of circles of confusion in pixels, and the weight of taps in front.
    pub fn new(pattern: Pattern, max_coc_px: f64, leak_test: LeakTest) -> Result<Settings> {
        if !(max_coc_px > 0.0 && max_coc_px <= MAX_COC_PX) {
            return Err(value_error!(
                "max_coc_px must be a radius in pixels, greater than 0 and at most {MAX_COC_PX}; got {max_coc_px}"
            ));
        }
        Ok(Settings { pattern, max_radius_px: max_coc_px, leak_test })
    }
}

/// The computation for every pixel: `centre + sum of contribution * (tap - centre) / sum of contributions`.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Outer taps.
    pub taps: Vec<Tap>,
    /// Contribution of the pixel itself.
    pub centre: f32,
    /// The largest error of an average through rounding, as a fraction of the pixel's own light: half of a last place in
    /// each of both sums for every tap, and in the difference, its product, the division and the sum with the pixel.
    pub rounding: f32,
    /// The weight of taps in front.
    pub leak_test: LeakTest,
    /// Number of pixels that are read on every side.
    pub margin: usize,
    optics: Optics,
    /// Circles of confusion are limited to this radius.
    pub max_radius_px: f64,
}

impl Plan {
    /// The plan for one lens.
    pub fn new(settings: &Settings, optics: &Optics) -> Plan {
        let Settings { pattern, max_radius_px, leak_test } = settings;
        Plan {
            taps: pattern.taps.clone(),
            centre: pattern.centre,
            rounding: (pattern.taps.len() + 2) as f32 * f32::EPSILON,
            leak_test: *leak_test,
            // A bilinear tap also reads the next pixel; one more pixel allows for rounding.
            margin: max_radius_px.ceil() as usize + 2,
            optics: *optics,
            max_radius_px: *max_radius_px,
        }
    }

    /// The scale of the pattern around a pixel of disparity `d`, in pixels. It is limited, and negative behind the
    /// focus plane.
    #[inline(always)]
    pub fn scale_px(&self, d: f32) -> f32 {
        self.optics.shift_px(f64::from(d)).clamp(-self.max_radius_px, self.max_radius_px) as f32
    }

    /// The average around a pixel of light `centre`, from the mean of its taps' differences from it.
    ///
    /// Around a bright pixel, dark taps have the mean of minus its own light, but for rounding. What that leaves below
    /// no light is none.
    #[inline(always)]
    pub fn average(&self, centre: f32, difference: f32) -> f32 {
        let average = centre + difference;
        if average < 0.0 && average >= -self.rounding * centre { 0.0 } else { average }
    }

    /// Blurriness of a surface of disparity `d`, 0 to 1.
    #[inline(always)]
    pub fn blurriness(&self, d: f32) -> f32 {
        (self.optics.shift_px(f64::from(d)).abs() / self.max_radius_px).min(1.0) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scattered_taps_keep_apart_and_fill_the_opening() {
        let hexagon = Aperture::new(6, 10.0, None).unwrap();
        for aperture in [Aperture::DISC, hexagon] {
            for n in [5, 12, 13, 24, 64, 128] {
                let places = scattered(&aperture, n);
                assert_eq!(places.len(), n);
                assert!(places.iter().all(|&l| aperture.rim_fraction(l) <= 1.0 + 1e-6));
                // Distance between neighbours in the densest packing of as many discs.
                let packed =
                    (2.0 * std::f64::consts::PI * aperture.relative_area() / 3f64.sqrt() / n as f64).sqrt();
                let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
                for (i, a) in places.iter().enumerate() {
                    let others = places[..i].iter().chain([&[0.0, 0.0]]);
                    let nearest = others.map(|b| distance(a, b)).fold(f64::INFINITY, f64::min);
                    assert!(nearest > 0.5 * packed, "{aperture:?} {n}: {nearest} against {packed}");
                }
                for axis in 0..2 {
                    let mean = places.iter().map(|l| l[axis]).sum::<f64>() / n as f64;
                    assert!(mean.abs() < 0.06, "{aperture:?} {n}: mean {mean}");
                }
            }
        }
    }

    #[test]
    fn twelve_taps_over_a_disc_are_the_articles() {
        let pattern = Pattern::over(&Aperture::DISC, 12, Bokeh::Uniform).unwrap();
        assert_eq!(pattern.taps[4], Tap { x: 0.96234, y: -0.194983, weight: 1.0 });
        let pentagon = Aperture::new(5, 0.0, None).unwrap();
        assert_ne!(Pattern::over(&pentagon, 12, Bokeh::Uniform).unwrap().taps, pattern.taps);
    }

    #[test]
    fn bokeh_moves_weight_outwards_or_inwards() {
        // The mean distance of the weight from the centre.
        let mean = |bokeh| {
            let Pattern { taps, centre } = Pattern::over(&Aperture::DISC, 64, bokeh).unwrap();
            let at = |t: &Tap| f64::from(t.weight) * f64::from(t.x).hypot(f64::from(t.y));
            let total: f64 = taps.iter().map(|t| f64::from(t.weight)).sum::<f64>() + f64::from(centre);
            taps.iter().map(at).sum::<f64>() / total
        };
        let [uniform, ring, gaussian, inverse] = Bokeh::NAMES.map(|(_, bokeh)| mean(bokeh));
        assert!((uniform - 2.0 / 3.0).abs() < 0.04 && (ring - 1.0).abs() < 1e-6, "{uniform} {ring}");
        assert!(gaussian < uniform - 0.1 && inverse > uniform + 0.05, "{gaussian} {inverse}");
    }

    #[test]
    fn blurriness_is_the_circle_over_the_largest() {
        let pattern = Pattern::of(&[[1.0, 0.0, 1.0]]).unwrap();
        let settings = Settings::new(pattern, 4.0, LeakTest::On).unwrap();
        let plan = Plan::new(&settings, &Optics { k: 4.0, d_focus: 1.0 });
        assert_eq!([1.0, 1.5, 0.5, 3.0, -3.0].map(|d| plan.blurriness(d)), [0.0, 0.5, 0.5, 1.0, 1.0]);
        assert_eq!([1.0, 1.5, 0.5, 3.0, -3.0].map(|d| plan.scale_px(d)), [0.0, 2.0, -2.0, 4.0, -4.0]);
    }

    #[test]
    fn bad_values_are_named() {
        let one = || Pattern::of(&[[0.5, 0.0, 1.0]]).unwrap();
        for (text, start) in [
            (
                Pattern::over(&Aperture::DISC, 129, Bokeh::Uniform).unwrap_err(),
                "taps must be from 1 to 128; got 129",
            ),
            (Pattern::of(&[]).unwrap_err(), "taps must be from 1 to 128; got 0"),
            (Pattern::of(&[[0.9, 0.9, 1.0]]).unwrap_err(), "taps must lie within 1"),
            (Pattern::of(&[[f64::NAN, 0.0, 1.0]]).unwrap_err(), "taps must lie within 1"),
            (Pattern::of(&[[0.0, 0.0, -1.0]]).unwrap_err(), "taps must have weights"),
            (Settings::new(one(), 0.0, LeakTest::On).unwrap_err(), "max_coc_px must be"),
            (Settings::new(one(), f64::NAN, LeakTest::On).unwrap_err(), "max_coc_px must be"),
        ] {
            assert!(text.to_string().starts_with(start), "{text}");
        }
    }
}
