//! `dofsim.coc`.

use super::argument;
use super::depth::{DepthArguments, read_depth, read_depth_kind, read_invalid};
use super::lens::PyLens;
use super::run::installed;
use crate::cancel::Cancel;
use crate::depth::disparity_plane;
use crate::optics::{DisparityMap, Frame, Imaging, MaxRadius};
use crate::picture::Size;
use crate::rows::render_rows;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// Signed radius of the circle of confusion of each pixel, in pixels.
///
/// Parameters
/// ----------
/// depth : ndarray
///     Shape (H, W), or (L, H, W) for layers; float16, float32 or float64.
/// lens : Lens
///     The lens.
/// depth_kind, near, far, depth_range, invalid, in_focus, max_coc_px
///     As in `render`.
///
/// Returns
/// -------
/// ndarray
///     float32, the shape of `depth`. Positive behind the focus, negative in front of it; that of the thin lens, without
///     axial colour, coma, astigmatism and a measured lens.
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
#[pyo3(signature = (depth, lens, *, depth_kind="z", near=None, far=None, depth_range=None, invalid="raise", in_focus=None, max_coc_px=None))]
#[expect(clippy::too_many_arguments, reason = "the public function's own, keyword-only in Python")]
pub fn coc<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    lens: &PyLens,
    depth_kind: &str,
    #[pyo3(from_py_with = argument::near)] near: Option<f64>,
    #[pyo3(from_py_with = argument::far)] far: Option<f64>,
    #[pyo3(from_py_with = argument::depth_range)] depth_range: Option<[f64; 2]>,
    invalid: &str,
    #[pyo3(from_py_with = argument::in_focus)] in_focus: Option<[f64; 2]>,
    #[pyo3(from_py_with = argument::max_coc_px)] max_coc_px: Option<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let kind = read_depth_kind(&DepthArguments { depth_kind, near, far, depth_range }, &lens.core)?;
    let invalid = read_invalid(invalid)?;
    let planes = read_depth(depth, kind)?;
    let size = Size { width: planes.width, height: planes.height, channels: 1 };
    let frame = Frame::plain(size.width, size.height);
    let lens = lens.with_range(in_focus)?;
    let imaging =
        Imaging { max_radius: max_coc_px.map(MaxRadius::new).transpose()?, ..frame.imaging(&lens)? };
    let (map, rays) = (imaging.disparity_map(), frame.rays(&lens));
    let mut radii = vec![0.0; size.pixels() * planes.planes.len()];
    for (plane, radii) in planes.planes.iter().zip(radii.chunks_mut(size.pixels())) {
        installed(|| {
            let disparity = disparity_plane(plane, size.width, kind, rays, invalid)?;
            render_rows(
                radii,
                size,
                &Cancel::default(),
                || (),
                |(), y, radii| {
                    let disparity = &disparity[y * size.width..][..size.width];
                    for (x, (radius, d)) in radii.iter_mut().zip(disparity).enumerate() {
                        *radius = radius_px(&imaging, &map, x, y, *d);
                    }
                },
            )
        })??;
    }
    let shape: Vec<usize> = depth.getattr("shape")?.extract()?;
    Ok(PyArray1::from_vec(py, radii).reshape(shape)?.into_any())
}

/// The signed radius in pixels with which pixel (x, y) sees a point of this disparity, positive behind the focus.
fn radius_px(imaging: &Imaging, map: &DisparityMap, x: usize, y: usize, disparity: f32) -> f32 {
    let shift_px = imaging.optics.shift_px(map.at(x as f64, y as f64, f64::from(disparity)));
    // A shift is positive in front of the focus. Adding zero turns negative zero into positive zero.
    (0.0 - shift_px) as f32 + 0.0
}
