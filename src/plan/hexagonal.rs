//! Blur in the shape of a hexagon (or a square), by blurs along its sides in two passes.
//!
//! After "A depth of field implementation" (a blog article of September 2013, which describes the technique of "Need
//! for Speed: The Run"). Three rhombi that meet in the centre make a hexagon, and a rhombus is a blur along one of
//! its sides followed by a blur along the other. The first pass writes two targets. The second pass blurs and adds
//! them, and divides the sum of the three equally bright rhombi by three:
//!
//! ```text
//! target 1 = A              target 2 = A + B              (blurs of the picture along a and b)
//! hexagon  = (blur of target 1 along b + blur of target 2 along c) / 3 = (A b + A c + B c) / 3
//! ```
//!
//! The size is that of each pixel's own circle of confusion, by scatter as gather: a look-up counts if the circle of
//! confusion of the pixel that is read reaches the pixel that is shaded. As the article's comments say, light in front
//! of the focus spreads over everything. Light behind the focus spreads only over pixels that are behind it too, and
//! only if its circle of confusion is no more than twice theirs. The first pass passes on the largest circle of
//! confusion of the near light that it gathered, so that the second pass can find that light.
//!
//! Where the article leaves a choice: light in front is kept separate as colour times coverage, spread evenly over
//! its line and composited over the rest, so that it fades out. The colour behind its silhouette is the mean of
//! everything that is not in front, over the pixel's own hexagon.

use crate::aperture::Aperture;
use crate::error::{Result, value_error};

/// Number of corners of the shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    Square,
    Hexagon,
}

/// The choices of the caller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    shape: Shape,
    /// Direction of the first corner in radians, counter-clockwise on screen from the x axis.
    first_angle: f64,
    /// The limit of the radius of circles of confusion, in pixels.
    pub max_coc_px: f64,
}

impl Settings {
    /// The default limit of the radius of circles of confusion.
    pub const MAX_COC_PX: f64 = 64.0;
    /// The article's hexagon: a corner straight up.
    const UPRIGHT: f64 = std::f64::consts::FRAC_PI_2;

    /// The shape is a clear opening of four or six blades, or the article's upright hexagon if none is given. The
    /// radius limits circles of confusion.
    pub fn new(aperture: Option<&Aperture>, max_coc_px: f64) -> Result<Settings> {
        if !(max_coc_px.is_finite() && (1.0..=256.0).contains(&max_coc_px)) {
            return Err(value_error!(
                "max_coc_px must be a radius in pixels from 1 to 256; got {max_coc_px}"
            ));
        }
        let (shape, first_angle) = match aperture.map(|a| (a.polygon(), a.is_clear())) {
            None => (Shape::Hexagon, Settings::UPRIGHT),
            Some((Some((4, angle)), true)) => (Shape::Square, angle),
            Some((Some((6, angle)), true)) => (Shape::Hexagon, angle),
            Some(_) => {
                return Err(value_error!(
                    "aperture: method=\"hexagonal\" draws clear openings of 4 or 6 blades; got another one. \
                     Leave it out for a hexagon with a corner straight up"
                ));
            }
        };
        Ok(Settings { shape, first_angle, max_coc_px })
    }
}

/// One look-up along a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tap {
    /// Columns to the right of the shaded pixel.
    pub dx: i32,
    /// Rows below the shaded pixel.
    pub dy: i32,
    /// The part of the step that this pixel represents: a line passes between two pixels.
    pub share: f32,
    /// Radius of the circle of confusion that just reaches the beginning of the step.
    pub from_px: f32,
    /// How much larger the radius is of a circle of confusion that just reaches the end of the step.
    pub step_px: f32,
}

/// The look-ups along a line, starting at its pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// The look-ups, in the order of their steps.
    pub taps: Vec<Tap>,
    /// Number of look-ups per step.
    per_step: usize,
    /// One over the radius whose line is as long as one step.
    steps_per_px: f32,
}

impl Line {
    /// The look-ups that circles of confusion of all radii from `least` to `most` reach completely, and then those
    /// that only some of them reach.
    #[inline(always)]
    pub fn split(&self, least_px: f32, most_px: f32) -> (&[Tap], &[Tap]) {
        let reached = self.up_to(most_px, |tap| tap.from_px < most_px);
        let passed = self.up_to(least_px, |tap| tap.from_px + tap.step_px <= least_px);
        self.taps[..reached].split_at(passed.min(reached))
    }

