//! Bindings of [`crate::files`], only for `dofsim.io`: paths and contiguous arrays in, arrays out.

use super::run::installed;
use super::samples::viewable;
use crate::color::{Sample, Transfer};
use crate::files::{self, Alpha, FileError, Pixels, Problem, Samples, Shape, openexr};
use half::f16;
use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// Errors of the system become `OSError` with their number, so that Python picks the subclass. All other errors are
/// about the file or the arguments, and become `ValueError`.
impl From<FileError> for PyErr {
    fn from(error: FileError) -> Self {
        match &error.problem {
            Problem::Io(source) => {
                // The system's message, without the "(os error 2)" that Rust appends.
                let words = source.to_string();
                let words = words.split(" (os error").next().unwrap_or_default().to_owned();
                PyOSError::new_err((source.raw_os_error(), words, error.path.into_os_string()))
            }
            _ => PyValueError::new_err(error.to_string()),
        }
    }
}

/// An array that is returned to Python.
pub struct Pixmap<'py>(Bound<'py, PyUntypedArray>);

impl<'py> IntoPyObject<'py> for Pixmap<'py> {
    type Target = PyUntypedArray;
    type Output = Bound<'py, PyUntypedArray>;
    type Error = std::convert::Infallible;

    fn into_pyobject(self, _py: Python<'py>) -> Result<Self::Output, Self::Error> {
        Ok(self.0)
    }
}

impl<'py> Pixmap<'py> {
    /// The shape is (height, width) for one channel, and (height, width, channels) for more.
    fn new(py: Python<'py>, raster: files::Raster) -> PyResult<Self> {
        fn shaped<'py, T: Element>(
            py: Python<'py>,
            samples: Vec<T>,
            shape: &[usize],
        ) -> PyResult<Bound<'py, PyUntypedArray>> {
            Ok(PyArray1::from_vec(py, samples).reshape(shape)?.as_untyped().clone())
        }
        let shape = [raster.height, raster.width, raster.channels];
        let shape = if raster.channels == 1 { &shape[..2] } else { &shape[..] };
        let array = match raster.samples {
            Samples::U8(v) => shaped(py, v, shape),
            Samples::U16(v) => shaped(py, v, shape),
            Samples::U32(v) => shaped(py, v, shape),
            Samples::F16(v) => shaped(py, v, shape),
            Samples::F32(v) => shaped(py, v, shape),
            Samples::F64(v) => shaped(py, v, shape),
        };
        array.map(Self)
    }
}

/// A C-contiguous array of shape (height, width) or (height, width, channels), in one of the types that can be
/// written.
pub enum Contiguous<'py> {
    U8(PyReadonlyArrayDyn<'py, u8>),
    U16(PyReadonlyArrayDyn<'py, u16>),
    U32(PyReadonlyArrayDyn<'py, u32>),
    F16(PyReadonlyArrayDyn<'py, f16>),
    F32(PyReadonlyArrayDyn<'py, f32>),
}

impl<'py> FromPyObject<'_, 'py> for Contiguous<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let object = viewable(&object.cast::<PyUntypedArray>()?.to_owned())?;
        let array = &object;
        if !array.is_c_contiguous() || !(2..=3).contains(&array.ndim()) {
            return Err(PyTypeError::new_err("the array must be C-contiguous with 2 or 3 axes"));
        }
        if let Ok(array) = object.extract() {
            return Ok(Self::U8(array));
        }
        if let Ok(array) = object.extract() {
            return Ok(Self::U16(array));
        }
        if let Ok(array) = object.extract() {
            return Ok(Self::U32(array));
        }
        if let Ok(array) = object.extract() {
            return Ok(Self::F16(array));
        }
        object.extract().map(Self::F32)
    }
}

impl Contiguous<'_> {
    fn shape(&self) -> Shape {
        let shape = match self {
            Self::U8(array) => array.shape(),
            Self::U16(array) => array.shape(),
            Self::U32(array) => array.shape(),
            Self::F16(array) => array.shape(),
            Self::F32(array) => array.shape(),
        };
        Shape { height: shape[0], width: shape[1], channels: shape.get(2).copied().unwrap_or(1) }
    }

    fn pixels(&self) -> PyResult<Pixels<'_>> {
        match self {
            Self::U8(array) => Ok(Pixels::U8(array.as_slice()?)),
            Self::U16(array) => Ok(Pixels::U16(array.as_slice()?)),
            Self::F32(array) => Ok(Pixels::F32(array.as_slice()?)),
            Self::U32(_) | Self::F16(_) => Err(PyTypeError::new_err("expected uint8, uint16 or float32")),
        }
    }

    fn values(&self) -> PyResult<openexr::Values<'_>> {
        match self {
            Self::F16(array) => Ok(openexr::Values::F16(array.as_slice()?)),
            Self::F32(array) => Ok(openexr::Values::F32(array.as_slice()?)),
            Self::U32(array) => Ok(openexr::Values::U32(array.as_slice()?)),
            Self::U8(_) | Self::U16(_) => Err(PyTypeError::new_err("expected float16, float32 or uint32")),
        }
    }
}

