//! From the depth that users hold to the disparity that the optics need.

use crate::error::{Result, value_error};
use crate::memory;
use rayon::prelude::*;

/// How depth values are to be read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DepthKind {
    /// Planar distance in metres along the optical axis.
    Z,
    /// Distance in metres from the pinhole, along the ray.
    Distance,
    /// `1/z` in 1/m.
    InverseZ,
    /// Relative disparity, for lenses over relative disparity.
    Disparity,
    /// Post-projection depth in 0 (near) to 1 (far).
    ZBuffer {
        /// Near clip plane in metres.
        near: f64,
        /// Far clip plane in metres; may be infinite.
        far: f64,
    },
    /// Mitsuba's depth AOV: along the ray, from the near clip plane; 0 where nothing was hit.
    DistanceFromNear {
        /// Near clip plane in metres.
        near: f64,
    },
}

impl DepthKind {
    /// The disparity that value `v` stands for at a pixel whose ray is `ray_length` times as long as its `z`.
    ///
    /// `None` where the value is not a depth of this kind.
    fn disparity(self, v: f64, ray_length: f64) -> Option<f64> {
        let d = match self {
            DepthKind::Z => positive(v)?.recip(),
            DepthKind::Distance => ray_length / positive(v)?,
            DepthKind::InverseZ => not_negative(v)?,
            DepthKind::Disparity => v,
            // 1/z is affine in post-projection depth: 1/near at 0, 1/far at 1.
            DepthKind::ZBuffer { near, far } => {
                let v = (0.0..=1.0).contains(&v).then_some(v)?;
                (1.0 - v) / near + v / far
            }
            DepthKind::DistanceFromNear { .. } if v == 0.0 => 0.0,
            DepthKind::DistanceFromNear { near } => (not_negative(v)? / ray_length + near).recip(),
        };
        d.is_finite().then_some(d)
    }

    /// Whether the kind needs the direction of each pixel's ray.
    pub fn needs_rays(self) -> bool {
        matches!(self, DepthKind::Distance | DepthKind::DistanceFromNear { .. })
    }

    /// What a valid value looks like, for error texts.
    fn accepted(self) -> &'static str {
        match self {
            DepthKind::Z | DepthKind::Distance => "depths greater than 0 (infinity is background)",
            DepthKind::InverseZ => "inverse depths that are finite and not negative",
            DepthKind::Disparity => "finite disparities",
            DepthKind::ZBuffer { .. } => "values from 0 to 1",
            DepthKind::DistanceFromNear { .. } => "distances not negative (0 is background)",
        }
    }
}

fn positive(v: f64) -> Option<f64> {
    (v > 0.0).then_some(v)
}

fn not_negative(v: f64) -> Option<f64> {
    (v >= 0.0).then_some(v)
}

/// What to do with values that are no depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Invalid {
    /// Refuse the picture, naming how many there are and where the first is.
    Raise,
    /// Take them for background, infinitely far (for relative disparity: as far as the farthest pixel).
    Far,
}

/// Disparity of every pixel of a `width` wide frame.
///
/// `focal_px` is needed by the kinds measured along the ray; the optical axis meets the middle of the frame.
pub fn disparity_plane(
    depth: &[f32],
    (width, height): (usize, usize),
    kind: DepthKind,
    focal_px: Option<f64>,
    invalid: Invalid,
) -> Result<Vec<f32>> {
    if kind.needs_rays() && focal_px.is_none() {
        return Err(value_error!(
            "depth_kind: depth along the ray needs a lens with a field of view; a lens made by from_disparity \
             has none"
        ));
    }
    let ray_length = |x: usize, y: usize| {
        focal_px.filter(|_| kind.needs_rays()).map_or(1.0, |f| {
            let dx = (x as f64 + 0.5 - 0.5 * width as f64) / f;
            let dy = (y as f64 + 0.5 - 0.5 * height as f64) / f;
            (1.0 + dx * dx + dy * dy).sqrt()
        })
    };
    let mut out: Vec<f32> = memory::zeros(depth.len());
    let bad: usize = out
        .par_chunks_mut(width)
        .zip(depth.par_chunks(width))
        .enumerate()
        .map(|(y, (out, depth))| {
            let mut bad = 0;
            for (x, (out, &v)) in out.iter_mut().zip(depth).enumerate() {
                *out = match kind.disparity(f64::from(v), ray_length(x, y)) {
                    Some(d) if (d as f32).is_finite() => d as f32,
                    _ => {
                        bad += 1;
                        f32::NAN
                    }
                };
            }
            bad
        })
        .sum();
    if bad > 0 {
        match invalid {
            Invalid::Raise => {
                let first = out.iter().position(|d| d.is_nan()).unwrap_or(0);
                return Err(value_error!(
                    "depth has {bad} of {} values that are no depth; the first is {} at row {}, column {}. \
                     Accepted are {}; pass invalid=\"far\" to take them for background",
                    depth.len(),
                    depth[first],
                    first / width,
                    first % width,
                    kind.accepted()
                ));
            }
            Invalid::Far => {
                let far = match kind {
                    DepthKind::Disparity => out.iter().copied().fold(f32::INFINITY, f32::min),
                    _ => 0.0,
                };
                let far = if far.is_finite() { far } else { 0.0 };
                out.iter_mut().filter(|d| d.is_nan()).for_each(|d| *d = far);
            }
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(kind: DepthKind, v: f32) -> Result<f32> {
        disparity_plane(&[v], (1, 1), kind, Some(10.0), Invalid::Raise).map(|d| d[0])
    }

    #[test]
    fn every_kind_of_the_same_point_is_the_same_disparity() {
        let z = 2.5f32;
        let (near, far) = (0.5, 20.0);
        let z_buffer = (far / (far - near)) * (1.0 - near / f64::from(z));
        for (kind, v) in [
            (DepthKind::Z, z),
            (DepthKind::Distance, z),
            (DepthKind::InverseZ, 1.0 / z),
            (DepthKind::Disparity, 1.0 / z),
            (DepthKind::ZBuffer { near, far }, z_buffer as f32),
            (DepthKind::DistanceFromNear { near }, z - near as f32),
        ] {
            let d = one(kind, v).unwrap();
            assert!((d - 1.0 / z).abs() < 1e-6, "{kind:?}: {d}");
        }
    }

    #[test]
    fn infinity_is_background_and_nonsense_is_refused() {
        assert_eq!(one(DepthKind::Z, f32::INFINITY).unwrap(), 0.0);
        assert_eq!(one(DepthKind::DistanceFromNear { near: 0.1 }, 0.0).unwrap(), 0.0);
        for v in [0.0, -1.0, f32::NAN] {
            let text = one(DepthKind::Z, v).unwrap_err().to_string();
            assert!(text.contains("1 of 1") && text.contains("row 0, column 0"), "{text}");
        }
    }
}