    /// The number of look-ups within a radius; `within` tests one look-up.
    ///
    /// All steps have the same length, so the number is known to within a step. A binary search for it would take a
    /// quarter of the whole time.
    #[inline(always)]
    fn up_to(&self, radius_px: f32, within: impl Fn(&Tap) -> bool) -> usize {
        let steps = (radius_px * self.steps_per_px + 0.5) as usize;
        let mut count = steps.saturating_mul(self.per_step).min(self.taps.len());
        while count < self.taps.len() && within(&self.taps[count]) {
            count += 1;
        }
        while count > 0 && !within(&self.taps[count - 1]) {
            count -= 1;
        }
        count
    }
}

/// The lines from which a target of the first pass is gathered, and those along which the second pass spreads it.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// Lines of the picture that are added to the previous target.
    pub gathered: Vec<Line>,
    /// Lines along which the second pass blurs this target.
    pub spread: Vec<Line>,
}

/// Number of pixels that are read to the left, to the right, above and below.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Margin {
    /// Columns.
    pub left: usize,
    /// Columns.
    pub right: usize,
    /// Rows.
    pub above: usize,
    /// Rows.
    pub below: usize,
}

/// The two passes.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The targets.
    pub targets: Vec<Target>,
    /// One over the number of parallelograms in the sum.
    pub scale: f32,
}

impl Plan {
    /// The passes for circles of confusion with a radius of up to `reach_px`.
    pub fn new(settings: &Settings, reach_px: f64) -> Plan {
        let turn = std::f64::consts::TAU;
        let line = |turns: f64, length: f64| line(settings.first_angle + turns * turn, length, reach_px);
        let targets = match settings.shape {
            // The sides are as long as the circumradius and point to every other corner.
            Shape::Hexagon => {
                let [a, b, c] = [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|turns| line(turns, 1.0));
                vec![
                    Target { gathered: vec![a], spread: vec![b.clone()] },
                    Target { gathered: vec![b], spread: vec![c] },
                ]
            }
            // Four squares that meet in the centre; their sides are half as long as those of the whole square.
            Shape::Square => {
                let half_side = std::f64::consts::FRAC_1_SQRT_2;
                let [a, b, c, d] = [0.125, 0.375, 0.625, 0.875].map(|turns| line(turns, half_side));
                vec![Target { gathered: vec![a, c], spread: vec![b, d] }]
            }
        };
        let (mut gathered, mut parallelograms) = (0, 0);
        for target in &targets {
            gathered += target.gathered.len();
            parallelograms += gathered * target.spread.len();
        }
        Plan { targets, scale: 1.0 / parallelograms as f32 }
    }

    /// The margins that the second pass reads around a pixel, and that both passes together read.
    pub fn margins(&self) -> (Margin, Margin) {
        let of = |lines: fn(&Target) -> &Vec<Line>| {
            let taps = || self.targets.iter().flat_map(lines).flat_map(|line| &line.taps);
            let most = |value: fn(&Tap) -> i32| taps().map(value).max().unwrap_or(0).max(0) as usize;
            Margin {
                left: most(|t| -t.dx),
                right: most(|t| t.dx),
                above: most(|t| -t.dy),
                below: most(|t| t.dy),
            }
        };
        let (first, second) = (of(|t| &t.gathered), of(|t| &t.spread));
        let both = Margin {
            left: first.left + second.left,
            right: first.right + second.right,
            above: first.above + second.above,
            below: first.below + second.below,
        };
        (second, both)
    }
}

