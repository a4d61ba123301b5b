//! `dofsim.Lens`: its own parameters here, those of other cameras in [`cameras`], and its focus in [`focus`].

pub mod cameras;
pub mod focus;

use super::argument;
use super::errors::choice;
use super::hash::hash_text;
use super::lens_map::PyLensMap;
use crate::error::Result;
use crate::optics::{Aberrations, BarnDoors, Base, FovAxis, Lens, Mount, Strength, Vignetting};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::Arc;

/// A lens: its aperture, its focus, its field of view and its aberrations.
///
/// The names and units of the first four are those of Mitsuba's ``thinlens`` sensor. Other cameras come in through the
/// class methods ``from_camera``, ``from_mitsuba``, ``from_blender``, ``from_colmap`` and ``from_disparity``.
///
/// Parameters
/// ----------
/// aperture_radius : float
///     Radius of the aperture in metres; 0 is a pinhole.
/// focus_distance : float
///     Distance of the plane in focus in metres, along the optical axis; may be infinite. Of a lens with `in_focus` it is
///     ``2 / (1/near + 1/far)``, the plane that blurs both ends of the range alike.
/// fov : float
///     Field of view in degrees along `fov_axis`.
/// fov_axis : {"x", "y", "diagonal", "smaller", "larger"}, optional
///     The side of the picture that `fov` spans.
/// in_focus : tuple of float, optional
///     In place of `focus_distance`, a range in focus: the distances in metres of its nearer and its farther end, which
///     may be infinite. What lies within it is sharp, and the blur of the rest is measured from the end that is nearer
///     to it. No real lens does that; it is for a face, a product or a group that has to be sharp all over. With `tilt`
///     and `field_curvature` the ends are those on the optical axis.
/// tilt : tuple of float, optional
///     Angles in degrees by which the plane in focus leans about a horizontal and about a vertical axis through the
///     point in focus on the optical axis: its top away from the camera, and its right side away from it.
/// field_curvature : float, optional
///     Curvature of the image surface in 1/m. At the angle ``a`` to the axis the disparity in focus is larger by
///     ``field_curvature / 2 * tan(a)**2``: with ``1 / focus_distance`` a sphere about the lens is in focus.
/// axial_color : tuple of float, optional
///     What is added to the disparity in focus, ``1 / focus_distance``, for red, green and blue, in 1/m (dioptres). A
///     lens whose focal length is shorter by ``df`` for blue has ``df / f**2`` there.
/// lateral_color : tuple of float, optional
///     By how much of themselves the red, green and blue pictures are larger, at most 0.1: 0.001 moves the corner of a
///     picture 2000 pixels wide and high by 1.4 pixels.
/// cat_eye : float, optional
///     How far a second stop, as large as the aperture, seems to move across it from the middle of the picture to its
///     corners, in radii of the aperture, 0 to 1. It clips what is drawn of points away from the middle.
/// coma : float, optional
///     Length of the comets that points near the corners are drawn as, in half diagonals of the picture, -0.25 to 0.25: a
///     positive one has its tail away from the middle. It is that of this aperture, in focus or not, and grows linearly
///     from the middle to the corners. A lens that is stopped down to a part of its radius has the square of that of it.
/// astigmatism : float, optional
///     Length, from its middle, of the lines that points in the corners are drawn as where their rays meet in one direction
///     only, in half diagonals, -0.25 to 0.25; it grows with the square of the distance from the middle. A positive one
///     has lines around the middle in front of the focus and lines away from it behind, where a point in focus is a disc.
/// barn_doors : tuple of float, optional
///     A rectangular stop in front of the lens: half its width and half its height in radii of the aperture, and how
///     far it seems to move across the aperture from the middle of the picture to its corners, in radii, 0 to 1. It
///     clips what is drawn of points, and does not darken the picture.
/// psf : LensMap, optional
///     A measured or traced lens, in place of `coma` and `astigmatism`.
/// vignetting : {"none", "optical", "natural", "full"}, optional
///     Whether the picture is darker away from its middle: by what `cat_eye` clips, by the fourth power of the cosine
///     of the angle to the axis, or by both.
/// principal_point : tuple of float, optional
///     Where the optical axis meets the picture: widths to the right of its middle and heights below it.
/// sensor_mm : float, optional
///     Length of the sensor in millimetres along `fov_axis`, for what is asked in millimetres.
/// breathing_focal_length_mm : float, optional
///     Focal length in millimetres of a lens that breathes: focused nearer, its image is farther from it and larger.
///     `fov` stays that of the pinhole picture. Needs `sensor_mm`.
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
/// linear in disparity, and what is in focus is a plane that faces the camera, unless `tilt` or `field_curvature` say
/// otherwise. With `in_focus` it is ``aperture_radius * focal_px * |d - clip(d, 1/far, 1/near)|``. By Scheimpflug's rule a plane that leans by ``a`` is in focus when the lens is tilted by
/// ``atan(v * tan(a) / (u + v))``, where ``u`` and ``v`` are the distances of the focus and of the sensor.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
/// >>> lens.replace(focus_distance=5.0, tilt=(60.0, 0.0))
/// Lens(aperture_radius=0.05, focus_distance=5.0, fov=42.0, fov_axis='x', tilt=(60.0, 0.0))
/// >>> lens.replace(in_focus=(2.0, 2.6))
/// Lens(aperture_radius=0.05, in_focus=(2.0, 2.6), fov=42.0, fov_axis='x')
#[pyclass(name = "Lens", module = "dofsim", frozen, eq)]
#[derive(Debug, Clone, PartialEq)]
pub struct PyLens {
    pub core: Lens,
}