/// One part of an OpenEXR file: its name, its channels, the types of their samples, its windows as (x, y, width, height),
/// and the width of a pixel over its height.
#[pyclass(frozen, get_all, module = "dofsim._dofsim")]
pub struct ExrPart {
    name: Option<String>,
    channels: Vec<String>,
    sample_types: Vec<&'static str>,
    data_window: (i32, i32, usize, usize),
    display_window: (i32, i32, usize, usize),
    pixel_aspect: f32,
}

/// The format of a file by its first bytes: "exr", "png", "jpeg", "webp", "bmp", "hdr", "tiff", "pfm", "npy" or "npz".
#[pyfunction]
pub fn file_kind(py: Python<'_>, path: PathBuf) -> PyResult<&'static str> {
    Ok(py.detach(|| files::kind(&path))?.name())
}

/// What a file holds beside its pixels: the bytes of its ICC profile and of Exif, and its orientation, 1 to 8.
#[pyclass(frozen, get_all, module = "dofsim._dofsim")]
pub struct Beside {
    profile: Option<Py<PyBytes>>,
    exif: Option<Py<PyBytes>>,
    orientation: u8,
}

/// The pixels of a picture file; what its last channel is, "none", "straight" or "premultiplied"; and what is beside them.
/// Pictures that are stored turned are refused unless `turned`.
#[pyfunction]
#[pyo3(signature = (path, *, turned=false))]
pub fn read_raster(
    py: Python<'_>,
    path: PathBuf,
    turned: bool,
) -> PyResult<(Pixmap<'_>, &'static str, Beside)> {
    let raster = py.detach(|| files::read_raster(&path, turned))?;
    let bytes = |bytes: &Option<Vec<u8>>| bytes.as_ref().map(|bytes| PyBytes::new(py, bytes).unbind());
    let beside = Beside {
        profile: bytes(&raster.beside.profile),
        exif: bytes(&raster.beside.exif),
        orientation: raster.beside.orientation.max(1),
    };
    let alpha = match raster.alpha {
        Alpha::None => "none",
        Alpha::Straight => "straight",
        Alpha::Premultiplied => "premultiplied",
    };
    Ok((Pixmap::new(py, raster)?, alpha, beside))
}

/// The parts of an OpenEXR file.
#[pyfunction]
pub fn exr_parts(py: Python<'_>, path: PathBuf) -> PyResult<Vec<ExrPart>> {
    let parts = py.detach(|| openexr::parts(&path))?;
    Ok(parts.into_iter().map(ExrPart::from).collect())
}

/// The first deep part of an OpenEXR file that has a channel Z, with its number, if there is one.
#[pyfunction]
pub fn deep_exr_part(py: Python<'_>, path: PathBuf) -> PyResult<Option<(usize, ExrPart)>> {
    let part = py.detach(|| openexr::deep_part(&path, "Z"))?;
    Ok(part.map(|(number, part)| (number, part.into())))
}

impl From<openexr::Part> for ExrPart {
    fn from(part: openexr::Part) -> Self {
        let window = |w: openexr::Window| (w.x, w.y, w.width, w.height);
        Self {
            name: part.name,
            channels: part.channels,
            sample_types: part.sample_types,
            data_window: window(part.data_window),
            display_window: window(part.display_window),
            pixel_aspect: part.pixel_aspect,
        }
    }
}

/// Channels of one part of an OpenEXR file as float32; `data` for the data window, else the display window
/// with `fill` where nothing is stored.
#[pyfunction]
#[pyo3(signature = (path, part, channels, *, data, fill))]
pub fn read_exr(
    py: Python<'_>,
    path: PathBuf,
    part: usize,
    channels: Vec<String>,
    data: bool,
    fill: f32,
) -> PyResult<Pixmap<'_>> {
    let view = if data { openexr::View::Data } else { openexr::View::Display };
    let raster = py.detach(|| openexr::read(&path, part, &channels, view, fill))?;
    Pixmap::new(py, raster)
}