/// The look-ups that spread light along `angle`, as far as `length` times the radius of its circle of confusion.
///
/// Light that spreads along the line comes from the opposite direction. Steps are one pixel long along the axis
/// nearer to the line, so that they meet pixel centres. Across the line, the brush is one pixel wide (two bilinear
/// look-ups, half a pixel to either side); without it, the crossing lines of both passes leave a weave of a tenth of
/// the light. Step `k` represents the part of the line within half a step of it, so that the light of a line sums to
/// one for any length.
fn line(angle: f64, length: f64, reach_px: f64) -> Line {
    let step = [-angle.cos(), angle.sin()];
    let major = usize::from(step[1].abs() > step[0].abs());
    let minor = 1 - major;
    let slope = step[minor] / step[major].abs();
    let direction = step[major].signum() as i32;
    // The radius whose line is as long as one step.
    let radius_of_step = 1.0 / (step[major].abs() * length);
    let mut taps = Vec::new();
    let mut add = |k: f64, across: f64, share: f64, part: [f64; 2]| {
        let mut d = [0; 2];
        d[major] = direction * k as i32;
        d[minor] = across as i32;
        let [from_px, step_px] = [part[0], part[1] - part[0]].map(|steps| (steps * radius_of_step) as f32);
        taps.push(Tap { dx: d[0], dy: d[1], share: share as f32, from_px, step_px });
    };
    let along_axis = slope.abs() < ALONG_AXIS;
    for k in 0..=(reach_px / radius_of_step + 0.5) as usize {
        let k = k as f64;
        let part = [(k - 0.5).max(0.0), k + 0.5];
        if along_axis {
            add(k, 0.0, 1.0, part);
        } else if k == 0.0 {
            // The brush widens with the radius, so that pixels in focus do not change.
            add(k, 0.0, 1.0, [0.0, 0.25]);
            add(k, -1.0, 0.5, [0.25, 0.5]);
            add(k, 1.0, 0.5, [0.25, 0.5]);
        } else {
            let place = k * slope - 0.5;
            let fraction = place - place.floor();
            for (i, share) in [0.5 - 0.5 * fraction, 0.5, 0.5 * fraction].into_iter().enumerate() {
                add(k, place.floor() + i as f64, share, part);
            }
        }
    }
    let per_step = if along_axis { 1 } else { 3 };
    Line { taps, per_step, steps_per_px: (1.0 / radius_of_step) as f32 }
}

/// Slope, in pixels across per pixel along, below which a line is taken to be parallel to an axis and to pass through
/// pixel centres.
const ALONG_AXIS: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(blades: u32, rotation: f64, reach_px: f64) -> Plan {
        let aperture = Aperture::new(blades, rotation, None).unwrap();
        Plan::new(&Settings::new(Some(&aperture), 64.0).unwrap(), reach_px)
    }

    #[test]
    fn the_light_of_a_line_sums_to_one_whatever_its_length() {
        for (blades, rotation) in [(6, 0.0), (6, 17.0), (6, 90.0), (4, 45.0), (4, 10.0)] {
            let plan = plan(blades, rotation, 20.0);
            for line in plan.targets.iter().flat_map(|t| t.gathered.iter().chain(&t.spread)) {
                for radius in [0.2f32, 1.0, 3.3, 19.9] {
                    let part = |t: &Tap| t.share * (radius - t.from_px).clamp(0.0, t.step_px);
                    let sum: f32 = line.taps.iter().map(part).sum();
                    assert!((sum / radius - 1.0).abs() < 1e-5, "{blades} {rotation} {radius}: {sum}");
                }
            }
        }
    }

    #[test]
    fn a_line_is_split_where_its_steps_say() {
        for (blades, rotation) in [(6, 17.0), (6, 90.0), (4, 45.0)] {
            for line in plan(blades, rotation, 20.0).targets.iter().flat_map(|t| &t.gathered) {
                for (least, most) in (0..=84).map(|i| i as f32 * 0.25).map(|px| (0.7 * px, px)) {
                    let reached: Vec<Tap> = line.taps.iter().copied().filter(|t| t.from_px < most).collect();
                    let passed = reached.iter().filter(|t| t.from_px + t.step_px <= least).count();
                    assert_eq!(line.split(least, most), reached.split_at(passed), "{blades} {least} {most}");
                }
                assert_eq!(line.split(f32::INFINITY, 0.0), (&[][..], &[][..]));
            }
        }
    }

    #[test]
    fn a_hexagon_is_three_rhombi_and_a_square_four() {
        assert_eq!(plan(6, 0.0, 8.0).scale, 1.0 / 3.0);
        assert_eq!(plan(4, 0.0, 8.0).scale, 0.25);
    }

    #[test]
    fn light_that_spreads_upwards_comes_from_below() {
        let up = &plan(6, 90.0, 8.0).targets[0].gathered[0].taps;
        assert!(up.iter().all(|t| t.dx == 0 && t.share == 1.0));
        assert_eq!(up.iter().map(|t| t.dy).collect::<Vec<_>>(), (0..=8).collect::<Vec<_>>());
    }

    #[test]
    fn other_openings_are_refused() {
        for aperture in
            [Aperture::DISC, Aperture::new(5, 0.0, None).unwrap(), Aperture::new(6, 0.0, Some(0.3)).unwrap()]
        {
            let text = Settings::new(Some(&aperture), 8.0).unwrap_err().to_string();
            assert!(text.starts_with("aperture"), "{text}");
        }
        for px in [0.0, f64::NAN, 1e3] {
            assert!(Settings::new(None, px).unwrap_err().to_string().starts_with("max_coc_px"));
        }
    }
}
