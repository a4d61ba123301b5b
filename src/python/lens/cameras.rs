//! Lenses from real cameras and from the cameras of other programs, and the properties of cameras in millimetres.

use super::super::argument;
use super::super::errors::choice;
use super::PyLens;
use crate::error::value_error;
use crate::optics::{FovAxis, Lens, Mount, SENSORS};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Sensors by name: their widths and heights in millimetres.
#[pyfunction]
pub fn sensors() -> Vec<(&'static str, f64, f64)> {
    SENSORS.iter().map(|(name, sensor)| (*name, sensor.width_mm, sensor.height_mm)).collect()
}

/// What is made of another program's camera; if it was in a file, what is wrong with it names the file.
pub fn of_camera<T>(camera: &Bound<'_, PyAny>, make: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
    make().map_err(|error| {
        let py = camera.py();
        let about_it = error.is_instance_of::<PyValueError>(py) || error.is_instance_of::<PyTypeError>(py);
        let Some(path) = camera.extract::<PathBuf>().ok().filter(|_| about_it) else { return error };
        let (start, message) = (format!("{}: ", path.display()), error.value(py).to_string());
        if message.starts_with(&start) { error } else { PyValueError::new_err(start + &message) }
    })
}

/// The parameters of another program's camera, as `dofsim._cameras` reads them.
pub fn read_camera<'py, T: FromPyObjectOwned<'py>>(reader: &str, camera: &Bound<'py, PyAny>) -> PyResult<T> {
    let read = camera.py().import("dofsim._cameras")?.call_method1(reader, (camera,))?;
    read.extract().map_err(Into::into)
}

/// A Mitsuba sensor: its field of view, or a focal length that goes before it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct MitsubaSensor {
    aperture_radius: f64,
    focus_distance: f64,
    fov: f64,
    fov_axis: String,
    focal_length_mm: Option<f64>,
    principal_point_offset: [f64; 2],
}

/// A Blender camera. The size of its sensor is that along the side that `sensor_fit` names.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct BlenderCamera {
    lens_mm: f64,
    fstop: f64,
    focus_distance: f64,
    sensor_fit: String,
    sensor_mm: Option<f64>,
    aperture_ratio: f64,
}

