//! `dofsim.refine_depth`, and the refining of a scene's depth.

use super::argument;
use super::color::{color_shape, read_format, read_layer_color};
use super::depth::{
    DepthArguments, DepthPlanes, check_shape, read_depth, read_depth_arguments, read_invalid,
};
use super::invalid_color::read_invalid_color;
use super::photograph::planes;
use super::run::detached;
use super::samples::array;
use crate::depth::{DepthKind, Invalid, Rays, disparity_plane};
use crate::memory::Buffer;
use crate::picture::Size;
use crate::refine::{Edges, Plane, refine};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The depth with the edges of the picture, from depth that is soft, coarse or noisy.
///
/// The depth of a phone, of a network or of a filtered render is soft at edges: between two surfaces it has values of
/// neither, which a lens shows as rims and serrations. Here each pixel of such a ramp gets the depth of one of the two,
/// and the edge is where the ramp passes their middle. What is small and bright gets the depth that explains
/// most of the map. Noise is averaged where depth differs by no more than noise does. How soft and how noisy the depth
/// is, is measured.
///
/// Parameters
/// ----------
/// color : ndarray
///     The picture, as of `render`; one layer.
/// depth : ndarray
///     Its depth, shape (h, w): of the picture's size or smaller or larger, but of its shape to a pixel of the map.
/// depth_kind, near, far, invalid, invalid_color, alpha, transfer, threads
///     As in `render`. Of ``"relative"`` depth the scale is kept. No colour comes back, so nothing is said of those that
///     are filled.
/// return_coverage : bool, optional
///     Whether to return the coverage of edges, too.
///
/// Returns
/// -------
/// ndarray or tuple of ndarray
///     float32, shape (H, W): depth of the picture's size and of the same kind. Depth that is sharp and without noise comes
///     back to the bit. With `return_coverage` also how much of each pixel the nearer of two surfaces covers that
///     meet in it, float32 from 0 to 1, and 1 away from edges.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted.
///
/// Notes
/// -----
/// A map that lies beside the picture, or whose foreground is too large, is moved or shrunk as a whole, by up to 3 px. An edge
/// that the map has lost altogether does not come back, unless it is that of a lamp.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> color = np.zeros((48, 64, 3), np.float32)
/// >>> color[:, 32:] = 1.0
/// >>> soft = np.interp(np.arange(64), [28.5, 34.5], [1.0, 0.25]) * np.ones((48, 1))
/// >>> sharp = dofsim.refine_depth(color, soft, depth_kind="inverse_z")
/// >>> sharp[24, 30:34].round(2)
/// array([1.  , 1.  , 0.25, 0.25], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, depth, *, depth_kind="z", near=None, far=None, invalid="raise", invalid_color="raise",
    alpha=None, transfer=None, threads=None, return_coverage=false))]
#[expect(clippy::too_many_arguments, reason = "the public function's own, keyword-only in Python")]
pub fn refine_depth<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    depth: &Bound<'py, PyAny>,
    depth_kind: &str,
    #[pyo3(from_py_with = argument::near)] near: Option<f64>,
    #[pyo3(from_py_with = argument::far)] far: Option<f64>,
    invalid: &str,
    invalid_color: &str,
    alpha: Option<&str>,
    transfer: Option<&str>,
    #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
    return_coverage: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let kind = read_depth_arguments(&DepthArguments { depth_kind, near, far, depth_range: None })?;
    let invalid = read_invalid(invalid)?;
    let array = &array("color", color)?;
    let shape = color_shape(array.shape())?;
    if shape.layers > 1 {
        return Err(one_layer(shape.layers));
    }
    let format = read_format(array, &shape, alpha, transfer)?;
    let (planes, ..) = read_layer_color(array, &shape, 0, &format, read_invalid_color(invalid_color)?)?;
    let size = shape.size;
    let depth = Refining { kind, invalid, threads }.refined(
        py,
        &read_depth(depth, kind)?,
        &planes[..size.pixels() * format.lights(size)],
        size,
    )?;
    let plane = |values: &[f32]| {
        let array = PyArray1::from_slice(py, values).reshape([size.height, size.width])?;
        Ok::<_, PyErr>(array.into_any())
    };
    let refined = plane(&depth.0)?;
    if return_coverage {
        return Ok((
            refined,
            plane(&depth.1.map_or_else(|| Buffer::full(size.pixels(), 1.0), |edges| edges.faded().values))?,
        )
            .into_pyobject(py)?
            .into_any());
    }
    Ok(refined)
}

/// The error for pictures in layers.
pub fn one_layer(layers: usize) -> PyErr {
    PyValueError::new_err(format!("refine is for a picture of one layer; got {layers}"))
}

/// How depth is refined.
pub struct Refining {
    pub kind: DepthKind,
    pub invalid: Invalid,
    pub threads: Option<usize>,
}

impl Refining {
    /// Raw depth of the picture's size and its edges. `lights` are the planes of the picture that hold
    /// light.
    pub fn refined(
        &self,
        py: Python<'_>,
        depth: &DepthPlanes,
        lights: &[f32],
        size: Size,
    ) -> PyResult<(Buffer<f32>, Option<Edges>)> {
        if depth.planes.len() > 1 {
            return Err(one_layer(depth.planes.len()));
        }
        check_shape("depth", depth, size)?;
        // The scale of relative disparity is the caller's.
        let kind = match self.kind {
            DepthKind::Relative | DepthKind::RelativeBetween { .. } => DepthKind::Disparity,
            kind => kind,
        };
        let given = &depth.planes[0];
        detached(py, self.threads, |cancel| {
            let values = disparity_plane(given, depth.width, kind, Some(Rays::PARALLEL), self.invalid)?;
            let disparity = Plane { width: depth.width, height: depth.height, values };
            let colors = planes(lights, size.width, size.height);
            let refined = refine(&disparity, &colors, cancel)?;
            let same = (depth.width, depth.height) == (size.width, size.height);
            let mut values = Buffer::of_each(&refined.depth.values, |d| kind.value(f64::from(*d)) as f32);
            if same {
                // What was not changed keeps its bits, which the way to disparity and back would round.
                let old = given.iter().zip(disparity.values.iter()).zip(refined.depth.values.iter());
                let kept = values
                    .iter_mut()
                    .zip(old)
                    .filter(|(_, ((v, a), b))| a == b && v.is_finite() && **v > 0.0);
                kept.for_each(|(out, ((v, _), _))| *out = *v);
            }
            Ok((values, refined.edges))
        })
    }
}