type NamedChannels<'py> = Vec<(String, Contiguous<'py>)>;

/// Writes parts, each a name and channels of (name, array), to an OpenEXR file; with the attributes of the OpenEXR file
/// `attributes_of` if it is given, those of its parts `like` these or else of its first, and beginning at `corner` of its
/// display window, or else with windows of their own.
#[pyfunction]
#[pyo3(signature = (path, parts, *, compression, attributes_of=None, corner=None, like=None))]
pub fn write_exr(
    py: Python<'_>,
    path: PathBuf,
    parts: Vec<(Option<String>, NamedChannels<'_>)>,
    compression: &str,
    attributes_of: Option<PathBuf>,
    corner: Option<(i32, i32)>,
    like: Option<Vec<usize>>,
) -> PyResult<()> {
    let compression =
        openexr::compression(compression).map_err(|problem| PyValueError::new_err(problem.to_string()))?;
    let layers = parts
        .iter()
        .zip(like.into_iter().flatten().chain(std::iter::repeat(0)))
        .map(|((name, channels), like)| {
            let Some(shape) = channels.first().map(|(_, array)| array.shape()) else {
                return Err(PyValueError::new_err("a part without channels cannot be written"));
            };
            let channels = channels
                .iter()
                .map(|(name, array)| Ok(openexr::Channel { name: name.clone(), values: array.values()? }))
                .collect::<PyResult<_>>()?;
            let (name, width, height) = (name.clone(), shape.width, shape.height);
            Ok(openexr::Layer { name, width, height, channels, like })
        })
        .collect::<PyResult<_>>()?;
    Ok(py.detach(|| {
        let attributes = attributes_of.as_deref().map(openexr::attributes).transpose()?;
        openexr::write(&path, layers, compression, attributes.as_ref().map(|all| (&all[..], corner)))
    })?)
}

/// Writes uint8 or uint16 pixels with straight alpha to a PNG file, marked as sRGB or with an ICC profile.
#[pyfunction]
#[pyo3(signature = (path, pixels, profile=None))]
pub fn write_png(
    py: Python<'_>,
    path: PathBuf,
    pixels: Contiguous<'_>,
    profile: Option<&[u8]>,
) -> PyResult<()> {
    let (pixels, shape) = (pixels.pixels()?, pixels.shape());
    Ok(py.detach(|| files::png::write(&path, pixels, shape, profile))?)
}

/// The bytes of a PNG file of uint8 or uint16 pixels, sRGB with straight alpha.
#[pyfunction]
pub fn encode_png<'py>(py: Python<'py>, pixels: Contiguous<'_>) -> PyResult<Bound<'py, PyBytes>> {
    let (pixels, shape) = (pixels.pixels()?, pixels.shape());
    let bytes = py.detach(|| files::png::bytes(pixels, shape));
    bytes.map(|bytes| PyBytes::new(py, &bytes)).map_err(|problem| PyValueError::new_err(problem.to_string()))
}

/// Writes uint8, uint16 or float32 pixels to a TIFF file, with an ICC profile if one is given.
#[pyfunction]
#[pyo3(signature = (path, pixels, premultiplied, profile=None))]
pub fn write_tiff(
    py: Python<'_>,
    path: PathBuf,
    pixels: Contiguous<'_>,
    premultiplied: bool,
    profile: Option<&[u8]>,
) -> PyResult<()> {
    let alpha = if premultiplied { Alpha::Premultiplied } else { Alpha::Straight };
    let (pixels, shape) = (pixels.pixels()?, pixels.shape());
    Ok(py.detach(|| files::tiff::write(&path, pixels, shape, alpha, profile))?)
}

/// Writes float32 pixels of 1 or 3 channels to a PFM file.
#[pyfunction]
pub fn write_pfm(py: Python<'_>, path: PathBuf, pixels: Contiguous<'_>) -> PyResult<()> {
    let Pixels::F32(samples) = pixels.pixels()? else {
        return Err(PyTypeError::new_err("expected float32"));
    };
    let shape = pixels.shape();
    Ok(py.detach(|| files::pfm::write(&path, samples, shape))?)
}

/// Writes bytes to a file under a temporary name and moves it to its own when it is whole.
#[pyfunction]
pub fn write_bytes(py: Python<'_>, path: PathBuf, bytes: &[u8]) -> PyResult<()> {
    Ok(py.detach(|| files::atomic::write_bytes(&path, bytes))?)
}

/// Integers as float32 from 0 to 1, in linear light if `srgb`. The last channel is left linear if it is
/// `alpha`, which is a share of the area and not light.
#[pyfunction]
#[pyo3(signature = (codes, *, srgb, alpha))]
pub fn decode_codes<'py>(
    py: Python<'py>,
    codes: Contiguous<'_>,
    srgb: bool,
    alpha: bool,
) -> PyResult<Pixmap<'py>> {
    fn decoded<T: Sample>(codes: &[T], transfers: &Transfers) -> Samples {
        Samples::F32(codes.iter().zip(transfers.each()).map(|(v, t)| t.decode(v.to_code())).collect())
    }
    let (pixels, shape) = (codes.pixels()?, codes.shape());
    let transfers = Transfers::new(shape, srgb, alpha);
    let samples = py.detach(|| match pixels {
        Pixels::U8(v) => decoded(v, &transfers),
        Pixels::U16(v) => decoded(v, &transfers),
        Pixels::F32(v) => decoded(v, &transfers),
    });
    Pixmap::new(py, transfers.raster(samples))
}

