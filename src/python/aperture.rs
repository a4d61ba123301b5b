//! `dofsim.Aperture`.

use crate::aperture::Aperture;
use pyo3::prelude::*;
use std::fmt;

/// The shape of the opening that light passes.
///
/// Parameters
/// ----------
/// blades : int, optional
///     Number of straight blades, 3 to 64; 0 (default) is a round opening.
/// rotation : float, optional
///     Angle in degrees by which the polygon is turned, counter-clockwise as seen in the picture for points
///     behind the focus plane. At 0 the first corner points to the right. Points in front of the focus plane
///     are drawn turned by 180 degrees, as in a camera.
/// apodization : float, optional
///     Standard deviation of a Gaussian transmission as a fraction of the way from the centre to the rim, at
///     least 0.05. ``None`` (default) is a clear opening.
///
/// Raises
/// ------
/// ValueError
///     If a value is out of range; the text names the argument, the value and what is accepted.
///
/// Notes
/// -----
/// The corners of a polygon lie on the circle of the lens's ``aperture_radius``, as in Blender.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> dofsim.Aperture(blades=6, rotation=15.0)
/// Aperture(blades=6, rotation=15.0)
#[pyclass(name = "Aperture", module = "dofsim", frozen, eq)]
#[derive(Debug, Clone, PartialEq)]
pub struct PyAperture {
    /// Number of blades; 0 is a disc.
    #[pyo3(get)]
    blades: u32,
    /// Rotation in degrees.
    #[pyo3(get)]
    rotation: f64,
    /// Standard deviation of the Gaussian transmission, or None.
    #[pyo3(get)]
    apodization: Option<f64>,
    pub core: Aperture,
}

impl fmt::Display for PyAperture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut words = Vec::new();
        if self.blades != 0 {
            words.push(format!("blades={}", self.blades));
        }
        if self.rotation != 0.0 {
            words.push(format!("rotation={:?}", self.rotation));
        }
        if let Some(sigma) = self.apodization {
            words.push(format!("apodization={sigma:?}"));
        }
        write!(f, "Aperture({})", words.join(", "))
    }
}

#[pymethods]
impl PyAperture {
    #[new]
    #[pyo3(signature = (*, blades=0, rotation=0.0, apodization=None))]
    fn new(blades: u32, rotation: f64, apodization: Option<f64>) -> PyResult<PyAperture> {
        let core = Aperture::new(blades, rotation, apodization)?;
        Ok(PyAperture { blades, rotation, apodization, core })
    }

    fn __repr__(&self) -> String {
        self.to_string()
    }

    fn __hash__(&self) -> u64 {
        super::lens::hash_words(&self.to_string())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((), Bound<'py, pyo3::types::PyDict>)> {
        let words = pyo3::types::PyDict::new(py);
        words.set_item("blades", self.blades)?;
        words.set_item("rotation", self.rotation)?;
        words.set_item("apodization", self.apodization)?;
        Ok(((), words))
    }
}
