//! From the caller's depth to the disparity that the optics need.

use crate::error::{Result, value_error};
use crate::memory::Buffer;
use rayon::prelude::*;

/// The directions of the rays of a frame's pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rays {
    /// Focal length in pixels.
    pub focal_px: f64,
    /// The pixel on the optical axis.
    pub centre: [f64; 2],
}

impl Rays {
    /// Rays that are all parallel to the optical axis: along them, distance is `z`.
    pub const PARALLEL: Rays = Rays { focal_px: f64::INFINITY, centre: [0.0; 2] };

    /// The length of a pixel's ray relative to its `z`.
    fn length(&self, x: usize, y: usize) -> f64 {
        let dx = (x as f64 - self.centre[0]) / self.focal_px;
        let dy = (y as f64 - self.centre[1]) / self.focal_px;
        (1.0 + dx * dx + dy * dy).sqrt()
    }
}

/// The interpretation of depth values.
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
    /// Relative disparity of any scale, which is normalised to 0 (far) to 1 (near); see [`normalize`].
    Relative,
    /// The same, where `far` becomes 0 and `near` 1: one scale for all pictures of a sequence.
    RelativeBetween {
        /// The value that becomes 0.
        far: f64,
        /// The value that becomes 1.
        near: f64,
    },
    /// Post-projection depth, from `first` to 1. Either plane may be infinite, and either the nearer.
    ZBuffer {
        /// Distance in metres at the value `first`.
        near: f64,
        /// Distance in metres at the value 1.
        far: f64,
        /// 0, or -1 as in OpenGL's normalized device coordinates.
        first: f64,
    },
    /// Mitsuba's depth AOV: distance along the ray, from the near clip plane; 0 where nothing was hit.
    DistanceFromNear {
        /// Near clip plane in metres.
        near: f64,
    },
}

impl DepthKind {
    /// The disparity of value `v` at a pixel whose ray is `ray_length` times as long as its `z`.
    ///
    /// Not finite if the value is not a valid depth of this kind.
    #[inline(always)]
    fn disparity(self, v: f64, ray_length: f64) -> f64 {
        let valid = |valid: bool, d: f64| if valid { d } else { f64::NAN };
        match self {
            DepthKind::Z => valid(v > 0.0, v.recip()),
            DepthKind::Distance => valid(v > 0.0, ray_length / v),
            DepthKind::InverseZ => valid(v >= 0.0, v),
            DepthKind::Disparity | DepthKind::Relative => v,
            DepthKind::RelativeBetween { far, near } => (v - far) / (near - far),
            // 1/z is affine in post-projection depth: 1/near at the first value, 1/far at 1.
            DepthKind::ZBuffer { near, far, first } => {
                let t = (v - first) / (1.0 - first);
                valid((0.0..=1.0).contains(&t), (1.0 - t) / near + t / far)
            }
            DepthKind::DistanceFromNear { .. } if v == 0.0 => 0.0,
            DepthKind::DistanceFromNear { near } => valid(v >= 0.0, (v / ray_length + near).recip()),
        }
    }

    /// The value of this kind of a point of disparity `d`; the inverse of [`disparity`](Self::disparity).
    pub fn value(self, d: f64) -> f64 {
        match self {
            DepthKind::Z | DepthKind::Distance => d.recip(),
            DepthKind::InverseZ | DepthKind::Disparity | DepthKind::Relative => d,
            DepthKind::RelativeBetween { far, near } => far + d * (near - far),
            DepthKind::ZBuffer { near, far, first } => {
                let t = (near.recip() - d) / (near.recip() - far.recip());
                first + t.clamp(0.0, 1.0) * (1.0 - first)
            }
            DepthKind::DistanceFromNear { .. } if d == 0.0 => 0.0,
            DepthKind::DistanceFromNear { near } => (d.recip() - near).max(0.0),
        }
    }

    /// Whether values of this kind are distances, or their inverses, which have one sign.
    fn is_never_negative(self) -> bool {
        matches!(
            self,
            DepthKind::Z | DepthKind::Distance | DepthKind::InverseZ | DepthKind::DistanceFromNear { .. }
        )
    }

    /// Whether the kind needs the direction of each pixel's ray.
    pub fn needs_rays(self) -> bool {
        matches!(self, DepthKind::Distance | DepthKind::DistanceFromNear { .. })
    }