#[pymethods]
impl PyLens {
    /// A lens of this focal length, f-number and focus distance.
    ///
    /// Parameters
    /// ----------
    /// focal_length_mm : float
    ///     Focal length in millimetres.
    /// f_number : float
    ///     Focal length over the diameter of the aperture.
    /// focus_distance : float
    ///     Distance of the plane in focus in metres; more than the focal length, may be infinite.
    /// sensor_width_mm : float, optional
    ///     Width of the sensor in millimetres; 36 unless said otherwise.
    /// sensor : str, optional
    ///     Instead of its width, its name in `dofsim.SENSORS`: ``"full frame"``, ``"aps-c"``, ``"super 35"`` ...
    /// breathing : bool, optional
    ///     Whether the field of view changes when the lens is focused elsewhere later, as if the whole lens moved. The
    ///     pinhole picture has the field of view of the focus given here.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     With ``aperture_radius = f / (2 N)`` and the field of view of a sensor at the image distance
    ///     ``v = f u / (u - f)``.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     If a value is out of range, or both sensors are given.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> lens = dofsim.Lens.from_camera(focal_length_mm=50, f_number=2.0, focus_distance=3.0)
    /// >>> round(lens.aperture_radius, 6), round(lens.fov, 3)
    /// (0.0125, 38.988)
    #[staticmethod]
    #[pyo3(signature = (*, focal_length_mm, f_number, focus_distance, sensor_width_mm=None, sensor=None,
        breathing=false))]
    fn from_camera(
        #[pyo3(from_py_with = argument::focal_length_mm)] focal_length_mm: f64,
        #[pyo3(from_py_with = argument::f_number)] f_number: f64,
        #[pyo3(from_py_with = argument::focus_distance)] focus_distance: f64,
        #[pyo3(from_py_with = argument::sensor_width_mm)] sensor_width_mm: Option<f64>,
        sensor: Option<&str>,
        breathing: bool,
    ) -> PyResult<PyLens> {
        let width_mm = match (sensor_width_mm, sensor) {
            (Some(_), Some(_)) => {
                return Err(PyTypeError::new_err("from_camera() takes one of sensor_width_mm and sensor"));
            }
            (Some(mm), None) => mm,
            (None, name) => choice("sensor", name.unwrap_or("full frame"), &SENSORS)?.width_mm,
        };
        let lens = Lens::from_camera(focal_length_mm, f_number, focus_distance, width_mm)?;
        Ok(PyLens { core: if breathing { lens.breathing()? } else { lens } })
    }

    /// A lens traced with Optiland from its prescription.
    ///
    /// Parameters
    /// ----------
    /// optic : optiland.optic.Optic
    ///     The lens in millimetres, with an aperture and a primary wavelength. It is not changed.
    /// focus_distance : float
    ///     Distance of the plane in focus from the entrance pupil in metres; may be infinite.
    /// half_diagonal_mm : float
    ///     Half the diagonal of the sensor in millimetres.
    /// field : array_like, optional
    ///     Distances from the axis that are traced, in half diagonals: 0 to 1 in steps of an eighth by default.
    /// points : int, optional
    ///     Number of points of the lens along each axis.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     With the radius of the entrance pupil, the field of view of the sensor, and the traced lens as its `psf`. The
    ///     sensor is where the image of a point in focus on the axis is smallest. Rays that apertures of the lens stop do
    ///     not arrive. Distortion is left out: the picture stays that of a pinhole.
    ///
    /// Raises
    /// ------
    /// ImportError
    ///     If Optiland is not installed, of the extra ``prescription``.
    /// ValueError
    ///     If a value is out of range, or if no light arrives at a place of the field.
    #[staticmethod]
    #[pyo3(signature = (optic, *, focus_distance, half_diagonal_mm, field=None, points=65))]
    fn from_optiland<'py>(
        optic: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = argument::focus_distance)] focus_distance: f64,
        #[pyo3(from_py_with = argument::half_diagonal_mm)] half_diagonal_mm: f64,
        field: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = argument::points)] points: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let module = optic.py().import("dofsim._prescription")?;
        module.call_method1("from_optiland", (optic, focus_distance, half_diagonal_mm, field, points))
    }

    /// The lens of a camera whose intrinsics are known in pixels, as COLMAP and OpenCV have them.
    ///
    /// Parameters
    /// ----------
    /// fx : float
    ///     Focal length in pixels.
    /// cx, cy : float, optional
    ///     Pixel coordinates of the principal point, counted from the picture's upper left corner as COLMAP does (the
    ///     centre of the first pixel is at 0.5); the middle of the picture if not given.
    /// width, height : int
    ///     Size of the picture in pixels; `height` only with `cy`.
    /// aperture_radius, focus_distance : float
    ///     As for `Lens`, in the units of the reconstruction.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     With pixels that are as high as wide, and no distortion.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If a value is out of range.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> lens = dofsim.Lens.from_colmap(fx=500.0, width=1000, aperture_radius=0.02, focus_distance=2.0)
    /// >>> lens.fov
    /// 90.0
    #[staticmethod]
    #[pyo3(signature = (*, fx, width, aperture_radius, focus_distance, cx=None, cy=None, height=None))]
    fn from_colmap(
        #[pyo3(from_py_with = argument::fx)] fx: f64,
        #[pyo3(from_py_with = argument::width)] width: usize,
        #[pyo3(from_py_with = argument::aperture_radius)] aperture_radius: f64,
        #[pyo3(from_py_with = argument::focus_distance)] focus_distance: f64,
        #[pyo3(from_py_with = argument::cx)] cx: Option<f64>,
        #[pyo3(from_py_with = argument::cy)] cy: Option<f64>,
        #[pyo3(from_py_with = argument::height)] height: Option<usize>,
    ) -> PyResult<PyLens> {
        if !(fx.is_finite() && fx > 0.0) {
            return Err(value_error!("fx must be a focal length in pixels greater than 0; got {fx}").into());
        }
        let off_middle = |name: &str, c: Option<f64>, n: Option<usize>, side: &str| match (c, n) {
            (None, _) => Ok(0.0),
            (Some(c), Some(n)) if n > 0 => Ok(c / n as f64 - 0.5),
            _ => Err(value_error!("{name} needs the {side} of the picture in pixels")),
        };
        let principal_point =
            [off_middle("cx", cx, Some(width), "width")?, off_middle("cy", cy, height, "height")?];
        let fov = 2.0 * (0.5 * width as f64 / fx).atan().to_degrees();
        let lens = Lens::thin(aperture_radius, focus_distance, fov, FovAxis::X)?;
        Ok(PyLens { core: lens.mounted(Mount { principal_point, ..Mount::PLAIN })? })
    }

    /// The lens of a Mitsuba ``thinlens`` (or ``perspective``) sensor.
    ///
    /// Parameters
    /// ----------
    /// sensor : mitsuba.Sensor, dict or path
    ///     A loaded sensor, the dictionary that one is loaded from, or an XML scene file with one sensor.
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
        of_camera(sensor, || {
            let sensor: MitsubaSensor = read_camera("mitsuba_sensor", sensor)?;
            let (fov, fov_axis) = match sensor.focal_length_mm {
                // Mitsuba's focal lengths refer to 35 mm film, and are measured along its diagonal.
                Some(mm) => (2.0 * (0.5 * 36f64.hypot(24.0) / mm).atan().to_degrees(), FovAxis::Diagonal),
                None => (sensor.fov, choice("fov_axis", &sensor.fov_axis, &FovAxis::NAMES)?),
            };
            let lens = Lens::thin(sensor.aperture_radius, sensor.focus_distance, fov, fov_axis)?;
            // The offsets give the displacement of the picture to the left and up; the axis is displaced with it.
            let principal_point = sensor.principal_point_offset.map(|offset| -offset);
            Ok(PyLens { core: lens.mounted(Mount { principal_point, ..Mount::PLAIN })? })
        })
    }

    /// The lens of a Blender camera.
    ///
    /// Parameters
    /// ----------
    /// camera : dict or path
    ///     ``lens`` (focal length in mm), ``fstop`` or ``aperture_fstop``, ``focus_distance`` (m), and optionally
    ///     ``sensor_width`` (mm, 36), ``sensor_height`` (mm, 24), ``sensor_fit`` (``"AUTO"``, ``"HORIZONTAL"``,
    ///     ``"VERTICAL"``) and ``aperture_ratio``. Or a JSON file with them. `Aperture.from_blender` takes the same.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     With ``aperture_radius = lens / (2 fstop)``, as Cycles has it; that is half the height of its aperture, and
    ///     an anamorphic one may be wider.
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
    fn from_blender(camera: &Bound<'_, PyAny>) -> PyResult<PyLens> {
        of_camera(camera, || {
            let camera: BlenderCamera = read_camera("blender_camera", camera)?;
            let (lens_mm, fstop) = (camera.lens_mm, camera.fstop);
            if !(lens_mm > 0.0 && fstop > 0.0) {
                return Err(PyValueError::new_err(format!(
                    "lens and fstop must be greater than 0; got {lens_mm} and {fstop}"
                )));
            }
            let fits = [
                ("AUTO", (FovAxis::Larger, 36.0)),
                ("HORIZONTAL", (FovAxis::X, 36.0)),
                ("VERTICAL", (FovAxis::Y, 24.0)),
            ];
            let (fov_axis, default_mm) = choice("sensor_fit", &camera.sensor_fit, &fits)?;
            let sensor_mm = camera.sensor_mm.unwrap_or(default_mm);
            let fov = 2.0 * (0.5 * sensor_mm / lens_mm).atan().to_degrees();
            // Blender divides the width of the opening by the ratio; here its longer half-axis is the radius.
            let aperture_radius = lens_mm * 1e-3 / (2.0 * fstop * camera.aperture_ratio.min(1.0));
            let lens = Lens::thin(aperture_radius, camera.focus_distance, fov, fov_axis)?;
            Ok(PyLens { core: lens.mounted(Mount { sensor_mm: Some(sensor_mm), ..Mount::PLAIN })? })
        })
    }

    /// Focal length in millimetres; None if the sensor is not known.
    #[getter]
    fn focal_length_mm(&self) -> Option<f64> {
        self.core.focal_length_mm("focal_length_mm").ok()
    }

    /// Focal length over the diameter of the aperture; None if the sensor is not known.
    #[getter]
    fn f_number(&self) -> Option<f64> {
        self.core.f_number("f_number").ok()
    }

    /// Diameter on the sensor of the circle of confusion of a point.
    ///
    /// Parameters
    /// ----------
    /// z : float
    ///     Depth of the point in metres; may be infinite.
    ///
    /// Returns
    /// -------
    /// float
    ///     Diameter in millimetres, for a point on the optical axis.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the lens does not know its sensor, or `z` is not positive.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> lens = dofsim.Lens.from_camera(focal_length_mm=50, f_number=2.0, focus_distance=2.0)
    /// >>> round(lens.coc_diameter_mm(float("inf")), 4)
    /// 0.641
    fn coc_diameter_mm(&self, #[pyo3(from_py_with = argument::z)] z: f64) -> PyResult<f64> {
        Ok(self.core.coc_diameter_mm(z)?)
    }

    /// The nearest focus, in metres, at which infinity is still sharp: ``f**2 / (N c) + f``.
    ///
    /// Parameters
    /// ----------
    /// coc_limit_mm : float
    ///     Largest diameter in millimetres on the sensor of a circle of confusion that counts as sharp; often 0.03 for
    ///     full frame.
    ///
    /// Returns
    /// -------
    /// float
    ///     Distance in metres.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the lens does not know its sensor, or the limit is not positive.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> lens = dofsim.Lens.from_camera(focal_length_mm=50, f_number=8, focus_distance=3.0)
    /// >>> round(lens.hyperfocal_distance(0.03), 3)
    /// 10.467
    fn hyperfocal_distance(
        &self,
        #[pyo3(from_py_with = argument::coc_limit_mm)] coc_limit_mm: f64,
    ) -> PyResult<f64> {
        Ok(self.core.hyperfocal_distance(coc_limit_mm)?)
    }

    /// The nearest and the farthest depth that are sharp on the optical axis, in metres.
    ///
    /// Parameters
    /// ----------
    /// coc_limit_mm : float
    ///     As for `hyperfocal_distance`.
    ///
    /// Returns
    /// -------
    /// tuple of float
    ///     Depths in metres; the second is infinite from the hyperfocal distance on.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the lens does not know its sensor, or the limit is not positive.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> lens = dofsim.Lens.from_camera(focal_length_mm=50, f_number=8, focus_distance=3.0)
    /// >>> near, far = lens.depth_of_field(0.03)
    /// >>> round(near, 3), round(far, 3)
    /// (2.338, 4.185)
    fn depth_of_field(
        &self,
        #[pyo3(from_py_with = argument::coc_limit_mm)] coc_limit_mm: f64,
    ) -> PyResult<(f64, f64)> {
        Ok(self.core.depth_of_field(coc_limit_mm)?)
    }
}
