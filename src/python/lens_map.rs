//! `dofsim.LensMap`.

use super::argument;
use super::errors::shown;
use super::hash::hash_text;
use super::samples::array;
use crate::error::value_error;
use crate::optics::LensMap;
use numpy::{PyArray1, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray4, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt;
use std::sync::Arc;

/// A lens as it was measured or traced: where the rays through its points land on the sensor.
///
/// Parameters
/// ----------
/// field : array_like
///     Distances of places of the picture from the optical axis in half diagonals, shape (F,), rising: 0 is the middle, 1
///     a corner. Between them the lens changes linearly, and beyond the first and the last one not at all.
/// behind : array_like
///     Where rays of a point behind the focus land, shape (F, N, N, 2): for each place, row and column of N x N points of
///     the lens, the offset along the picture's rows and down its columns, in radii of the thin lens's circle of confusion.
///     The places are to the right of the axis; the lens is taken for rotationally symmetric. The points fill the
///     square around the round aperture evenly, from -1 to 1 in units of its radius, with the picture's axes. Where
///     no light arrives there is NaN; corners outside of the circle do not matter.
/// in_front : array_like, optional
///     The same for points in front of the focus, turned by 180 degrees: like `behind`, which it is by default, it is the
///     lens point itself for a thin lens.
/// focused : array_like, optional
///     The offsets of rays of a point in focus, in half diagonals of the picture; 0 by default. Those of other points are
///     added to them.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If the arrays do not fit together, or rays land too far away; the text names the argument and what is accepted.
///
/// Notes
/// -----
/// Offsets of one lens point are a linear function of disparity on each side of the focus, so three maps describe all
/// distances. The mean brightness stays that of the thin lens: light that does not arrive changes the shape of a blurred
/// point, not the exposure.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> at = np.linspace(-1, 1, 33)
/// >>> points = np.stack(np.meshgrid(at, at), axis=-1)
/// >>> thin = dofsim.LensMap([0.0], points[None])
/// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0, psf=thin)
#[pyclass(name = "LensMap", module = "dofsim", frozen, eq)]
#[derive(Debug, Clone, PartialEq)]
pub struct PyLensMap {
    pub core: Arc<LensMap>,
}

/// The fields of a lens map, and what lands behind the focus.
type Places<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray4<f64>>);

/// Offsets of a lens map.
type Offsets<'py> = PyReadonlyArray4<'py, f64>;

/// An array of floats with so many dimensions, from anything that is like one.
fn floats<'py, T: FromPyObjectOwned<'py>>(name: &str, shape: &str, given: &Bound<'py, PyAny>) -> PyResult<T> {
    let numpy = given.py().import("numpy")?;
    let words = PyDict::new(given.py());
    words.set_item("dtype", "float64")?;
    let refused = |got: String| value_error!("{name} must be numbers of shape {shape}; got {got}");
    let read = numpy.call_method("ascontiguousarray", (given,), Some(&words));
    let read = read.map_err(|_| refused(shown(given)))?;
    let own = array(name, &read)?.shape().to_vec();
    read.extract().map_err(|_| refused(format!("{own:?}")).into())
}

impl fmt::Display for PyLensMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (field, across, given) = self.core.parts();
        let bits: Vec<String> = given.iter().map(|v| format!("{:x}", (v + 0.0).to_bits())).collect();
        let print = hash_text(&bits.join(","));
        write!(f, "LensMap({field:?}, <{across} x {across}, {print:016x}>)")
    }
}

impl PyLensMap {
    /// Two of the six numbers of each node, as an array.
    fn part<'py>(&self, py: Python<'py>, first: usize) -> PyResult<Bound<'py, PyArray4<f64>>> {
        let (field, across, given) = self.core.parts();
        let values = given.chunks_exact(6).flat_map(|node| node[first..first + 2].to_vec());
        PyArray1::from_iter(py, values).reshape([field.len(), across, across, 2])
    }
}

