//! `dofsim.Aperture`.

use super::argument;
use super::hash::hash_text;
use super::lens::cameras::{of_camera, read_camera};
use super::samples::array;
use crate::aperture::{Aperture, Picture};
use crate::error::value_error;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt;
use std::sync::Arc;

/// An aperture: its shape, and how much light passes each part of it.
///
/// Parameters
/// ----------
/// blades : int, optional
///     Number of blades, 3 to 64; 0 (default) is a round aperture.
/// rotation : float, optional
///     Angle in degrees by which the blades are turned, counter-clockwise as seen in the picture for points
///     behind the focus plane. At 0 the first corner points to the right. Points in front of the focus plane
///     are drawn turned by 180 degrees, as in a camera.
/// roundness : float, optional
///     How much the blades bulge: 0 (default) is straight, 1 makes one circle of them.
/// ratio : float, optional
///     Height of the aperture over its width, Blender's word for an anamorphic lens: 2 draws points twice as high as
///     wide. The longer half-axis stays ``aperture_radius``. The squeeze is along the picture's axes, after the
///     rotation.
/// obstruction : float, optional
///     Part of the way from the centre to the rim that is closed, 0 to 0.95, as by the mirror of a mirror lens. The
///     hole has the shape of the aperture.
/// apodization : float, optional
///     Standard deviation of a Gaussian transmission as a fraction of the way from the centre to the rim, at
///     least 0.05. ``None`` (default) is a clear aperture.
/// spherical : float, optional
///     Spherical aberration, -1 to 1. Behind the focus the light of a point has the density ``1 + spherical * (2 rho**2
///     - 1)``, in front of it that with the other sign, where ``rho`` goes from 0 at the centre to 1 at the rim.
///     Positive values draw bright rims behind the focus and soft discs in front of it; what is in focus stays sharp,
///     and no light is lost.
/// image : ndarray or path, optional
///     A picture of the transmission, shape (N, M), not negative; or a file to read one from, whose colours are
///     averaged in linear light. It fills the square around the round aperture, which cuts off its corners; only the
///     ratios of its values matter. It is the whole aperture: of the words above only `ratio` goes with it.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If a value is out of range; the text names the argument, the value and what is accepted.
///
/// Notes
/// -----
/// The corners of the blades lie on the circle of the lens's ``aperture_radius``, as in Blender.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> dofsim.Aperture(blades=6, rotation=15.0, roundness=0.3)
/// Aperture(blades=6, rotation=15.0, roundness=0.3)
#[pyclass(name = "Aperture", module = "dofsim", frozen, eq)]
#[derive(Debug, Clone, PartialEq)]
pub struct PyAperture {
    parameters: Parameters,
    image: Option<Image>,
    pub core: Aperture,
}

/// The parameters from which an aperture was made.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Parameters {
    blades: u32,
    rotation: f64,
    roundness: f64,
    ratio: f64,
    obstruction: f64,
    apodization: Option<f64>,
    spherical: f64,
}

impl Parameters {
    const DISC: Parameters = Parameters {
        blades: 0,
        rotation: 0.0,
        roundness: 0.0,
        ratio: 1.0,
        obstruction: 0.0,
        apodization: None,
        spherical: 0.0,
    };
}

/// A picture of the transmission, as it was given.
#[derive(Debug, Clone, PartialEq)]
struct Image {
    columns: usize,
    values: Arc<Vec<f64>>,
}

impl Image {
    /// Reads an array, or the file of this path.
    fn read(given: &Bound<'_, PyAny>) -> PyResult<Image> {
        let read = given.py().import("dofsim._transmission")?.call_method1("read_transmission", (given,))?;
        let array: PyReadonlyArray2<f64> = array("image", &read)?.extract()?;
        let array = array.as_array();
        Ok(Image { columns: array.ncols(), values: Arc::new(array.iter().copied().collect()) })
    }

    /// Distinguishes pictures of one size: in hashes, and in the records of a batch.
    fn fingerprint(&self) -> u64 {
        let bytes: Vec<String> = self.values.iter().map(|v| format!("{:x}", (v + 0.0).to_bits())).collect();
        hash_text(&bytes.join(","))
    }

    fn array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, &self.values).reshape([self.values.len() / self.columns, self.columns])
    }
}

impl fmt::Display for PyAperture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (own, disc) = (&self.parameters, Parameters::DISC);
        let mut words = Vec::new();
        if own.blades != disc.blades {
            words.push(format!("blades={}", own.blades));
        }
        for (name, value, default) in [
            ("rotation", own.rotation, disc.rotation),
            ("roundness", own.roundness, disc.roundness),
            ("ratio", own.ratio, disc.ratio),
            ("obstruction", own.obstruction, disc.obstruction),
            ("spherical", own.spherical, disc.spherical),
        ] {
            if value != default {
                words.push(format!("{name}={value:?}"));
            }
        }
        if let Some(sigma) = own.apodization {
            words.push(format!("apodization={sigma:?}"));
        }
        if let Some(image) = &self.image {
            let rows = image.values.len() / image.columns;
            words.push(format!("image=<{rows} x {}, {:016x}>", image.columns, image.fingerprint()));
        }
        write!(f, "Aperture({})", words.join(", "))
    }
}

