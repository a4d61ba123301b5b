//! The Python module: arguments are read and checked here, once, and become the core's types.

mod aperture;
mod arrays;
mod errors;
mod lens;
mod render;
mod run;

use pyo3::prelude::*;

/// Compiled core of dofsim; use it through the `dofsim` package.
#[pymodule]
pub mod _dofsim {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::aperture::PyAperture;
    #[pymodule_export]
    use super::errors::DeviceError;
    #[pymodule_export]
    use super::lens::PyLens;
    #[pymodule_export]
    use super::render::{PyScene, coc, render};
    #[pymodule_export]
    use super::run::simd_available;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