#[pymethods]
impl PyLensMap {
    #[new]
    #[pyo3(signature = (field, behind, *, in_front=None, focused=None))]
    fn new(
        field: &Bound<'_, PyAny>,
        behind: &Bound<'_, PyAny>,
        in_front: Option<&Bound<'_, PyAny>>,
        focused: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyLensMap> {
        let heights: PyReadonlyArray1<f64> = floats("field", "(F,)", field)?;
        let heights = heights.as_array().to_vec();
        let of = |name: &str, given: &Bound<'_, PyAny>| -> PyResult<Vec<f64>> {
            let offsets: Offsets = floats(name, "(F, N, N, 2)", given)?;
            let shape = offsets.shape();
            let across = shape[1];
            if shape != [heights.len(), across, across, 2] || !(2..=1025).contains(&across) {
                return Err(value_error!(
                    "{name} must have shape (F, N, N, 2) with {} places as field and N from 2 to 1025; got {shape:?}",
                    heights.len()
                )
                .into());
            }
            Ok(offsets.as_array().iter().copied().collect())
        };
        let far = of("behind", behind)?;
        let across = ((far.len() / 2 / heights.len().max(1)) as f64).sqrt().round() as usize;
        let other = |name: &str, given: Option<&Bound<'_, PyAny>>, default: &dyn Fn() -> Vec<f64>| {
            let offsets = given.map_or_else(|| Ok(default()), |given| of(name, given))?;
            if offsets.len() != far.len() {
                return Err(PyErr::from(value_error!(
                    "{name} must have the shape of behind, ({}, {across}, {across}, 2)",
                    heights.len()
                )));
            }
            Ok(offsets)
        };
        let near = other("in_front", in_front, &|| far.clone())?;
        let sharp = other("focused", focused, &|| vec![0.0; far.len()])?;
        let nodes = sharp.chunks_exact(2).zip(near.chunks_exact(2)).zip(far.chunks_exact(2));
        let given = nodes.flat_map(|((a, b), c)| [a, b, c].concat()).collect();
        Ok(PyLensMap { core: Arc::new(LensMap::new(heights, across, given)?) })
    }

    /// A lens of pictures of blurred points, such as measurements give.
    ///
    /// Parameters
    /// ----------
    /// field : array_like
    ///     Distances from the axis in half diagonals, shape (F,), rising.
    /// behind : array_like
    ///     Pictures of a point behind the focus at places to the right of the axis, shape (F, H, W), not negative. Each
    ///     is the square around the circle of confusion of the thin lens, centred on the ray through the middle of the
    ///     lens; only the ratios of its values matter.
    /// in_front : array_like, optional
    ///     The same for a point in front of the focus, as it is seen; by default `behind`, turned by 180 degrees.
    /// focused : array_like, optional
    ///     The same for a point in focus. Its square is `focused_size` half diagonals wide.
    /// focused_size : float, optional
    ///     The width of the pictures of a point in focus.
    /// points : int, optional
    ///     Number of lens points along each axis.
    ///
    /// Returns
    /// -------
    /// LensMap
    ///     Pictures do not tell which lens point a ray has come through. It is taken for the one that keeps the order of
    ///     light: by rows, and within a row by columns. So what hides the upper part of the lens hides the upper part
    ///     of the picture.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If a picture is empty, negative or dark.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> import numpy as np
    /// >>> at = (np.arange(64) + 0.5) / 32 - 1
    /// >>> ring = (np.hypot(at, at[:, None]) <= 1) * (0.3 + np.hypot(at, at[:, None]) ** 8)
    /// >>> lens_map = dofsim.LensMap.from_pictures([0.0], ring[None])
    #[staticmethod]
    #[pyo3(signature = (field, behind, *, in_front=None, focused=None, focused_size=None, points=65))]
    fn from_pictures<'py>(
        field: &Bound<'py, PyAny>,
        behind: &Bound<'py, PyAny>,
        in_front: Option<&Bound<'py, PyAny>>,
        focused: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = argument::focused_size)] focused_size: Option<f64>,
        #[pyo3(from_py_with = argument::points)] points: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let module = field.py().import("dofsim._lens_map")?;
        module.call_method1("from_pictures", (field, behind, in_front, focused, focused_size, points))
    }

    /// Read a map from a file that `save` has written.
    ///
    /// Parameters
    /// ----------
    /// path : path
    ///     A NumPy archive, ``.npz``, of the arrays by their names.
    ///
    /// Returns
    /// -------
    /// LensMap
    ///     The map.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If it is no such file.
    /// OSError
    ///     If it cannot be read.
    #[staticmethod]
    fn load<'py>(path: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        path.py().import("dofsim._lens_map")?.call_method1("load", (path,))
    }

    /// Write the map to a file, for `load` and for the word ``psf`` in a file of a lens.
    ///
    /// Parameters
    /// ----------
    /// path : path
    ///     A NumPy archive, ``.npz``.
    ///
    /// Raises
    /// ------
    /// OSError
    ///     If it cannot be written.
    fn save(slf: &Bound<'_, Self>, path: &Bound<'_, PyAny>) -> PyResult<()> {
        slf.py().import("dofsim._lens_map")?.call_method1("save", (slf, path))?;
        Ok(())
    }

    /// Distances from the axis in half diagonals, float64, shape (F,).
    #[getter]
    fn field<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.core.parts().0)
    }

    /// Offsets behind the focus, as they were given.
    #[getter]
    fn behind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray4<f64>>> {
        self.part(py, 4)
    }

    /// Offsets in front of the focus, as they were given.
    #[getter]
    fn in_front<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray4<f64>>> {
        self.part(py, 2)
    }

    /// Offsets in focus, as they were given.
    #[getter]
    fn focused<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray4<f64>>> {
        self.part(py, 0)
    }

    fn __repr__(&self) -> String {
        self.to_string()
    }

    fn __hash__(&self) -> u64 {
        hash_text(&self.to_string())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Places<'py>, Bound<'py, PyDict>)> {
        let words = PyDict::new(py);
        words.set_item("in_front", self.in_front(py)?)?;
        words.set_item("focused", self.focused(py)?)?;
        Ok(((self.field(py), self.behind(py)?), words))
    }
}
