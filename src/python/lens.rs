//! `dofsim.Lens`.

use super::arrays::{DepthWords, read_depth_kind, read_depth_value};
use super::errors::choice;
use crate::optics::{FovAxis, Lens};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::hash::{DefaultHasher, Hash, Hasher};

/// Hash of a settings value by its own words.
pub fn hash_words(words: &str) -> u64 {
    let mut hasher = DefaultHasher::new();
    words.hash(&mut hasher);
    hasher.finish()
}

/// A lens: how wide it is open, where it is focused and how it maps the scene to pixels.
///
/// The names and units are those of Mitsuba's ``thinlens`` sensor. Other cameras come in through the class
/// methods ``from_camera``, ``from_mitsuba``, ``from_blender`` and ``from_disparity``.
///
/// Parameters
/// ----------
/// aperture_radius : float
///     Radius of the opening in metres; 0 is a pinhole.
/// focus_distance : float
///     Distance of the plane in focus in metres, along the optical axis; may be infinite.
/// fov : float
///     Field of view in degrees along `fov_axis`.
/// fov_axis : {"x", "y", "diagonal", "smaller", "larger"}, optional
///     The side of the picture that `fov` spans.
///
/// Raises
/// ------
/// ValueError
///     If a value is out of range; the text names the argument, the value and what is accepted.
///
/// Notes
/// -----
/// With disparity ``d = 1/z`` the radius of the circle of confusion in pixels is
/// ``aperture_radius * focal_px * |d - 1/focus_distance|``, where ``focal_px = (width/2) / tan(fov/2)``. It is
/// linear in disparity, and the plane in focus is a plane.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
/// >>> lens.replace(focus_distance=5.0)
/// Lens(aperture_radius=0.05, focus_distance=5.0, fov=42.0, fov_axis='x')
#[pyclass(name = "Lens", module = "dofsim", frozen, eq)]
#[derive(Debug, Clone, PartialEq)]
pub struct PyLens {
    pub core: Lens,
}

/// A number out of a mapping, by the first of several keys that it has.
fn number(words: &Bound<'_, PyDict>, keys: &[&str]) -> PyResult<Option<f64>> {
    for key in keys {
        if let Some(value) = words.get_item(key)? {
            return value.extract().map(Some).map_err(|_| {
                PyTypeError::new_err(format!("{key} must be a number; got {}", describe(&value)))
            });
        }
    }
    Ok(None)
}

fn required(words: &Bound<'_, PyDict>, what: &str, keys: &[&str]) -> PyResult<f64> {
    number(words, keys)?.ok_or_else(|| PyValueError::new_err(format!("{what} has no {:?}", keys[0])))
}

fn text(words: &Bound<'_, PyDict>, key: &str, default: &str) -> PyResult<String> {
    words.get_item(key)?.map_or_else(|| Ok(default.to_owned()), |value| value.extract())
}

fn describe(value: &Bound<'_, PyAny>) -> String {
    value.repr().map_or_else(|_| "a value that has no repr".to_owned(), |r| r.to_string())
}

/// A scalar that a renderer keeps in an array of its own.
fn scalar(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().or_else(|_| value.get_item(0)?.extract())
}

#[pymethods]
impl PyLens {
    #[new]
    #[pyo3(signature = (*, aperture_radius, focus_distance, fov, fov_axis="x"))]
    fn new(aperture_radius: f64, focus_distance: f64, fov: f64, fov_axis: &str) -> PyResult<PyLens> {
        let fov_axis = choice("fov_axis", fov_axis, &FovAxis::NAMES)?;
        Ok(PyLens { core: Lens::thin(aperture_radius, focus_distance, fov, fov_axis)? })
    }