#[pymethods]
impl PyAperture {
    #[new]
    #[pyo3(signature = (*, blades=0, rotation=0.0, roundness=0.0, ratio=1.0, obstruction=0.0, apodization=None,
        spherical=0.0, image=None))]
    #[expect(clippy::too_many_arguments, reason = "the public constructor's own, keyword-only in Python")]
    fn new(
        #[pyo3(from_py_with = argument::blades)] blades: u32,
        #[pyo3(from_py_with = argument::rotation)] rotation: f64,
        #[pyo3(from_py_with = argument::roundness)] roundness: f64,
        #[pyo3(from_py_with = argument::ratio)] ratio: f64,
        #[pyo3(from_py_with = argument::obstruction)] obstruction: f64,
        #[pyo3(from_py_with = argument::apodization)] apodization: Option<f64>,
        #[pyo3(from_py_with = argument::spherical)] spherical: f64,
        image: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyAperture> {
        let parameters =
            Parameters { blades, rotation, roundness, ratio, obstruction, apodization, spherical };
        let image = image.map(Image::read).transpose()?;
        let core = match &image {
            Some(image) => {
                if parameters != (Parameters { ratio, ..Parameters::DISC }) {
                    return Err(value_error!(
                        "image is the whole opening: only ratio goes with it; put the rest into the picture"
                    )
                    .into());
                }
                Aperture::of_picture(Picture::new(image.columns, &image.values)?)
            }
            None => Aperture::new(blades, rotation, apodization)?
                .with_roundness(roundness)?
                .with_obstruction(obstruction)?
                .with_spherical(spherical)?,
        };
        Ok(PyAperture { parameters, image, core: core.with_ratio(ratio)? })
    }

    /// The aperture of a Blender camera.
    ///
    /// Parameters
    /// ----------
    /// camera : dict or path
    ///     ``aperture_blades``, ``aperture_rotation`` (radians) and ``aperture_ratio``, each optional, as Blender names
    ///     them; other entries do not matter. Or a JSON file with them.
    ///
    /// Returns
    /// -------
    /// Aperture
    ///     Blender turns its blades so that the middle of one, and no corner, points to the right at a rotation of 0.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If an entry is out of range.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> dofsim.Aperture.from_blender({"aperture_blades": 6, "aperture_ratio": 2.0})
    /// Aperture(blades=6, rotation=30.0, ratio=2.0)
    #[staticmethod]
    fn from_blender(camera: &Bound<'_, PyAny>) -> PyResult<PyAperture> {
        of_camera(camera, || {
            let (blades, rotation, ratio): (f64, f64, f64) = read_camera("blender_aperture", camera)?;
            // Cycles treats fewer than three blades as no blades.
            let blades = if blades < 3.0 { 0 } else { blades as u32 };
            let rotation = match blades {
                0 => 0.0,
                n => rotation.to_degrees() + 180.0 / f64::from(n),
            };
            PyAperture::new(blades, rotation, 0.0, ratio, 0.0, None, 0.0, None)
        })
    }

    /// Number of blades; 0 is round.
    #[getter]
    fn blades(&self) -> u32 {
        self.parameters.blades
    }

    /// Rotation in degrees.
    #[getter]
    fn rotation(&self) -> f64 {
        self.parameters.rotation
    }

    /// How much the blades bulge, 0 to 1.
    #[getter]
    fn roundness(&self) -> f64 {
        self.parameters.roundness
    }

    /// Height over width.
    #[getter]
    fn ratio(&self) -> f64 {
        self.parameters.ratio
    }

    /// Part of the way to the rim that is closed.
    #[getter]
    fn obstruction(&self) -> f64 {
        self.parameters.obstruction
    }

    /// Standard deviation of the Gaussian transmission, or None.
    #[getter]
    fn apodization(&self) -> Option<f64> {
        self.parameters.apodization
    }

    /// Spherical aberration, -1 to 1.
    #[getter]
    fn spherical(&self) -> f64 {
        self.parameters.spherical
    }

    /// The picture of the transmission as it was given, float64, or None.
    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.image.as_ref().map(|image| image.array(py)).transpose()
    }

    fn __repr__(&self) -> String {
        self.to_string()
    }

    /// What a notebook shows: the words of the aperture, and what it makes of a point of light.
    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("dofsim._display")?.call_method1("aperture_html", (slf,))
    }

    /// The same as a picture: behind the focus on the left, in front of it on the right.
    fn _repr_png_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("dofsim._display")?.call_method1("aperture_png", (slf,))
    }

    fn __hash__(&self) -> u64 {
        hash_text(&self.to_string())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((), Bound<'py, PyDict>)> {
        let (words, own) = (PyDict::new(py), &self.parameters);
        words.set_item("blades", own.blades)?;
        words.set_item("rotation", own.rotation)?;
        words.set_item("roundness", own.roundness)?;
        words.set_item("ratio", own.ratio)?;
        words.set_item("obstruction", own.obstruction)?;
        words.set_item("apodization", own.apodization)?;
        words.set_item("spherical", own.spherical)?;
        words.set_item("image", self.image(py)?)?;
        Ok(((), words))
    }
}
