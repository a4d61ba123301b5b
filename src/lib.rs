//! Depth of field as a real lens would have taken it.

pub mod files;
mod python;

/// The extension module behind the Python package.
#[pyo3::pymodule]
mod _dofsim {
    #[pymodule_export]
    use crate::python::files::{
        ExrPart, exr_parts, file_kind, read_exr, read_raster, write_bytes, write_exr, write_pfm, write_png,
        write_tiff,
    };
}
