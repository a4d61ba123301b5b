//! The picture at another size, which may differ between channels: lateral colour, and focus breathing.

use crate::carried::Carried;
use crate::mirror::mirrored;

/// The source pixels of a row or column of the output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// Four neighbours.
    pub places: [usize; 4],
    /// The weights of the neighbours.
    pub weights: [f32; 4],
}

/// What is interpolated by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// A cubic through four values, which keeps what is sharp.
    Cubic,
    /// Between two values: a linear map without negative weights.
    Linear,
}

impl Interpolation {
    /// That of a picture, or of the channels that it carries, which must all be the same linear map.
    pub fn of(carried: Option<&Carried>) -> Interpolation {
        carried.map_or(Interpolation::Cubic, |_| Interpolation::Linear)
    }
}

/// Catmull-Rom's cubic through four values, at `f` between the second and the third.
fn weights(f: f64) -> [f32; 4] {
    [
        f * (-0.5 + f * (1.0 - 0.5 * f)),
        1.0 + f * f * (-2.5 + 1.5 * f),
        f * (0.5 + f * (2.0 - 1.5 * f)),
        f * f * (-0.5 + 0.5 * f),
    ]
    .map(|w| w as f32)
}

/// The sources of `n` rows or columns under a magnification about `centre`.
pub fn sources(n: usize, centre: f64, magnification: f64, interpolation: Interpolation) -> Vec<Source> {
    (0..n)
        .map(|i| {
            let at = centre + (i as f64 - centre) / magnification;
            let first = at.floor();
            let place = |k: usize| mirrored(first as i64 + k as i64 - 1, n).0;
            let f = at - first;
            let weights = match interpolation {
                Interpolation::Cubic => weights(f),
                Interpolation::Linear => [0.0, (1.0 - f) as f32, f as f32, 0.0],
            };
            Source { places: std::array::from_fn(place), weights }
        })
        .collect()
}
