//! Depth: the arguments that describe it, its planes, and its disparity for a lens.

use super::errors::choice;
use super::run::installed;
use super::samples::{SampleType, array, in_order, sample_type, view, with_sample_type};
use crate::color::Sample;
use crate::depth::{DepthKind, Invalid, Rays, disparities};
use crate::memory::Buffer;
use crate::optics::{Base, Frame, Lens};
use crate::picture::Size;
use numpy::ndarray::Axis;
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// The arguments by which a caller describes depth.
pub struct DepthArguments<'a> {
    pub depth_kind: &'a str,
    pub near: Option<f64>,
    pub far: Option<f64>,
    /// The relative disparities that become 0 and 1.
    pub depth_range: Option<[f64; 2]>,
}

fn positive(name: &str, value: Option<f64>, kind: &str) -> PyResult<f64> {
    match value {
        Some(v) if v > 0.0 => Ok(v),
        Some(v) => {
            Err(PyValueError::new_err(format!("{name} must be a distance in metres greater than 0; got {v}")))
        }
        None => Err(PyValueError::new_err(format!("{name} must be given for depth_kind={kind:?}"))),
    }
}

/// The kind of depth that the arguments describe, checked against the lens with which it is used.
pub fn read_depth_kind(arguments: &DepthArguments, lens: &Lens) -> PyResult<DepthKind> {
    let kind = read_depth_arguments(arguments)?;
    match (kind, lens.base) {
        (
            DepthKind::Disparity | DepthKind::Relative | DepthKind::RelativeBetween { .. },
            Base::Thin { .. },
        ) => Err(PyValueError::new_err(format!(
            "depth_kind={:?} is relative and needs a lens made by Lens.from_disparity; metric inverse \
                 depth is depth_kind=\"inverse_z\"",
            arguments.depth_kind
        ))),
        (
            DepthKind::Disparity | DepthKind::Relative | DepthKind::RelativeBetween { .. },
            Base::Relative { .. },
        ) => Ok(kind),
        (_, Base::Relative { .. }) => Err(PyValueError::new_err(format!(
            "depth_kind={:?} is metric, but the lens was made by Lens.from_disparity, which needs \
             depth_kind=\"disparity\" or \"relative\"",
            arguments.depth_kind
        ))),
        (_, Base::Thin { .. }) => Ok(kind),
    }
}

/// The kind of depth that the arguments describe.
pub fn read_depth_arguments(arguments: &DepthArguments) -> PyResult<DepthKind> {
    let name = arguments.depth_kind;
    let names = [
        ("z", DepthKind::Z),
        ("distance", DepthKind::Distance),
        ("inverse_z", DepthKind::InverseZ),
        ("disparity", DepthKind::Disparity),
        ("relative", DepthKind::Relative),
        ("zbuffer", DepthKind::ZBuffer { near: 0.0, far: 0.0, first: 0.0 }),
        ("opengl_ndc", DepthKind::ZBuffer { near: 0.0, far: 0.0, first: -1.0 }),
        ("distance_from_near", DepthKind::DistanceFromNear { near: 0.0 }),
    ];
    let kind = choice("depth_kind", name, &names)?;
    if let Some([far, near]) = arguments.depth_range {
        if kind != DepthKind::Relative {
            return Err(PyValueError::new_err(format!(
                "depth_range is for depth_kind=\"relative\"; got depth_kind={name:?}"
            )));
        }
        if !(far.is_finite() && near.is_finite() && far != near) {
            return Err(PyValueError::new_err(format!(
                "depth_range must be two different disparities, that of what is far and that of what is near; got \
                 ({far}, {near})"
            )));
        }
    }
    Ok(match kind {
        DepthKind::ZBuffer { first, .. } => {
            let (near, far) =
                (positive("near", arguments.near, name)?, positive("far", arguments.far, name)?);
            if far == near {
                return Err(PyValueError::new_err(format!("far must differ from near ({near}); got {far}")));
            }
            DepthKind::ZBuffer { near, far, first }
        }
        DepthKind::DistanceFromNear { .. } => {
            DepthKind::DistanceFromNear { near: positive("near", arguments.near, name)? }
        }
        kind => {
            if arguments.near.is_some() || arguments.far.is_some() {
                return Err(PyValueError::new_err(format!(
                    "near and far are for depth_kind=\"zbuffer\", \"opengl_ndc\" and \"distance_from_near\"; got depth_kind={name:?}"
                )));
            }
            match arguments.depth_range {
                Some([far, near]) => DepthKind::RelativeBetween { far, near },
                None => kind,
            }
        }
    })
}