    /// The value of the background, which is at infinity or, in relative disparity, at 0. A z-buffer whose farther plane
    /// is finite has its background at that plane.
    pub fn background(self) -> f32 {
        match self {
            DepthKind::Z | DepthKind::Distance => f32::INFINITY,
            DepthKind::InverseZ
            | DepthKind::Disparity
            | DepthKind::Relative
            | DepthKind::DistanceFromNear { .. } => 0.0,
            DepthKind::RelativeBetween { far, .. } => far as f32,
            DepthKind::ZBuffer { near, far, first } => (if near > far { first } else { 1.0 }) as f32,
        }
    }

    /// A description of valid values, for error texts.
    fn accepted(self) -> &'static str {
        match self {
            DepthKind::Z | DepthKind::Distance => "depths greater than 0 (infinity is background)",
            DepthKind::InverseZ => "inverse depths that are finite and not negative",
            DepthKind::Disparity | DepthKind::Relative | DepthKind::RelativeBetween { .. } => {
                "finite disparities"
            }
            DepthKind::ZBuffer { first: -1.0, .. } => "values from -1 to 1",
            DepthKind::ZBuffer { .. } => "values from 0 to 1",
            DepthKind::DistanceFromNear { .. } => "distances not negative (0 is background)",
        }
    }
}

/// The treatment of invalid depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Invalid {
    /// Refuse the picture; the error says how many invalid values there are and where the first one is.
    Raise,
    /// Treat them as background, at infinity (for relative disparity: as far as the farthest pixel).
    Far,
}

/// Disparity of every pixel of a frame of width `width`, NaN where depth is invalid, and the number of such pixels.
///
/// The kinds that are measured along the ray need `rays`.
pub fn disparities(
    depth: &[f32],
    width: usize,
    kind: DepthKind,
    rays: Option<Rays>,
) -> Result<(Buffer<f32>, usize)> {
    if kind.needs_rays() && rays.is_none() {
        return Err(value_error!(
            "depth_kind: depth along the ray needs a lens with a field of view; a lens made by from_disparity \
             has none"
        ));
    }
    let ray_length =
        |x: usize, y: usize| rays.filter(|_| kind.needs_rays()).map_or(1.0, |rays| rays.length(x, y));
    // The most frequent kind has a loop of its own, which the compiler vectorises.
    let row = |y: usize, depth: &[f32], out: &mut [f32]| match kind {
        DepthKind::Z => finite(depth, out, |_, v| DepthKind::Z.disparity(v, 1.0)),
        _ => finite(depth, out, |x, v| kind.disparity(v, ray_length(x, y))),
    };
    let mut out = Buffer::unset(depth.len());
    let bad: usize = out
        .par_chunks_mut(width)
        .zip(depth.par_chunks(width))
        .enumerate()
        .map(|(y, (out, depth))| row(y, depth, out))
        .sum();
    if kind == DepthKind::Relative {
        normalize(&mut out);
    }
    Ok((out, bad))
}

/// The disparities of a row, NaN where they are not finite, and the number of such pixels.
#[inline(always)]
fn finite(depth: &[f32], out: &mut [f32], disparity: impl Fn(usize, f64) -> f64) -> usize {
    let mut bad = 0u32;
    for (x, (out, &v)) in out.iter_mut().zip(depth).enumerate() {
        let d = disparity(x, f64::from(v)) as f32;
        *out = if d.is_finite() { d } else { f32::NAN };
        bad += u32::from(!d.is_finite());
    }
    bad as usize
}