/// Linear light as integers of 8 or 16 bits, by sRGB but for an `alpha` channel at the end. Values outside 0
/// to 1 are clipped; NaN becomes 0.
#[pyfunction]
#[pyo3(signature = (values, *, sixteen, alpha))]
pub fn encode_codes<'py>(
    py: Python<'py>,
    values: Contiguous<'_>,
    sixteen: bool,
    alpha: bool,
) -> PyResult<Pixmap<'py>> {
    fn encoded<T: Sample>(values: &[f32], transfers: &Transfers) -> Vec<T> {
        values.iter().zip(transfers.each()).map(|(v, t)| T::from_code(t.encode(v.clamp(0.0, 1.0)))).collect()
    }
    let Pixels::F32(pixels) = values.pixels()? else {
        return Err(PyTypeError::new_err("expected float32"));
    };
    let transfers = Transfers::new(values.shape(), true, alpha);
    let samples = py.detach(|| match sixteen {
        false => Samples::U8(encoded(pixels, &transfers)),
        true => Samples::U16(encoded(pixels, &transfers)),
    });
    Pixmap::new(py, transfers.raster(samples))
}

/// The name, the curves and the matrix of a profile.
type ParsedProfile<'py> = (String, Bound<'py, PyArray1<f32>>, Vec<Vec<f64>>);

