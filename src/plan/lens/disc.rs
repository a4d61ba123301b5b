//! Tiles that show one closed surface of nearly constant depth: the radii of the discs that they need.

use super::kernels;
use crate::picture::{Size, range};
use crate::scene::grid::TILE;
use std::ops::RangeInclusive;

/// On a tilted surface a pixel's disc is interpolated between two discs, this many radius steps apart: a quarter of a
/// pixel, or a sixteenth for small ones. Only rims differ, by less than the rounding to a single step would cost.
pub const APART: i32 = 4;

/// Columns and rows of the frame in the tile at `origin`.
pub fn extent(size: Size, origin: (usize, usize)) -> (usize, usize) {
    (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1))
}

/// The position of a shift relative to infinity on the scale of the discs between which pixels are interpolated.
#[inline(always)]
pub fn position(s: f32, s_focus: f64) -> f64 {
    position_of(f64::from(s) - s_focus)
}

/// The position of a shift on that scale.
#[inline(always)]
pub fn position_of(t: f64) -> f64 {
    kernels::position(t) / f64::from(APART)
}

/// By how much the position rises with each pixel of shift.
pub fn position_slope(t: f64) -> f64 {
    kernels::steps_per_px(t) / f64::from(APART)
}

/// The share of the disc at a step in the picture of a pixel at a position.
#[inline(always)]
pub fn share(position: f64, step: i32) -> f32 {
    (1.0 - (position - f64::from(step)).abs()).max(0.0) as f32
}

/// By how much the share of the disc at a step rises with each step of the position, of which `last` is the greatest. Where
/// discs meet, it is that between this one and the next.
#[inline(always)]
pub fn share_slope(position: f64, step: i32, last: i32) -> f32 {
    match step - (position.floor() as i32).min(last - 1) {
        0 => -1.0,
        1 => 1.0,
        _ => 0.0,
    }
}

/// The shifts of which the discs tell how that of a surface of one depth grows: an eighth of a pixel nearer and farther. Of
/// what a disc leaves of a sinusoid of `w` radians a pixel, this difference is off by `w^2 / 384` of its slope: by less than a
/// percent up to half a cycle a pixel.
pub fn beside(s: f32) -> [f32; 2] {
    [s - 0.125, s + 0.125]
}

/// The discs between which these positions lie.
pub fn range_of(positions: impl Iterator<Item = f64>) -> RangeInclusive<i32> {
    let (least, greatest) =
        positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    least.floor() as i32..=greatest.ceil() as i32
}

/// The surface that a tile shows.
pub enum Surface {
    /// The whole surface has this shift relative to infinity.
    Level(f32),
    /// The discs between which its pixels lie, in steps of [`APART`].
    Tilted(RangeInclusive<i32>),
}

impl Surface {
    /// The surface of the tile at `origin`.
    pub fn new(s: &[f32], size: Size, s_focus: f64, origin: (usize, usize)) -> Surface {
        let extent = extent(size, origin);
        let rows = (origin.1..origin.1 + extent.1).map(|y| &s[y * size.width + origin.0..][..extent.0]);
        let (least, greatest) = rows.fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), row| {
            let [least, greatest] = range(row);
            (lo.min(least), hi.max(greatest))
        });
        if least == greatest {
            return Surface::Level(least);
        }
        // The position rises with the shift, so the extremes of the shift give those of the position.
        Surface::Tilted(range_of([least, greatest].into_iter().map(|s| position(s, s_focus))))
    }

    /// The radius steps that it needs.
    pub fn keys(&self) -> impl Iterator<Item = i32> + use<> {
        let steps = match self {
            Surface::Level(_) => 0..0,
            Surface::Tilted(steps) => *steps.start()..*steps.end() + 1,
        };
        steps.map(|step| step * APART)
    }

    /// The shift of the whole surface, if it is constant.
    pub fn level(&self) -> Option<f32> {
        match self {
            Surface::Level(s) => Some(*s),
            Surface::Tilted(_) => None,
        }
    }
}
