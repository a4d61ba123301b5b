//! Blur on the optical axis, for plots: its radius by distance, and the depth of field.

use super::lens::PyLens;
use crate::error::value_error;
use crate::optics::{Base, Frame, Imaging};
use pyo3::prelude::*;

/// The radius of the circle of confusion on the optical axis of a metric lens, by distance.
#[pyclass(frozen, module = "dofsim._dofsim")]
pub struct AxialBlur {
    imaging: Imaging,
}

#[pymethods]
impl AxialBlur {
    /// In pixels of a picture of this size.
    #[new]
    fn new(lens: &PyLens, width: usize, height: usize) -> PyResult<AxialBlur> {
        match lens.core.base {
            Base::Thin { .. } => Ok(AxialBlur { imaging: Frame::plain(width, height).imaging(&lens.core)? }),
            Base::Relative { .. } => Err(value_error!(
                "the lens must be a metric one: over relative disparity there are no distances"
            )
            .into()),
        }
    }

    /// The inverse of the distance in focus, in 1/m.
    #[getter]
    fn focus_disparity(&self) -> f64 {
        self.imaging.optics.d_focus
    }

    /// Pixels of radius for each 1/m away from the focus.
    #[getter]
    fn slope_px(&self) -> f64 {
        self.imaging.optics.k
    }

    /// The signed radius at each of these distances in metres, positive behind the focus.
    fn radii_px(&self, distances: Vec<f64>) -> Vec<f64> {
        let (map, [x, y]) = (self.imaging.disparity_map(), self.imaging.surface.centre);
        distances.into_iter().map(|z| 0.0 - self.imaging.optics.shift_px(map.at(x, y, 1.0 / z))).collect()
    }

    /// The nearest and the farthest distance no more blurred than this radius.
    fn limits(&self, radius_px: f64) -> (f64, f64) {
        self.imaging.limits_m(radius_px)
    }

    /// The nearest distance in focus that leaves infinity no more blurred than this radius: `k / radius`.
    fn hyperfocal(&self, radius_px: f64) -> f64 {
        self.imaging.optics.hyperfocal_m(radius_px)
    }
}
