//! The gradients of a scene's picture, for `dofsim.vjp`.

use super::aperture::PyAperture;
use super::argument;
use super::lens::PyLens;
use super::methods::read_method;
use super::run::{detached, simd};
use super::scene::PyScene;
use crate::cpu::adjoint::{Asked, ByDepth, Gradients};
use crate::method::Method;
use crate::optics::Imaging;
use crate::picture::Size;
use crate::renderer::Renderer;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// Derivatives by colours; and by disparities, the logarithm of the strength of the lens, and the disparity in focus.
type Found<'py> = (Option<Bound<'py, PyArray1<f32>>>, Option<(Bound<'py, PyArray2<f32>>, f64, f64)>);

/// A scene through a lens, and the weights of its picture.
#[pyclass(name = "_Gradients", module = "dofsim._dofsim", frozen)]
pub struct PyGradients {
    renderer: Arc<Renderer>,
    imaging: Imaging,
    method: Method,
    threads: Option<usize>,
    size: Size,
    cotangent: Py<PyArrayDyn<f32>>,
}

#[pymethods]
impl PyGradients {
    /// How the weighted sum of the picture of a scene changes; `dofsim.vjp` has checked the cotangent.
    #[new]
    #[pyo3(signature = (scene, lens, cotangent, *, aperture=None, max_coc_px=None, threads=None, **options))]
    fn new(
        scene: &PyScene,
        lens: &PyLens,
        cotangent: PyReadonlyArrayDyn<'_, f32>,
        aperture: Option<&PyAperture>,
        #[pyo3(from_py_with = argument::max_coc_px)] max_coc_px: Option<f64>,
        #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyGradients> {
        let method = read_method("lens", aperture, max_coc_px, options)?;
        let (renderer, imaging, size) = scene.exposed(&lens.core, &method)?;
        let cotangent = Bound::clone(&cotangent).unbind();
        Ok(PyGradients { renderer, imaging, method: method.0, threads, size, cotangent })
    }

    /// How the sum changes, as far as that is asked for: with all values of `color`; with the disparity of each
    /// pixel, with the logarithm of the lens's strength, and with the disparity in focus.
    fn find<'py>(&self, py: Python<'py>, by_color: bool, by_depth: bool) -> PyResult<Found<'py>> {
        let asked = match (by_color, by_depth) {
            (true, true) => Asked::Both,
            (false, true) => Asked::Shifts,
            _ => Asked::Colors,
        };
        let simd = simd()?;
        let cotangent = self.cotangent.bind(py).readonly();
        let cotangent = cotangent.as_slice()?;
        let Gradients { color, depth } = detached(py, self.threads, |cancel| {
            self.renderer.gradient(&self.imaging, &self.method, simd, cancel, |exposure| {
                exposure.gradients(cotangent, asked)
            })
        })?;
        let Size { height, width, .. } = self.size;
        let color = color.map(|color| PyArray1::from_slice(py, &color));
        let depth = depth.map(|ByDepth { disparity, log_k, d_focus }| {
            let disparity = PyArray1::from_slice(py, &disparity).reshape([height, width])?;
            PyResult::Ok((disparity, log_k, d_focus))
        });
        Ok((color, depth.transpose()?))
    }
}