    /// A photographic lens.
    ///
    /// Parameters
    /// ----------
    /// focal_length_mm : float
    ///     Focal length in millimetres.
    /// f_number : float
    ///     Focal length over the diameter of the opening.
    /// focus_distance : float
    ///     Distance of the plane in focus in metres; more than the focal length, may be infinite.
    /// sensor_width_mm : float, optional
    ///     Width of the sensor in millimetres.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     With ``aperture_radius = f / (2 N)`` and the field of view of a sensor at the image distance
    ///     ``v = f u / (u - f)``.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If a value is out of range.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> lens = dofsim.Lens.from_camera(focal_length_mm=50, f_number=2.0, focus_distance=3.0)
    /// >>> round(lens.aperture_radius, 6), round(lens.fov, 3)
    /// (0.0125, 38.988)
    #[staticmethod]
    #[pyo3(signature = (*, focal_length_mm, f_number, focus_distance, sensor_width_mm=36.0))]
    fn from_camera(
        focal_length_mm: f64,
        f_number: f64,
        focus_distance: f64,
        sensor_width_mm: f64,
    ) -> PyResult<PyLens> {
        Ok(PyLens { core: Lens::from_camera(focal_length_mm, f_number, focus_distance, sensor_width_mm)? })
    }

    /// The lens of a Mitsuba ``thinlens`` (or ``perspective``) sensor.
    ///
    /// Parameters
    /// ----------
    /// sensor : mitsuba.Sensor or dict
    ///     A loaded sensor, or the dictionary that one is loaded from.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     A ``perspective`` sensor gives a pinhole.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the sensor is of another type or lacks a parameter.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> dofsim.Lens.from_mitsuba(
    /// ...     {"type": "thinlens", "aperture_radius": 0.08, "focus_distance": 4.0, "fov": 42.0}
    /// ... )
    /// Lens(aperture_radius=0.08, focus_distance=4.0, fov=42.0, fov_axis='x')
    #[staticmethod]
    fn from_mitsuba(sensor: &Bound<'_, PyAny>) -> PyResult<PyLens> {
        let Ok(words) = sensor.cast::<PyDict>() else {
            // A loaded sensor exposes its parameters through traverse; its field of view is always along x.
            let parameters = sensor.py().import("mitsuba")?.call_method1("traverse", (sensor,))?;
            let has = |key: &str| -> PyResult<bool> { parameters.contains(key) };
            let get = |key: &str| -> PyResult<f64> {
                scalar(&parameters.get_item(key).map_err(|_| {
                    PyValueError::new_err(format!(
                        "sensor has no {key:?}; a thinlens or perspective sensor has"
                    ))
                })?)
            };
            let aperture_radius = if has("aperture_radius")? { get("aperture_radius")? } else { 0.0 };
            let focus_distance = if has("focus_distance")? { get("focus_distance")? } else { 1.0 };
            let core = Lens::thin(aperture_radius, focus_distance, get("x_fov")?, FovAxis::X)?;
            return Ok(PyLens { core });
        };
        let kind = text(words, "type", "")?;
        let (aperture_radius, focus_distance) = match kind.as_str() {
            "thinlens" => (
                required(words, "the thinlens sensor", &["aperture_radius"])?,
                required(words, "the thinlens sensor", &["focus_distance"])?,
            ),
            "perspective" => (0.0, 1.0),
            _ => {
                return Err(PyValueError::new_err(format!(
                    "sensor must be of type \"thinlens\" or \"perspective\"; got {kind:?}"
                )));
            }
        };
        let (fov, axis) = match words.get_item("focal_length")? {
            // Mitsuba's focal lengths are those of 35 mm film, whose diagonal they are measured along.
            Some(focal_length) => {
                let written: String = focal_length.extract()?;
                let mm: f64 = written.trim_end_matches("mm").trim().parse().map_err(|_| {
                    PyValueError::new_err(format!("focal_length must be like \"50mm\"; got {written:?}"))
                })?;
                (2.0 * (0.5 * 36f64.hypot(24.0) / mm).atan().to_degrees(), "diagonal".to_owned())
            }
            None => (required(words, "the sensor", &["fov"])?, text(words, "fov_axis", "x")?),
        };
        PyLens::new(aperture_radius, focus_distance, fov, &axis)
    }

