//! `dofsim.coc`.

use super::depth::{DepthWords, read_depth, read_depth_kind, read_invalid};
use super::lens::PyLens;
use super::run::installed;
use crate::depth::disparity_plane;
use crate::optics;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// Signed radius of the circle of confusion in pixels.
///
/// Parameters
/// ----------
/// depth : ndarray
///     Shape (H, W), or (L, H, W) for layers; float16, float32 or float64.
/// lens : Lens
///     The lens.
/// depth_kind, near, far, invalid
///     As in `render`.
///
/// Returns
/// -------
/// ndarray
///     float32, the shape of `depth`. Positive behind the focus, negative in front of it; without axial colour.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=90.0)
/// >>> dofsim.coc(np.array([[1.0, 2.0, np.inf, 4.0]]), lens)
/// array([[-0.1 ,  0.  ,  0.1 ,  0.05]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (depth, lens, *, depth_kind="z", near=None, far=None, invalid="raise"))]
pub fn coc<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    lens: &PyLens,
    depth_kind: &str,
    near: Option<f64>,
    far: Option<f64>,
    invalid: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let kind = read_depth_kind(&DepthWords { depth_kind, near, far }, &lens.core)?;
    let invalid = read_invalid(invalid)?;
    let planes = read_depth(depth)?;
    let size = (planes.width, planes.height);
    let frame = optics::Frame::plain(size.0, size.1);
    let (imaging, rays) = (frame.imaging(&lens.core)?, frame.rays(&lens.core));
    let mut radius = Vec::with_capacity(size.0 * size.1 * planes.planes.len());
    for plane in &planes.planes {
        let disparity = installed(|| disparity_plane(plane, size.0, kind, rays, invalid))??;
        // Adding zero turns the negative zero of the focus plane into a plain one.
        radius.extend(disparity.iter().enumerate().map(|(i, &d)| {
            let offset = imaging.surface.offset((i % size.0) as f64, (i / size.0) as f64);
            (0.0 - imaging.optics.shift_px(f64::from(d) - offset)) as f32 + 0.0
        }));
    }
    let shape: Vec<usize> = depth.getattr("shape")?.extract()?;
    Ok(PyArray1::from_vec(py, radius).reshape(shape)?.into_any())
}