/// A number for each axis of the picture.
type Pair = (f64, f64);
/// Red, green and blue.
type Triple = (f64, f64, f64);

#[pymethods]
impl PyLens {
    #[new]
    #[pyo3(signature = (*, aperture_radius, focus_distance=None, fov, fov_axis="x", in_focus=None,
        tilt=(0.0, 0.0), field_curvature=0.0, axial_color=(0.0, 0.0, 0.0), lateral_color=(0.0, 0.0, 0.0),
        cat_eye=0.0, coma=0.0, astigmatism=0.0, barn_doors=None, psf=None, vignetting="none",
        principal_point=(0.0, 0.0), sensor_mm=None, breathing_focal_length_mm=None),
        text_signature = "(*, aperture_radius, focus_distance=None, fov, fov_axis='x', in_focus=None, \
            tilt=(0.0, 0.0), field_curvature=0.0, axial_color=(0.0, 0.0, 0.0), lateral_color=(0.0, 0.0, 0.0), \
            cat_eye=0.0, coma=0.0, astigmatism=0.0, barn_doors=None, psf=None, vignetting='none', \
            principal_point=(0.0, 0.0), sensor_mm=None, \
            breathing_focal_length_mm=None)")]
    #[expect(clippy::too_many_arguments, reason = "the public constructor's own, keyword-only in Python")]
    fn new(
        #[pyo3(from_py_with = argument::aperture_radius)] aperture_radius: f64,
        #[pyo3(from_py_with = argument::focus_distance)] focus_distance: Option<f64>,
        #[pyo3(from_py_with = argument::fov)] fov: f64,
        fov_axis: &str,
        #[pyo3(from_py_with = argument::in_focus)] in_focus: Option<[f64; 2]>,
        #[pyo3(from_py_with = argument::tilt)] tilt: Pair,
        #[pyo3(from_py_with = argument::field_curvature)] field_curvature: f64,
        #[pyo3(from_py_with = argument::axial_color)] axial_color: Triple,
        #[pyo3(from_py_with = argument::lateral_color)] lateral_color: Triple,
        #[pyo3(from_py_with = argument::cat_eye)] cat_eye: f64,
        #[pyo3(from_py_with = argument::coma)] coma: f64,
        #[pyo3(from_py_with = argument::astigmatism)] astigmatism: f64,
        #[pyo3(from_py_with = argument::barn_doors)] barn_doors: Option<Triple>,
        psf: Option<PyRef<'_, PyLensMap>>,
        vignetting: &str,
        #[pyo3(from_py_with = argument::principal_point)] principal_point: Pair,
        #[pyo3(from_py_with = argument::sensor_mm)] sensor_mm: Option<f64>,
        #[pyo3(from_py_with = argument::breathing_focal_length_mm)] breathing_focal_length_mm: Option<f64>,
    ) -> PyResult<PyLens> {
        let fov_axis = choice("fov_axis", fov_axis, &FovAxis::NAMES)?;
        let mount = Mount {
            tilt_deg: tilt.into(),
            principal_point: principal_point.into(),
            sensor_mm,
            breathing_focal_length_mm,
        };
        let aberrations = Aberrations {
            field_curvature,
            axial_color: axial_color.into(),
            lateral_color: lateral_color.into(),
            cat_eye,
            vignetting: choice("vignetting", vignetting, &Vignetting::NAMES)?,
            coma,
            astigmatism,
            barn_doors: barn_doors.map(doors),
            psf: psf.map(|map| Arc::clone(&map.core)),
        };
        let lens = match (focus_distance, in_focus) {
            (Some(distance), None) => Lens::thin(aperture_radius, distance, fov, fov_axis),
            (None, Some(range)) => {
                Lens::thin(aperture_radius, f64::INFINITY, fov, fov_axis)?.focused_over(range)
            }
            _ => return Err(PyTypeError::new_err("Lens() takes one of focus_distance and in_focus")),
        }?;
        Ok(PyLens { core: lens.mounted(mount)?.with_aberrations(aberrations)? })
    }

    /// A lens for relative disparity, such as a monocular depth network gives: it has no metres.
    ///
    /// Parameters
    /// ----------
    /// strength_px : float, optional
    ///     Radius of the circle of confusion in pixels per unit of disparity.
    /// strength_percent : float, optional
    ///     The same in per cent of the picture's width; one of the two must be given.
    /// focus : float
    ///     The disparity in focus. Of a lens with `in_focus` it is the middle of the range.
    /// in_focus : tuple of float, optional
    ///     In place of `focus`, a range in focus as of `Lens`: the disparities of its nearer end, which is the larger, and
    ///     of its farther end.
    /// axial_color, lateral_color, cat_eye, coma, astigmatism, barn_doors, psf, vignetting, principal_point : optional
    ///     As for `Lens`, but that `axial_color` is in units of the disparity; no ``"natural"`` vignetting.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     For use with ``depth_kind="disparity"``, or with ``"relative"``, which first brings disparity of any scale
    ///     to 0 (far) to 1 (near): then the strength is the blur over the whole depth of the scene.
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
    #[pyo3(signature = (*, strength_px=None, strength_percent=None, focus=None, in_focus=None,
        axial_color=(0.0, 0.0, 0.0), lateral_color=(0.0, 0.0, 0.0), cat_eye=0.0, coma=0.0, astigmatism=0.0,
        barn_doors=None, psf=None, vignetting="none", principal_point=(0.0, 0.0)),
        text_signature = "(*, strength_px=None, strength_percent=None, focus=None, in_focus=None, \
            axial_color=(0.0, 0.0, 0.0), lateral_color=(0.0, 0.0, 0.0), cat_eye=0.0, coma=0.0, astigmatism=0.0, \
            barn_doors=None, psf=None, vignetting='none', principal_point=(0.0, 0.0))")]
    #[expect(clippy::too_many_arguments, reason = "the public constructor's own, keyword-only in Python")]
    fn from_disparity(
        #[pyo3(from_py_with = argument::strength_px)] strength_px: Option<f64>,
        #[pyo3(from_py_with = argument::strength_percent)] strength_percent: Option<f64>,
        #[pyo3(from_py_with = argument::focus)] focus: Option<f64>,
        #[pyo3(from_py_with = argument::in_focus)] in_focus: Option<[f64; 2]>,
        #[pyo3(from_py_with = argument::axial_color)] axial_color: Triple,
        #[pyo3(from_py_with = argument::lateral_color)] lateral_color: Triple,
        #[pyo3(from_py_with = argument::cat_eye)] cat_eye: f64,
        #[pyo3(from_py_with = argument::coma)] coma: f64,
        #[pyo3(from_py_with = argument::astigmatism)] astigmatism: f64,
        #[pyo3(from_py_with = argument::barn_doors)] barn_doors: Option<Triple>,
        psf: Option<PyRef<'_, PyLensMap>>,
        vignetting: &str,
        #[pyo3(from_py_with = argument::principal_point)] principal_point: Pair,
    ) -> PyResult<PyLens> {
        let strength = match (strength_px, strength_percent) {
            (Some(px), None) => Strength::Px(px),
            (None, Some(percent)) => Strength::Percent(percent),
            _ => {
                return Err(PyTypeError::new_err(
                    "from_disparity() takes one of strength_px and strength_percent",
                ));
            }
        };
        let mount = Mount { principal_point: principal_point.into(), ..Mount::PLAIN };
        let aberrations = Aberrations {
            axial_color: axial_color.into(),
            lateral_color: lateral_color.into(),
            cat_eye,
            vignetting: choice("vignetting", vignetting, &Vignetting::NAMES)?,
            coma,
            astigmatism,
            barn_doors: barn_doors.map(doors),
            psf: psf.map(|map| Arc::clone(&map.core)),
            ..Aberrations::NONE
        };
        let lens = match (focus, in_focus) {
            (Some(disparity), None) => Lens::from_disparity(strength, disparity),
            (None, Some(range)) => Lens::from_disparity(strength, 0.0)?.focused_over(range),
            _ => return Err(PyTypeError::new_err("from_disparity() takes one of focus and in_focus")),
        }?;
        Ok(PyLens { core: lens.mounted(mount)?.with_aberrations(aberrations)? })
    }

    /// Radius of the aperture in metres; None for a lens over relative disparity.
    #[getter]
    fn aperture_radius(&self) -> Option<f64> {
        match self.core.base {
            Base::Thin { aperture_radius, .. } => Some(aperture_radius),
            Base::Relative { .. } => None,
        }
    }

    /// Distance in focus in metres; None for a lens over relative disparity.
    #[getter]
    fn focus_distance(&self) -> Option<f64> {
        match self.core.base {
            Base::Thin { focus_distance, .. } => Some(focus_distance),
            Base::Relative { .. } => None,
        }
    }

    /// Field of view in degrees; None for a lens over relative disparity.
    #[getter]
    fn fov(&self) -> Option<f64> {
        match self.core.base {
            Base::Thin { fov, .. } => Some(fov),
            Base::Relative { .. } => None,
        }
    }

    /// The side that the field of view spans; None for a lens over relative disparity.
    #[getter]
    fn fov_axis(&self) -> Option<&'static str> {
        match self.core.base {
            Base::Thin { fov_axis, .. } => name_of(fov_axis, &FovAxis::NAMES),
            Base::Relative { .. } => None,
        }
    }

    /// Blur radius in pixels per unit of disparity; None for other lenses.
    #[getter]
    fn strength_px(&self) -> Option<f64> {
        match self.core.base {
            Base::Relative { strength: Strength::Px(px), .. } => Some(px),
            _ => None,
        }
    }

    /// Blur radius in per cent of the picture's width per unit of disparity; None for other lenses.
    #[getter]
    fn strength_percent(&self) -> Option<f64> {
        match self.core.base {
            Base::Relative { strength: Strength::Percent(percent), .. } => Some(percent),
            _ => None,
        }
    }

    /// The disparity in focus; None for a metric lens.
    #[getter]
    fn focus(&self) -> Option<f64> {
        match self.core.base {
            Base::Thin { .. } => None,
            Base::Relative { focus_disparity, .. } => Some(focus_disparity),
        }
    }

    /// The nearer and the farther end of the range in focus; None if a plane is in focus.
    #[getter]
    fn in_focus(&self) -> Option<Pair> {
        self.core.in_focus.map(Pair::from)
    }

    /// Angles in degrees by which the plane in focus leans.
    #[getter]
    fn tilt(&self) -> Pair {
        self.core.mount.tilt_deg.into()
    }

    /// Curvature of the image surface in 1/m.
    #[getter]
    fn field_curvature(&self) -> f64 {
        self.core.aberrations.field_curvature
    }

    /// What is added to the disparity in focus for red, green and blue, in 1/m.
    #[getter]
    fn axial_color(&self) -> Triple {
        self.core.aberrations.axial_color.into()
    }

    /// By how much of themselves the red, green and blue pictures are larger.
    #[getter]
    fn lateral_color(&self) -> Triple {
        self.core.aberrations.lateral_color.into()
    }

    /// How far the second stop moves to the corners, in radii of the aperture.
    #[getter]
    fn cat_eye(&self) -> f64 {
        self.core.aberrations.cat_eye
    }

    /// Length of comets in the corners, in half diagonals.
    #[getter]
    fn coma(&self) -> f64 {
        self.core.aberrations.coma
    }

    /// Length of lines in the corners, in half diagonals.
    #[getter]
    fn astigmatism(&self) -> f64 {
        self.core.aberrations.astigmatism
    }

    /// The rectangular stop: half its width and its height, and how far it moves; None without one.
    #[getter]
    fn barn_doors(&self) -> Option<Triple> {
        self.core.aberrations.barn_doors.map(|BarnDoors { half, moves }| (half[0], half[1], moves))
    }

    /// The measured or traced lens, or None.
    #[getter]
    fn psf(&self) -> Option<PyLensMap> {
        self.core.aberrations.psf.as_ref().map(|map| PyLensMap { core: Arc::clone(map) })
    }

    /// How the picture darkens away from its middle.
    #[getter]
    fn vignetting(&self) -> Option<&'static str> {
        name_of(self.core.aberrations.vignetting, &Vignetting::NAMES)
    }

    /// Where the optical axis meets the picture, from its middle.
    #[getter]
    fn principal_point(&self) -> Pair {
        self.core.mount.principal_point.into()
    }

    /// Length of the sensor in millimetres along the field of view, if it is known.
    #[getter]
    fn sensor_mm(&self) -> Option<f64> {
        self.core.mount.sensor_mm
    }

    /// Focal length in millimetres of a lens that breathes.
    #[getter]
    fn breathing_focal_length_mm(&self) -> Option<f64> {
        self.core.mount.breathing_focal_length_mm
    }

    /// The same lens with some values changed.
    ///
    /// Parameters
    /// ----------
    /// **changes
    ///     Any arguments of the constructor that made the lens: those of `Lens`, or of `Lens.from_disparity`. A plane in
    ///     focus replaces a range, and a range a plane.
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
        let words = self.arguments(py)?;
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
        // A plane in focus replaces a range, and a range a plane, unless both are given.
        let plane = self.focus_word();
        for (word, other) in [(plane, "in_focus"), ("in_focus", plane)] {
            let given = |name: &str| changes.map_or(Ok(None), |changes| changes.get_item(name));
            if given(word)?.is_some_and(|value| !value.is_none()) && given(other)?.is_none() {
                words.set_item(other, py.None())?;
            }
        }
        self.constructor(py)?
            .call((), Some(&words))?
            .extract::<PyRef<'_, PyLens>>()
            .map(|l| l.clone())
            .map_err(PyErr::from)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        // Parameters with their default value are left out, except for those of the thin lens itself; None is always a
        // default.
        let (words, plain) = (self.arguments(py)?, self.plain().arguments(py)?);
        let own = match self.core.base {
            Base::Thin { .. } => 5,
            Base::Relative { .. } => 3,
        };
        let mut shown = Vec::new();
        for (i, (key, value)) in words.iter().enumerate() {
            if value.is_none() {
                continue;
            }
            let default = plain.get_item(&key)?;
            if i < own || !default.map_or(Ok(false), |default| default.eq(&value))? {
                // Python writes an infinite float as `inf`, which is not an expression. No word contains that.
                let value = value.repr()?.to_string().replace("inf", "float('inf')");
                shown.push(format!("{key}={value}"));
            }
        }
        let constructor = match self.core.base {
            Base::Thin { .. } => "Lens",
            Base::Relative { .. } => "Lens.from_disparity",
        };
        Ok(format!("{constructor}({})", shown.join(", ")))
    }

    /// What a notebook shows: the words of the lens, and how blur grows with the distance.
    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("dofsim._display")?.call_method1("lens_html", (slf,))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(hash_text(&self.__repr__(py)?))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        // functools.partial passes the keyword-only arguments.
        let partial = py.import("functools")?.getattr("partial")?;
        let call = partial.call((self.constructor(py)?,), Some(&self.arguments(py)?))?;
        Ok((call, PyTuple::empty(py)))
    }
}

