//! A single pass of a few look-ups at fixed offsets around each pixel.
//!
//! After the "DepthOfField Sample" of Microsoft's DirectX SDK. Every pixel has a blur factor: its distance from the
//! focus plane times a factor, squared, and limited to 0.75 so that the centre always counts. A look-up is mixed with
//! the centre's colour by the product of both blur factors, so a sharp neighbour adds nothing to a blurred pixel.
//! Mixing by the centre's factor alone lets it in, which shows as a ring around sharp surfaces.
//!
//! The text fixes the number of look-ups, and the hexagons by their radii of one pixel and of two with nearly equal
//! spacing; the outer hexagon is therefore rotated by half a step here. The text leaves open the positions of the six
//! and of the four look-ups, except for the centre; here they are on a regular polygon of radius one pixel.

use crate::error::{Result, value_error};
use crate::optics::{Defocus, Measure, Optics};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The largest blur factor.
pub const MAX_BLUR: f64 = 0.75;

/// The number of look-ups, and how they are mixed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variant {
    /// The centre and two hexagons.
    Thirteen,
    /// The centre and the inner hexagon.
    Seven,
    /// The centre and a pentagon.
    Six,
    /// The centre and a triangle.
    Four,
    /// The centre and a triangle, mixed by the centre's blur factor alone.
    FourRings,
}

impl Variant {
    /// Every variant with the name users give it.
    pub const NAMES: [(&'static str, Variant); 5] = [
        ("thirteen", Variant::Thirteen),
        ("seven", Variant::Seven),
        ("six", Variant::Six),
        ("four", Variant::Four),
        ("four_rings", Variant::FourRings),
    ];

    /// Offsets of the look-ups from the centre, in pixels, without the centre itself.
    fn offsets_px(self) -> Vec<[f64; 2]> {
        // The corners of a polygon in order, the first one straight up.
        let polygon = |corners: usize, radius: f64, turn: f64| {
            (0..corners).map(move |i| {
                let angle = FRAC_PI_2 + turn + TAU * i as f64 / corners as f64;
                [radius * angle.cos(), -radius * angle.sin()]
            })
        };
        match self {
            Variant::Thirteen => polygon(6, 1.0, 0.0).chain(polygon(6, 2.0, PI / 6.0)).collect(),
            Variant::Seven => polygon(6, 1.0, 0.0).collect(),
            Variant::Six => polygon(5, 1.0, 0.0).collect(),
            Variant::Four | Variant::FourRings => polygon(3, 1.0, 0.0).collect(),
        }
    }

    /// Distance of the farthest look-up from the centre.
    fn reach_px(self) -> f64 {
        if self == Variant::Thirteen { 2.0 } else { 1.0 }
    }
}

/// The quantity whose square is the blur factor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Blur {
    /// The radius of the circle of confusion, divided by the distance of the farthest look-up.
    CircleOfConfusion,
    /// The distance from the focus plane times this factor, per metre.
    Hyperfocal(f64),
}

/// The choices of the caller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    variant: Variant,
    blur: Blur,
}

impl Settings {
    /// The look-ups, and the factor per metre that turns a distance from the focus plane into a blur factor. Without
    /// it, the circle of confusion of the lens decides.
    pub fn new(variant: Variant, hyperfocal_factor: Option<f64>) -> Result<Settings> {
        if let Some(factor) = hyperfocal_factor
            && !(factor.is_finite() && factor >= 0.0)
        {
            return Err(value_error!(
                "hyperfocal_factor must be a factor per metre, finite and not negative; got {factor}"
            ));
        }
        let blur = hyperfocal_factor.map_or(Blur::CircleOfConfusion, Blur::Hyperfocal);
        Ok(Settings { variant, blur })
    }

    /// The option that is in metres, if it is used.
    pub fn metric_option(&self) -> Option<&'static str> {
        matches!(self.blur, Blur::Hyperfocal(_)).then_some("hyperfocal_factor")
    }
}

/// The factor by which a look-up is mixed with the centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mix {
    /// The product of both blur factors.
    Both = 0,
    /// The centre's blur factor.
    Centre = 1,
}

/// One look-up: the pixels it reads, as offsets from the centre with their weights, which sum to one.
#[derive(Debug, Clone, PartialEq)]
pub struct Tap {
    /// Columns to the right, rows down, weight.
    pub pixels: Vec<(i32, i32, f32)>,
}

impl Tap {
    /// The bilinear look-up at an offset in pixels.
    fn bilinear([x, y]: [f64; 2]) -> Tap {
        let (left, top) = (x.floor(), y.floor());
        let (right, down) = (x - left, y - top);
        let corner = |i: i32, j: i32| {
            let along = |step: i32, fraction: f64| if step == 0 { 1.0 - fraction } else { fraction };
            (left as i32 + i, top as i32 + j, (along(i, right) * along(j, down)) as f32)
        };
        let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        // A look-up at the centre of a pixel, or between two pixels, needs only those.
        Tap { pixels: corners.into_iter().filter(|(_, _, weight)| *weight > 1e-6).collect() }
    }
}