/// Disparity of every pixel, as [`disparities`] computes it, with invalid depth treated as requested.
pub fn disparity_plane(
    depth: &[f32],
    width: usize,
    kind: DepthKind,
    rays: Option<Rays>,
    invalid: Invalid,
) -> Result<Buffer<f32>> {
    let (mut out, bad) = disparities(depth, width, kind, rays)?;
    if bad > 0 {
        let negative = depth.iter().filter(|v| **v < 0.0).count();
        let positive = depth.iter().any(|v| *v > 0.0 && v.is_finite());
        if kind.is_never_negative() && negative > 0 && !positive {
            let others = match depth.len() - negative {
                0 => String::new(),
                n => format!(" but {n} that are 0, infinite or NaN"),
            };
            return Err(value_error!(
                "depth: all {} values{others} are negative, as where the camera looks along -z; negate them",
                depth.len()
            ));
        }
        match invalid {
            Invalid::Raise => {
                let first = out.iter().position(|d| d.is_nan()).unwrap_or(0);
                return Err(value_error!(
                    "depth has {bad} of {} values that are not valid; the first is {} at row {}, column {}. \
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
                    DepthKind::Disparity | DepthKind::Relative | DepthKind::RelativeBetween { .. } => {
                        out.iter().copied().fold(f32::INFINITY, f32::min)
                    }
                    _ => 0.0,
                };
                let far = if far.is_finite() { far } else { 0.0 };
                out.iter_mut().filter(|d| d.is_nan()).for_each(|d| *d = far);
            }
        }
    }
    Ok(out)
}

/// Normalises disparity of any scale to 0 to 1, robustly: 0 and 1 are its 1st and 99th percentile, and values
/// beyond them stay beyond.
fn normalize(disparity: &mut [f32]) {
    let mut valid: Vec<f32> = disparity.iter().copied().filter(|d| !d.is_nan()).collect();
    if valid.is_empty() {
        return;
    }
    let last = valid.len() - 1;
    let mut quantile =
        |hundredths: usize| *valid.select_nth_unstable_by(last * hundredths / 100, f32::total_cmp).1;
    let (far, near) = (quantile(1), quantile(99));
    let scale = if near > far { 1.0 / (near - far) } else { 0.0 };
    disparity.par_iter_mut().for_each(|d| *d = scale * (*d - far));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(kind: DepthKind, v: f32) -> Result<f32> {
        let rays = Rays { focal_px: 10.0, centre: [0.0; 2] };
        disparity_plane(&[v], 1, kind, Some(rays), Invalid::Raise).map(|d| d[0])
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
            (DepthKind::ZBuffer { near, far, first: 0.0 }, z_buffer as f32),
            (DepthKind::ZBuffer { near, far, first: -1.0 }, (2.0 * z_buffer - 1.0) as f32),
            (DepthKind::ZBuffer { near: far, far: near, first: 0.0 }, (1.0 - z_buffer) as f32),
            (DepthKind::ZBuffer { near: f64::INFINITY, far: near, first: 0.0 }, near as f32 / z),
            (DepthKind::DistanceFromNear { near }, z - near as f32),
        ] {
            let d = one(kind, v).unwrap();
            assert!((d - 1.0 / z).abs() < 1e-6, "{kind:?}: {d}");
            let back = kind.value(f64::from(d)) as f32;
            assert!((back - v).abs() < 1e-5 * v.abs().max(1.0), "{kind:?}: {back} for {v}");
        }
    }

    #[test]
    fn the_background_of_every_kind_is_infinitely_far() {
        for kind in [
            DepthKind::Z,
            DepthKind::Distance,
            DepthKind::InverseZ,
            DepthKind::Disparity,
            DepthKind::ZBuffer { near: 0.5, far: f64::INFINITY, first: 0.0 },
            DepthKind::ZBuffer { near: f64::INFINITY, far: 0.5, first: -1.0 },
            DepthKind::DistanceFromNear { near: 0.5 },
        ] {
            assert_eq!(one(kind, kind.background()).unwrap(), 0.0, "{kind:?}");
        }
    }

    #[test]
    fn relative_disparity_comes_from_0_to_1_whatever_its_scale_and_outliers() {
        let values: Vec<f32> = (0..=1000).map(|i| 40.0 + 3.0 * i as f32).collect();
        let mut wild = values.clone();
        (wild[0], wild[1000]) = (-1e6, 1e6);
        let plane = |v: &[f32]| disparity_plane(v, 7, DepthKind::Relative, None, Invalid::Raise).unwrap();
        for (i, &d) in plane(&wild).iter().enumerate().skip(1).take(999) {
            assert!((d - (i as f32 - 10.0) / 980.0).abs() < 1e-5, "{i}: {d}");
        }
        assert_eq!(plane(&values)[1..1000], plane(&wild)[1..1000]);
        assert_eq!(plane(&[5.0; 9])[..], [0.0; 9]);
    }

    #[test]
    fn infinity_is_background_and_nonsense_is_refused() {
        assert_eq!(one(DepthKind::Z, f32::INFINITY).unwrap(), 0.0);
        assert_eq!(one(DepthKind::DistanceFromNear { near: 0.1 }, 0.0).unwrap(), 0.0);
        for v in [0.0, f32::NAN] {
            let text = one(DepthKind::Z, v).unwrap_err().to_string();
            assert!(text.contains("1 of 1") && text.contains("row 0, column 0"), "{text}");
        }
        let text = one(DepthKind::Z, -1.0).unwrap_err().to_string();
        assert!(text.contains("all 1 values are negative") && text.contains("negate them"), "{text}");
    }
}