/// An ICC profile: its name, for each of `lights` channels the linear light of every 16-bit code, shape (lights, 65536),
/// and the matrix from its linear light to CIE XYZ of D50.
#[pyfunction]
pub fn parse_profile<'py>(py: Python<'py>, icc: &[u8], lights: usize) -> PyResult<ParsedProfile<'py>> {
    let profile = py.detach(|| files::profile::parse(icc, lights));
    let profile = profile.map_err(|problem| PyValueError::new_err(problem.to_string()))?;
    let curves = PyArray1::from_vec(py, profile.curves.concat());
    Ok((profile.name, curves, profile.to_xyz.iter().map(|row| row.to_vec()).collect()))
}

/// Linear light of integers by the curves of a profile, as `parse_profile` gives them; coverage behind them stays.
#[pyfunction]
pub fn decode_by_curves<'py>(
    py: Python<'py>,
    codes: Contiguous<'_>,
    curves: PyReadonlyArrayDyn<'_, f32>,
) -> PyResult<Pixmap<'py>> {
    let (pixels, shape, curves) = (codes.pixels()?, codes.shape(), curves.as_slice()?);
    let curves: Vec<&[f32]> = curves.chunks(files::profile::CODES).collect();
    let samples = installed(|| match pixels {
        Pixels::U8(v) => Ok(files::profile::decode(v, shape.channels, &curves, |v| usize::from(v) * 257)),
        Pixels::U16(v) => Ok(files::profile::decode(v, shape.channels, &curves, usize::from)),
        Pixels::F32(_) => Err(PyTypeError::new_err("expected uint8 or uint16")),
    })??;
    let Shape { width, height, channels } = shape;
    let (alpha, beside) = (Alpha::None, files::Beside::default());
    Pixmap::new(py, files::Raster { width, height, channels, alpha, samples: Samples::F32(samples), beside })
}

/// Integers of 8 or 16 bits of linear light, by the curves of a profile. Values outside 0 to 1 are clipped.
#[pyfunction]
#[pyo3(signature = (values, curves, *, sixteen))]
pub fn encode_by_curves<'py>(
    py: Python<'py>,
    values: Contiguous<'_>,
    curves: PyReadonlyArrayDyn<'_, f32>,
    sixteen: bool,
) -> PyResult<Pixmap<'py>> {
    let Pixels::F32(pixels) = values.pixels()? else {
        return Err(PyTypeError::new_err("expected float32"));
    };
    let (shape, curves) = (values.shape(), curves.as_slice()?);
    let curves: Vec<&[f32]> = curves.chunks(files::profile::CODES).collect();
    let codes = installed(|| files::profile::encode(pixels, shape.channels, &curves))?;
    let samples = match sixteen {
        false => Samples::U8(codes.iter().map(|code| (code / 257.0 + 0.5) as u8).collect()),
        true => Samples::U16(codes.iter().map(|code| (code + 0.5) as u16).collect()),
    };
    let Shape { width, height, channels } = shape;
    let (alpha, beside) = (Alpha::None, files::Beside::default());
    Pixmap::new(py, files::Raster { width, height, channels, alpha, samples, beside })
}

/// The transfer function of every channel of a pixel.
struct Transfers {
    shape: Shape,
    channels: Vec<Transfer>,
}

impl Transfers {
    fn new(shape: Shape, srgb: bool, alpha: bool) -> Self {
        let mut channels = vec![if srgb { Transfer::Srgb } else { Transfer::Linear }; shape.channels];
        if let (true, Some(last)) = (alpha, channels.last_mut()) {
            *last = Transfer::Linear;
        }
        Self { shape, channels }
    }

    /// The transfer functions of all samples of a picture, in order.
    fn each(&self) -> impl Iterator<Item = Transfer> {
        self.channels.iter().copied().cycle()
    }

    fn raster(&self, samples: Samples) -> files::Raster {
        let Shape { width, height, channels } = self.shape;
        files::Raster {
            width,
            height,
            channels,
            alpha: Alpha::None,
            samples,
            beside: files::Beside::default(),
        }
    }
}