    /// The lens of a Blender camera.
    ///
    /// Parameters
    /// ----------
    /// camera : dict
    ///     ``lens`` (focal length in mm), ``fstop``, ``focus_distance`` (m), and optionally ``sensor_width``
    ///     (mm, 36), ``sensor_height`` (mm, 24) and ``sensor_fit`` (``"AUTO"``, ``"HORIZONTAL"``,
    ///     ``"VERTICAL"``).
    ///
    /// Returns
    /// -------
    /// Lens
    ///     With ``aperture_radius = lens / (2 fstop)``, as Cycles has it.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If an entry is missing or out of range.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> dofsim.Lens.from_blender({"lens": 50.0, "fstop": 2.5, "focus_distance": 4.0}).aperture_radius
    /// 0.01
    #[staticmethod]
    fn from_blender(camera: &Bound<'_, PyDict>) -> PyResult<PyLens> {
        let lens_mm = required(camera, "the camera", &["lens"])?;
        let fstop = required(camera, "the camera", &["fstop", "aperture_fstop"])?;
        let focus_distance = required(camera, "the camera", &["focus_distance"])?;
        if !(lens_mm > 0.0 && fstop > 0.0) {
            return Err(PyValueError::new_err(format!(
                "lens and fstop must be greater than 0; got {lens_mm} and {fstop}"
            )));
        }
        let fits = [("AUTO", ("larger", 36.0)), ("HORIZONTAL", ("x", 36.0)), ("VERTICAL", ("y", 24.0))];
        let (axis, default_mm) = choice("sensor_fit", &text(camera, "sensor_fit", "AUTO")?, &fits)?;
        let side = if axis == "y" { "sensor_height" } else { "sensor_width" };
        let sensor_mm = number(camera, &[side])?.unwrap_or(default_mm);
        let fov = 2.0 * (0.5 * sensor_mm / lens_mm).atan().to_degrees();
        PyLens::new(lens_mm * 1e-3 / (2.0 * fstop), focus_distance, fov, axis)
    }

    /// A lens over relative disparity, as a monocular depth network gives it, with no metric claim.
    ///
    /// Parameters
    /// ----------
    /// strength_px : float
    ///     Radius of the circle of confusion in pixels per unit of disparity.
    /// focus : float
    ///     The disparity in focus.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     For use with ``depth_kind="disparity"``.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If a value is not finite, or the strength negative.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> dofsim.Lens.from_disparity(strength_px=30.0, focus=0.8)
    /// Lens.from_disparity(strength_px=30.0, focus=0.8)
    #[staticmethod]
    #[pyo3(signature = (*, strength_px, focus))]
    fn from_disparity(strength_px: f64, focus: f64) -> PyResult<PyLens> {
        Ok(PyLens { core: Lens::from_disparity(strength_px, focus)? })
    }

    /// Radius of the opening in metres; None for a lens over relative disparity.
    #[getter]
    fn aperture_radius(&self) -> Option<f64> {
        match self.core {
            Lens::Thin { aperture_radius, .. } => Some(aperture_radius),
            Lens::Relative { .. } => None,
        }
    }

    /// Distance in focus in metres; None for a lens over relative disparity.
    #[getter]
    fn focus_distance(&self) -> Option<f64> {
        match self.core {
            Lens::Thin { focus_distance, .. } => Some(focus_distance),
            Lens::Relative { .. } => None,
        }
    }

    /// Field of view in degrees; None for a lens over relative disparity.
    #[getter]
    fn fov(&self) -> Option<f64> {
        match self.core {
            Lens::Thin { fov, .. } => Some(fov),
            Lens::Relative { .. } => None,
        }
    }

