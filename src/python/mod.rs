//! The Python module: arguments are read and checked here, once, and become the core's types.

mod aperture;
mod argument;
mod blur;
mod carried;
mod coc;
mod color;
mod deep;
mod depth;
mod devices;
mod errors;
mod files;
mod gradients;
mod hash;
mod holdout;
mod input;
mod invalid_color;
mod lens;
mod lens_map;
mod methods;
mod output;
mod output_grid;
mod photograph;
mod refine;
mod render;
mod run;
mod samples;
mod scene;
mod views;

use pyo3::prelude::*;

/// Compiled core of dofsim; use it through the `dofsim` package.
#[pymodule]
pub mod _dofsim {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::aperture::PyAperture;
    #[pymodule_export]
    use super::blur::AxialBlur;
    #[pymodule_export]
    use super::coc::coc;
    #[pymodule_export]
    use super::deep::{layers_of_samples, read_deep_exr};
    #[pymodule_export]
    use super::devices::{
        PyDevice, chosen_device, device_bytes, device_submissions, device_traffic, devices, lacking_for_gpu,
        release_devices, restrict_devices,
    };
    #[pymodule_export]
    use super::errors::DeviceError;
    #[pymodule_export]
    use super::files::{
        Beside, ExrPart, decode_by_curves, decode_codes, deep_exr_part, encode_by_curves, encode_codes,
        encode_png, exr_parts, file_kind, parse_profile, read_exr, read_raster, write_bytes, write_exr,
        write_pfm, write_png, write_tiff,
    };
    #[pymodule_export]
    use super::gradients::PyGradients;
    #[pymodule_export]
    use super::lens::PyLens;
    #[pymodule_export]
    use super::lens::cameras::sensors;
    #[pymodule_export]
    use super::lens::focus::focusable_pixels;
    #[pymodule_export]
    use super::lens_map::PyLensMap;
    #[pymodule_export]
    use super::methods::methods_available;
    #[pymodule_export]
    use super::photograph::{layers_from_matte, restore_highlights};
    #[pymodule_export]
    use super::refine::refine_depth;
    #[pymodule_export]
    use super::render::render;
    #[pymodule_export]
    use super::run::simd_available;
    #[pymodule_export]
    use super::scene::PyScene;
    #[pymodule_export]
    use super::views::layers_from_views;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("HIGHLIGHT_RATIO", crate::scene::contrast::HIGHLIGHT_RATIO)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