/// The computation for every pixel: `centre + share * sum of weight * (tap - centre)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Look-ups without the centre.
    pub taps: Vec<Tap>,
    /// The factor that weighs them.
    pub mix: Mix,
    /// One over the number of look-ups, including the centre.
    pub share: f32,
    /// Number of pixels that are read on every side.
    pub margin: usize,
    blur: Blur,
    reach_px: f64,
    optics: Optics,
}

impl Plan {
    /// The plan for one lens.
    pub fn new(settings: &Settings, optics: &Optics) -> Plan {
        let taps: Vec<Tap> = settings.variant.offsets_px().into_iter().map(Tap::bilinear).collect();
        let reach_px = settings.variant.reach_px();
        Plan {
            share: 1.0 / (taps.len() + 1) as f32,
            mix: if settings.variant == Variant::FourRings { Mix::Centre } else { Mix::Both },
            margin: reach_px as usize + 1,
            taps,
            blur: settings.blur,
            reach_px,
            optics: *optics,
        }
    }

    /// The blur factor of a surface of disparity `d`.
    #[inline(always)]
    pub fn blur(&self, d: f32) -> f32 {
        let d = f64::from(d);
        let factor = match self.blur {
            Blur::CircleOfConfusion => self.optics.shift_px(d) / self.reach_px,
            Blur::Hyperfocal(per_m) if per_m > 0.0 => self.optics.beyond_focus_m(d) * per_m,
            Blur::Hyperfocal(_) => 0.0,
        };
        (factor * factor).min(MAX_BLUR) as f32
    }

    /// The signed quantity whose square, limited to [`MAX_BLUR`], is the blur factor.
    pub fn defocus(&self) -> Defocus {
        match self.blur {
            Blur::CircleOfConfusion => self.optics.defocus(Measure::Shift, 1.0 / self.reach_px),
            Blur::Hyperfocal(per_m) => self.optics.defocus(Measure::Distance, per_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn optics(k: f64) -> Optics {
        Optics { k, d_focus: 0.5 }
    }

    fn plan(variant: Variant, hyperfocal_factor: Option<f64>) -> Plan {
        Plan::new(&Settings::new(variant, hyperfocal_factor).unwrap(), &optics(8.0))
    }

    #[test]
    fn look_ups_are_as_many_as_the_name_says_and_average_to_the_centre() {
        for ((_, variant), n) in Variant::NAMES.into_iter().zip([13, 7, 6, 4, 4]) {
            let offsets = variant.offsets_px();
            assert_eq!(offsets.len() + 1, n);
            for axis in 0..2 {
                assert!(offsets.iter().map(|o| o[axis]).sum::<f64>().abs() < 1e-12, "{variant:?}");
            }
            for tap in plan(variant, None).taps {
                let moment = |f: fn(&(i32, i32, f32)) -> f32| tap.pixels.iter().map(f).sum::<f32>();
                assert!((moment(|p| p.2) - 1.0).abs() < 1e-6);
                assert!(tap.pixels.iter().all(|p| p.0.abs().max(p.1.abs()) as usize <= 3));
            }
        }
    }

    #[test]
    fn bilinear_look_ups_have_their_offset_as_mean() {
        for offset in [[0.0, -2.0], [0.866, 0.5], [-1.7, -0.25]] {
            let tap = Tap::bilinear(offset);
            let mean_x: f64 = tap.pixels.iter().map(|p| f64::from(p.0) * f64::from(p.2)).sum();
            let mean_y: f64 = tap.pixels.iter().map(|p| f64::from(p.1) * f64::from(p.2)).sum();
            assert!((mean_x - offset[0]).abs() < 1e-6 && (mean_y - offset[1]).abs() < 1e-6, "{tap:?}");
        }
        assert_eq!(Tap::bilinear([0.0, -2.0]).pixels, [(0, -2, 1.0)]);
    }

    #[test]
    fn blur_is_the_squared_product_and_capped() {
        let hyperfocal = plan(Variant::Thirteen, Some(0.3));
        assert_eq!(hyperfocal.blur(0.5), 0.0);
        // At 4 m, focused at 2 m.
        assert!((hyperfocal.blur(0.25) - 0.36).abs() < 1e-6);
        assert_eq!(hyperfocal.blur(0.0), 0.75);
        let lens = plan(Variant::Thirteen, None);
        // The radius of the circle of confusion is 1 px, and look-ups reach 2 px.
        assert!((lens.blur(0.5 + 0.125) - 0.25).abs() < 1e-6);
        assert_eq!(lens.blur(0.0), 0.75);
        assert_eq!(plan(Variant::Seven, Some(0.0)).blur(0.0), 0.0);
    }

    #[test]
    fn a_factor_that_is_none_is_named() {
        for factor in [-1.0, f64::NAN, f64::INFINITY] {
            let text = Settings::new(Variant::Six, Some(factor)).unwrap_err().to_string();
            assert!(text.starts_with("hyperfocal_factor") && text.ends_with(&factor.to_string()), "{text}");
        }
    }
}
