//! The gradients of a scene's picture, for `dofsim.vjp`.

use super::aperture::PyAperture;
use super::argument;
use super::lens::PyLens;
use super::methods::read_method;
use super::run::{detached, simd};
use super::scene::PyScene;
use crate::cpu::adjoint::ByDepth;
use crate::cpu::render::Exposure;
use crate::method::Method;
use crate::optics::Imaging;
use crate::picture::Size;
use crate::renderer::Renderer;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

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

impl PyGradients {
    fn found<T: Send>(
        &self,
        py: Python<'_>,
        of: impl FnOnce(&Exposure, &[f32]) -> crate::error::Result<T> + Send,
    ) -> PyResult<T> {
        let simd = simd()?;
        let cotangent = self.cotangent.bind(py).readonly();
        let cotangent = cotangent.as_slice()?;
        detached(py, self.threads, |cancel| {
            let of = |exposure: &Exposure| of(exposure, cotangent);
            self.renderer.gradient(&self.imaging, &self.method, simd, cancel, of)
        })
    }
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

    /// How the sum changes with `color`: an array like it in float32.
    fn by_color<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let by_color = self.found(py, |exposure, weights| exposure.by_color(weights))?;
        let Size { height, width, channels } = self.size;
        Ok(PyArray1::from_slice(py, &by_color).reshape([height, width, channels])?.into_any())
    }

    /// How the sum changes with the disparity of each pixel, with the logarithm of the lens's strength, and with the disparity
    /// in focus.
    fn by_depth<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, f64, f64)> {
        let ByDepth { disparity, log_k, d_focus } =
            self.found(py, |exposure, weights| exposure.by_depth(weights))?;
        let Size { height, width, .. } = self.size;
        Ok((PyArray1::from_slice(py, &disparity).reshape([height, width])?.into_any(), log_k, d_focus))
    }
}