/// The treatment of invalid depth.
pub fn read_invalid(name: &str) -> PyResult<Invalid> {
    choice("invalid", name, &[("raise", Invalid::Raise), ("far", Invalid::Far)])
}

/// Raw depth planes of an array of shape (H, W), or (L, H, W).
pub struct DepthPlanes {
    pub width: usize,
    pub height: usize,
    pub planes: Vec<Buffer<f32>>,
}

/// Reads raw depth, without interpreting it. Integers have no unit; they are parts of their greatest value, and that is
/// enough where depth is relative.
pub fn read_depth(depth: &Bound<'_, PyAny>, kind: DepthKind) -> PyResult<DepthPlanes> {
    let array = &array("depth", depth)?;
    let is_relative = matches!(kind, DepthKind::Relative | DepthKind::RelativeBetween { .. });
    let found = sample_type("depth", array, is_relative).map_err(|error| {
        match sample_type("depth", array, true) {
            Ok(_) => PyTypeError::new_err(format!(
                "{}; whole numbers, which have no unit, are for depth_kind=\"relative\"",
                error.value(depth.py())
            )),
            Err(_) => error,
        }
    })?;
    planes_of("depth", array, found)
}

/// Reads an argument that has one value a pixel, or a plane of them for each layer.
pub fn read_planes(name: &str, given: &Bound<'_, PyAny>) -> PyResult<DepthPlanes> {
    let array = &array(name, given)?;
    planes_of(name, array, sample_type(name, array, false)?)
}

fn planes_of(
    name: &str,
    array: &Bound<'_, PyUntypedArray>,
    sample_type: SampleType,
) -> PyResult<DepthPlanes> {
    let shape = array.shape();
    let (layers, height, width) = match *shape {
        [height, width] => (1, height, width),
        [layers, height, width] => (layers, height, width),
        _ => {
            return Err(PyValueError::new_err(format!(
                "{name} must have shape (H, W), or (L, H, W) for layers; got {shape:?}"
            )));
        }
    };
    if layers * height * width == 0 {
        return Err(PyValueError::new_err(format!("{name} must not be empty; got shape {shape:?}")));
    }
    let planes = with_sample_type!(sample_type, T => view::<T, _>(array, |view| {
        let layer = |i: usize| if view.ndim() == 3 { view.index_axis(Axis(0), i) } else { view.view() };
        let values = |v: &[T]| Buffer::of_each(v, |d| d.to_code());
        (0..layers).map(|i| in_order(&layer(i), values)).collect::<PyResult<_>>()
    }))??;
    Ok(DepthPlanes { width, height, planes })
}

/// Refuses a map of another shape than the picture's, to a pixel of the smaller of the two.
pub fn check_shape(name: &str, depth: &DepthPlanes, size: Size) -> PyResult<()> {
    let (across, down) = (depth.width * size.height, depth.height * size.width);
    if across.abs_diff(down) > size.width.max(size.height).max(depth.width).max(depth.height) {
        return Err(PyValueError::new_err(format!(
            "{name} must have the shape of color, {} x {} pixels, at any size; got {} x {}",
            size.width, size.height, depth.width, depth.height
        )));
    }
    Ok(())
}

/// The disparity of a picture, and the positions of its pixels relative to a lens.
pub struct SeenDepth {
    pub width: usize,
    pub height: usize,
    disparity: Buffer<f32>,
    /// The rays of the pixels. A lens over relative disparity has none; positions are then in pixels.
    rays: Rays,
}

impl SeenDepth {
    /// Disparity of a pixel, if its depth is valid.
    pub fn disparity(&self, x: usize, y: usize) -> Option<f64> {
        let d = self.disparity[y * self.width + x];
        (!d.is_nan()).then_some(f64::from(d))
    }

    /// The position of a pixel, in focal lengths from the optical axis.
    pub fn place(&self, x: usize, y: usize) -> [f64; 2] {
        let Rays { focal_px, centre } = self.rays;
        [(x as f64 - centre[0]) / focal_px, (y as f64 - centre[1]) / focal_px]
    }
}

/// Reads depth and converts it to disparity for a lens.
pub fn read_seen_depth(
    depth: &Bound<'_, PyAny>,
    arguments: &DepthArguments,
    lens: &Lens,
) -> PyResult<SeenDepth> {
    let kind = read_depth_kind(arguments, lens)?;
    let planes = read_depth(depth, kind)?;
    let (width, height) = (planes.width, planes.height);
    let rays = Frame::plain(width, height).rays(lens);
    let (disparity, _) = installed(|| disparities(&planes.planes[0], width, kind, rays))??;
    let rays = rays.unwrap_or(Rays { focal_px: 1.0, centre: [0.0; 2] });
    Ok(SeenDepth { width, height, disparity, rays })
}