    /// The side that the field of view spans; None for a lens over relative disparity.
    #[getter]
    fn fov_axis(&self) -> Option<&'static str> {
        match self.core {
            Lens::Thin { fov_axis, .. } => {
                FovAxis::NAMES.iter().find(|(_, axis)| *axis == fov_axis).map(|(name, _)| *name)
            }
            Lens::Relative { .. } => None,
        }
    }

    /// Pixels per unit of disparity; None for a metric lens.
    #[getter]
    fn strength_px(&self) -> Option<f64> {
        match self.core {
            Lens::Thin { .. } => None,
            Lens::Relative { strength_px, .. } => Some(strength_px),
        }
    }

    /// The disparity in focus; None for a metric lens.
    #[getter]
    fn focus(&self) -> Option<f64> {
        match self.core {
            Lens::Thin { .. } => None,
            Lens::Relative { focus_disparity, .. } => Some(focus_disparity),
        }
    }

    /// The same lens with some values changed.
    ///
    /// Parameters
    /// ----------
    /// **changes
    ///     Any arguments of the constructor that made the lens: those of `Lens`, or `strength_px` and `focus`.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     A new lens.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     If a name is none of the lens's own.
    /// ValueError
    ///     If a value is out of range.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
    /// >>> lens.replace(aperture_radius=0.0).aperture_radius
    /// 0.0
    #[pyo3(signature = (**changes))]
    fn replace(&self, py: Python<'_>, changes: Option<&Bound<'_, PyDict>>) -> PyResult<PyLens> {
        let words = self.words(py)?;
        for (key, value) in changes.into_iter().flatten() {
            if !words.contains(&key)? {
                let own: Vec<String> = words.keys().iter().map(|k| k.to_string()).collect();
                return Err(PyTypeError::new_err(format!(
                    "replace() got an unexpected argument {key}; this lens has {}",
                    own.join(", ")
                )));
            }
            words.set_item(key, value)?;
        }
        self.maker(py)?
            .call((), Some(&words))?
            .extract::<PyRef<'_, PyLens>>()
            .map(|l| l.clone())
            .map_err(PyErr::from)
    }

    /// The same lens focused on what pixel (x, y) sees.
    ///
    /// Parameters
    /// ----------
    /// depth : ndarray
    ///     Depth of the picture, shape (H, W).
    /// x, y : int
    ///     Column and row of the pixel; negative values count from the right and the bottom.
    /// depth_kind : str, optional
    ///     How to read `depth`, as in `render`.
    /// near, far : float, optional
    ///     Clip planes in metres, for the kinds that need them.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     A new lens.
    ///
    /// Raises
    /// ------
    /// IndexError
    ///     If the pixel is outside the picture.
    /// ValueError
    ///     If the value there is no depth.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> import numpy as np
    /// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
    /// >>> lens.focused_at(np.full((4, 6), 2.0), 5, 1).focus_distance
    /// 2.0
    #[pyo3(signature = (depth, x, y, *, depth_kind="z", near=None, far=None))]
    fn focused_at(
        &self,
        depth: &Bound<'_, PyAny>,
        x: isize,
        y: isize,
        depth_kind: &str,
        near: Option<f64>,
        far: Option<f64>,
    ) -> PyResult<PyLens> {
        let kind = read_depth_kind(&DepthWords { depth_kind, near, far }, &self.core)?;
        let disparity = read_depth_value(depth, x, y, kind, &self.core)?;
        Ok(PyLens { core: self.core.focused_at_disparity(disparity)? })
    }

    fn __repr__(&self) -> String {
        match self.core {
            Lens::Thin { aperture_radius, focus_distance, fov, .. } => {
                // Python writes an infinite float as `inf`, which is not an expression.
                let focus = if focus_distance.is_infinite() {
                    "float('inf')".to_owned()
                } else {
                    format!("{focus_distance:?}")
                };
                let axis = self.fov_axis().unwrap_or_default();
                format!(
                    "Lens(aperture_radius={aperture_radius:?}, focus_distance={focus}, fov={fov:?}, fov_axis='{axis}')"
                )
            }
            Lens::Relative { strength_px, focus_disparity } => {
                format!("Lens.from_disparity(strength_px={strength_px:?}, focus={focus_disparity:?})")
            }
        }
    }

    fn __hash__(&self) -> u64 {
        hash_words(&self.__repr__())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        // functools.partial carries the keyword-only arguments.
        let partial = py.import("functools")?.getattr("partial")?;
        let call = partial.call((self.maker(py)?,), Some(&self.words(py)?))?;
        Ok((call, PyTuple::empty(py)))
    }
}

impl PyLens {
    /// The constructor that makes such a lens.
    fn maker<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let class = py.get_type::<PyLens>();
        match self.core {
            Lens::Thin { .. } => Ok(class.into_any()),
            Lens::Relative { .. } => class.getattr("from_disparity"),
        }
    }

    /// The arguments of that constructor.
    fn words<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let words = PyDict::new(py);
        match self.core {
            Lens::Thin { aperture_radius, focus_distance, fov, .. } => {
                words.set_item("aperture_radius", aperture_radius)?;
                words.set_item("focus_distance", focus_distance)?;
                words.set_item("fov", fov)?;
                words.set_item("fov_axis", self.fov_axis())?;
            }
            Lens::Relative { strength_px, focus_disparity } => {
                words.set_item("strength_px", strength_px)?;
                words.set_item("focus", focus_disparity)?;
            }
        }
        Ok(words)
    }
}