/// The rectangular stop of half a width, half a height, and how far it moves.
fn doors((width, height, moves): Triple) -> BarnDoors {
    BarnDoors { half: [width, height], moves }
}

/// The public name of a choice.
fn name_of<T: Copy + PartialEq>(value: T, names: &[(&'static str, T)]) -> Option<&'static str> {
    names.iter().find(|(_, own)| *own == value).map(|(name, _)| *name)
}

impl PyLens {
    /// The same lens without a mount and without aberrations.
    fn plain(&self) -> PyLens {
        PyLens { core: Lens { mount: Mount::PLAIN, aberrations: Aberrations::NONE, ..self.core.clone() } }
    }

    /// The lens that is meant, with a range in focus in place of its own focus if there is one.
    pub fn with_range(&self, in_focus: Option<[f64; 2]>) -> Result<Lens> {
        in_focus.map_or_else(|| Ok(self.core.clone()), |range| self.core.focused_over(range))
    }

    /// The constructor of such a lens.
    fn constructor<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let class = py.get_type::<PyLens>();
        match self.core.base {
            Base::Thin { .. } => Ok(class.into_any()),
            Base::Relative { .. } => class.getattr("from_disparity"),
        }
    }

    /// The argument of that constructor that is a plane in focus.
    fn focus_word(&self) -> &'static str {
        match self.core.base {
            Base::Thin { .. } => "focus_distance",
            Base::Relative { .. } => "focus",
        }
    }

    /// The arguments of that constructor.
    fn arguments<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let words = PyDict::new(py);
        let plane = |focus: f64| self.core.in_focus.is_none().then_some(focus);
        match self.core.base {
            Base::Thin { aperture_radius, focus_distance, fov, .. } => {
                words.set_item("aperture_radius", aperture_radius)?;
                words.set_item("focus_distance", plane(focus_distance))?;
                words.set_item("in_focus", self.in_focus())?;
                words.set_item("fov", fov)?;
                words.set_item("fov_axis", self.fov_axis())?;
                words.set_item("tilt", self.tilt())?;
                words.set_item("field_curvature", self.field_curvature())?;
                words.set_item("sensor_mm", self.sensor_mm())?;
                words.set_item("breathing_focal_length_mm", self.breathing_focal_length_mm())?;
            }
            Base::Relative { strength, focus_disparity } => {
                match strength {
                    Strength::Px(px) => words.set_item("strength_px", px)?,
                    Strength::Percent(percent) => words.set_item("strength_percent", percent)?,
                }
                words.set_item("focus", plane(focus_disparity))?;
                words.set_item("in_focus", self.in_focus())?;
            }
        }
        words.set_item("axial_color", self.axial_color())?;
        words.set_item("lateral_color", self.lateral_color())?;
        words.set_item("cat_eye", self.cat_eye())?;
        words.set_item("coma", self.coma())?;
        words.set_item("astigmatism", self.astigmatism())?;
        words.set_item("barn_doors", self.barn_doors())?;
        words.set_item("psf", self.psf())?;
        words.set_item("vignetting", self.vignetting())?;
        words.set_item("principal_point", self.principal_point())?;
        Ok(words)
    }
}
