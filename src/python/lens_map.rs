//! `dofsim.LensMap`.

use super::argument;
use super::errors::shown;
use super::hash::hash_text;
use super::samples::array;
use crate::error::value_error;
use crate::optics::{Fields, LensMap};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::fmt;
use std::sync::Arc;

/// A lens as it was measured or traced: where the rays through its points land on the sensor.
///
/// Parameters
/// ----------
/// field : array_like, or tuple of two
///     Distances of places of the picture from the optical axis in half diagonals, shape (F,), rising: 0 is the middle, 1
///     a corner. Between them the lens changes linearly, and beyond the first and the last one not at all. Of a lens that is
///     not rotationally symmetric, a pair (x, y) of columns and rows of places, shapes (X,) and (Y,), to the right of the
///     axis and below it.
/// behind : array_like
///     Where rays of a point behind the focus land, shape (F, N, N, 2): for each place, row and column of N x N points of
///     the lens, the offset along the picture's rows and down its columns, in radii of the thin lens's circle of confusion.
///     The places are to the right of the axis; the lens is taken for rotationally symmetric. Of a pair (x, y), the shape is
///     (Y, X, N, N, 2), and each place has its own map. The points fill the
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
type Places<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Places, as a list of numbers or as a pair of such.
fn read_fields(given: &Bound<'_, PyAny>) -> PyResult<Fields> {
    let places = |name: &str, shape: &str, given: &Bound<'_, PyAny>| -> PyResult<Vec<f64>> {
        let places: PyReadonlyArray1<f64> = floats(name, shape, given)?;
        Ok(places.as_array().to_vec())
    };
    match given.cast::<PyTuple>() {
        Ok(pair) if pair.len() == 2 && pair.iter().all(|axis| axis.extract::<f64>().is_err()) => {
            let axis = |i: usize, name: &str, shape: &str| places(name, shape, &pair.get_item(i)?);
            Ok(Fields::Grid([axis(0, "x of field", "(X,)")?, axis(1, "y of field", "(Y,)")?]))
        }
        _ => Ok(Fields::Heights(places("field", "(F,)", given)?)),
    }
}

/// The shape of offsets at these places, for points along each axis.
fn shape_of(fields: &Fields, across: usize) -> Vec<usize> {
    let places = match fields {
        Fields::Heights(heights) => vec![heights.len()],
        Fields::Grid([x, y]) => vec![y.len(), x.len()],
    };
    [&places[..], &[across, across, 2]].concat()
}

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
        let (fields, across, given) = self.core.parts();
        let field = match fields {
            Fields::Heights(heights) => format!("{heights:?}"),
            Fields::Grid([x, y]) => format!("({x:?}, {y:?})"),
        };
        let bits: Vec<String> = given.iter().map(|v| format!("{:x}", (v + 0.0).to_bits())).collect();
        let print = hash_text(&bits.join(","));
        write!(f, "LensMap({field}, <{across} x {across}, {print:016x}>)")
    }
}

impl PyLensMap {
    /// Two of the six numbers of each node, as an array.
    fn part<'py>(&self, py: Python<'py>, first: usize) -> PyResult<Bound<'py, PyAny>> {
        let (fields, across, given) = self.core.parts();
        let values = given.chunks_exact(6).flat_map(|node| node[first..first + 2].to_vec());
        Ok(PyArray1::from_iter(py, values).reshape(shape_of(fields, across))?.into_any())
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
        let fields = read_fields(field)?;
        let (shape, places) = match &fields {
            Fields::Heights(heights) => ("(F, N, N, 2)", format!("{} places", heights.len())),
            Fields::Grid([x, y]) => ("(Y, X, N, N, 2)", format!("{} x {} places", y.len(), x.len())),
        };
        let of = |name: &str, given: &Bound<'_, PyAny>| -> PyResult<(usize, Vec<f64>)> {
            let offsets: PyReadonlyArrayDyn<f64> = floats(name, shape, given)?;
            let own = offsets.shape();
            let across = own.get(own.len().saturating_sub(2)).copied().unwrap_or(0);
            if own.len() != shape_of(&fields, across).len() {
                return Err(value_error!("{name} must be numbers of shape {shape}; got {own:?}").into());
            }
            if own != shape_of(&fields, across) || !(2..=1025).contains(&across) {
                return Err(value_error!(
                    "{name} must have shape {shape} with {places} as field and N from 2 to 1025; got {own:?}"
                )
                .into());
            }
            Ok((across, offsets.as_array().iter().copied().collect()))
        };
        let (across, far) = of("behind", behind)?;
        let other = |name: &str, given: Option<&Bound<'_, PyAny>>, default: &dyn Fn() -> Vec<f64>| {
            let (own, offsets) = given.map_or_else(|| Ok((across, default())), |given| of(name, given))?;
            if own != across {
                return Err(PyErr::from(value_error!(
                    "{name} must have the shape of behind, {:?}",
                    shape_of(&fields, across)
                )));
            }
            Ok(offsets)
        };
        let near = other("in_front", in_front, &|| far.clone())?;
        let sharp = other("focused", focused, &|| vec![0.0; far.len()])?;
        let nodes = sharp.chunks_exact(2).zip(near.chunks_exact(2)).zip(far.chunks_exact(2));
        let given = nodes.flat_map(|((a, b), c)| [a, b, c].concat()).collect();
        Ok(PyLensMap { core: Arc::new(LensMap::new(fields, across, given)?) })
    }

    /// A lens of pictures of blurred points, such as measurements give.
    ///
    /// Parameters
    /// ----------
    /// field : array_like, or tuple of two
    ///     Distances from the axis in half diagonals, shape (F,), rising; or columns and rows (x, y), as for `LensMap`.
    /// behind : array_like
    ///     Pictures of a point behind the focus at places to the right of the axis, shape (F, H, W), not negative; of a pair
    ///     (x, y), at each of its places, shape (Y, X, H, W). Each
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

    /// Distances from the axis in half diagonals, float64, shape (F,); or a pair (x, y), shapes (X,) and (Y,).
    #[getter]
    fn field<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(match self.core.parts().0 {
            Fields::Heights(heights) => PyArray1::from_slice(py, heights).into_any(),
            Fields::Grid(grid) => {
                PyTuple::new(py, grid.iter().map(|axis| PyArray1::from_slice(py, axis)))?.into_any()
            }
        })
    }

    /// Offsets behind the focus, as they were given.
    #[getter]
    fn behind<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, 4)
    }

    /// Offsets in front of the focus, as they were given.
    #[getter]
    fn in_front<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, 2)
    }

    /// Offsets in focus, as they were given.
    #[getter]
    fn focused<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
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
        Ok(((self.field(py)?, self.behind(py)?), words))
    }
}
