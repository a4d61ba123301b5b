//! `dofsim.restore_highlights` and `dofsim.layers_from_matte`.

use super::argument;
use super::color::{color_shape, read_format, read_layer_color};
use super::depth::{check_shape, read_planes};
use super::invalid_color::InvalidColor;
use super::run::detached;
use super::samples::array;
use crate::clipped::{guessed_gains, mapped_gains};
use crate::matte::{colors, continued};
use crate::memory::Buffer;
use crate::picture::Size;
use crate::refine::{Plane, brightest};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The picture in linear light, with the light that clipping at white took put back.
///
/// What was brighter than white is white in a photograph, so that its lamps blur to grey discs. How bright they were is
/// guessed: a small clipped spot in dark surroundings is a lamp and gets much, and a large one, or one in bright
/// surroundings, gets next to nothing. A photograph's gain map knows it better: pass it as `gains`.
///
/// Parameters
/// ----------
/// color : ndarray
///     The picture, as of `render`; one layer. White is 1.
/// gains : ndarray, optional
///     How many times as bright as white each pixel is if it is clipped, shape (h, w), of any size, as the `gains` of
///     `dofsim.photo.Photo`; in place of the guess.
/// max_gain : float, optional
///     The factor by which a single clipped spot in the dark becomes brighter than white, and the most that is taken of
///     `gains`, 1 to 1000; 16 are four stops.
/// alpha, transfer, threads
///     As in `render`.
///
/// Returns
/// -------
/// ndarray
///     float32, the shape of `color`: linear light, premultiplied, nowhere darker than that of `color`, and nowhere more
///     than `max_gain` times as bright. What is not clipped keeps its light to the bit.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> night = np.full((90, 120, 3), 3, np.uint8)
/// >>> night[40:44, 60:64] = 255
/// >>> light = dofsim.restore_highlights(night, transfer="srgb")
/// >>> bool(light.max() > 2.0), bool(light[0, 0, 0] < 0.001)
/// (True, True)
#[pyfunction]
#[pyo3(signature = (color, *, gains=None, max_gain=16.0, alpha=None, transfer=None, threads=None))]
pub fn restore_highlights<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    gains: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = argument::max_gain)] max_gain: f64,
    alpha: Option<&str>,
    transfer: Option<&str>,
    #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    if !(1.0..=1000.0).contains(&max_gain) {
        return Err(PyValueError::new_err(format!("max_gain must be from 1 to 1000; got {max_gain}")));
    }
    let array = &array("color", color)?;
    let shape = color_shape(array.shape())?;
    if shape.layers > 1 {
        return Err(PyValueError::new_err(format!("color must have one layer; got {}", shape.layers)));
    }
    let format = read_format(array, &shape, alpha, transfer)?;
    let (mut planes, ..) = read_layer_color(array, &shape, 0, &format, InvalidColor::Raise)?;
    let (size, lights) = (shape.size, format.lights(shape.size));
    let map = gains.map(|gains| read_gains(gains, size)).transpose()?;
    let values = detached(py, threads, |cancel| {
        let area = size.pixels();
        let light = brightest(&self::planes(&planes[..lights * area], size.width, size.height));
        let bound = max_gain as f32;
        let gains = match &map {
            Some(map) => mapped_gains(&light, map, bound),
            None => guessed_gains(&light, bound, cancel)?,
        };
        for plane in planes[..lights * area].chunks_mut(area) {
            plane.iter_mut().zip(gains.values.iter()).for_each(|(v, gain)| *v *= gain);
        }
        Ok(interleaved(&planes, area, size.channels))
    })?;
    let out = PyArray1::from_vec(py, values);
    let channels = [size.height, size.width, size.channels];
    Ok(out.reshape(if format.flat { &channels[..2] } else { &channels[..] })?.into_any())
}

/// Reads the factors of a gain map.
fn read_gains(gains: &Bound<'_, PyAny>, size: Size) -> PyResult<Plane> {
    let read = read_planes("gains", gains)?;
    if read.planes.len() > 1 {
        return Err(PyValueError::new_err(format!("gains must have one layer; got {}", read.planes.len())));
    }
    check_shape("gains", &read, size)?;
    let values = Buffer::from(&*read.planes[0]);
    if let Some(v) = values.iter().find(|v| !v.is_finite() || **v < 0.0) {
        return Err(PyValueError::new_err(format!("gains must be finite and not negative; got {v}")));
    }
    Ok(Plane { width: read.width, height: read.height, values })
}

/// Planes of values that follow one another.
pub fn planes(values: &[f32], width: usize, height: usize) -> Vec<Plane> {
    let plane = |values: &[f32]| Plane { width, height, values: Buffer::from(values) };
    values.chunks(width * height).map(plane).collect()
}

fn interleaved(planes: &[f32], area: usize, channels: usize) -> Vec<f32> {
    (0..area).flat_map(|i| (0..channels).map(move |c| planes[c * area + i])).collect()
}

/// Two layers of a picture and their depth: what a matte covers, and what is behind it.
///
/// Parameters
/// ----------
/// color : ndarray
///     The picture, as of `render`, with 1 or 3 channels and no alpha.
/// matte : ndarray
///     How much of each pixel the foreground covers, shape (H, W), floats from 0 to 1.
/// depth : ndarray
///     Its depth, shape (H, W), as of `render`, without invalid values.
/// transfer, threads
///     As in `render`.
///
/// Returns
/// -------
/// color : ndarray
///     float32, shape (2, H, W, 4): the foreground and what is behind it, linear and premultiplied. At hair and soft edges both
///     have their own colours, which together give the picture. Behind the foreground the background is continued
///     from its surroundings.
/// depth : ndarray
///     float32, shape (2, H, W): each layer's own depth, continued from where it is seen.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> matte = np.zeros((24, 32), np.float32)
/// >>> matte[6:18, 8:24] = 1.0
/// >>> color = np.where(matte[..., None] > 0.5, 0.8, 0.2) * np.ones(3)
/// >>> layers, depths = dofsim.layers_from_matte(color, matte, np.where(matte > 0.5, 1.0, 5.0))
/// >>> layers.shape, depths[:, 12, 16].round(2)
/// ((2, 24, 32, 4), array([1., 5.], dtype=float32))
#[pyfunction]
#[pyo3(signature = (color, matte, depth, *, transfer=None, threads=None))]
pub fn layers_from_matte<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    matte: &Bound<'py, PyAny>,
    depth: &Bound<'py, PyAny>,
    transfer: Option<&str>,
    #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let array = &array("color", color)?;
    let shape = color_shape(array.shape())?;
    let size = shape.size;
    let format = read_format(array, &shape, Some("none"), transfer)?;
    if shape.layers > 1 || !matches!(size.channels, 1 | 3) {
        return Err(PyValueError::new_err(format!(
            "color must have 1 or 3 channels and one layer; got shape {:?}",
            array.shape()
        )));
    }
    let (planes, ..) = read_layer_color(array, &shape, 0, &format, InvalidColor::Raise)?;
    let plane = |name: &str, given: &Bound<'py, PyAny>| {
        let read = read_planes(name, given)?;
        if (read.planes.len(), read.height, read.width) != (1, size.height, size.width) {
            return Err(PyValueError::new_err(format!(
                "{name} must have the size of color, {} x {}; got {} x {}",
                size.width, size.height, read.width, read.height
            )));
        }
        Ok(Plane { width: size.width, height: size.height, values: Buffer::from(&*read.planes[0]) })
    };
    let (matte, depth) = (plane("matte", matte)?, plane("depth", depth)?);
    if let Some(v) = matte.values.iter().find(|v| !(0.0..=1.0).contains(*v)) {
        return Err(PyValueError::new_err(format!("matte must be from 0 to 1; got {v}")));
    }
    if let Some(v) = depth.values.iter().find(|v| v.is_nan() || **v <= 0.0) {
        return Err(PyValueError::new_err(format!("depth must be valid, greater than 0; got {v}")));
    }
    let area = size.pixels();
    let (layers, depths) = detached(py, threads, |cancel| {
        let color = self::planes(&planes, size.width, size.height);
        let [front, back] = colors(&color, &matte, cancel)?;
        let channel = |side: &[Plane], c: usize, i: usize| side[c % side.len()].values[i];
        let mut layers = Vec::with_capacity(8 * area);
        for i in 0..area {
            let a = matte.values[i];
            layers.extend([0, 1, 2].map(|c| a * channel(&front, c, i)));
            layers.push(a);
        }
        for i in 0..area {
            layers.extend([0, 1, 2].map(|c| channel(&back, c, i)));
            layers.push(1.0);
        }
        // Depth where one of the two is seen alone says what its is, in disparity, which is finite.
        let disparity = depth.with(&depth, |z, _| z.recip());
        let own = |share: fn(f32) -> f32| {
            let weight = matte.with(&matte, |a, _| share(a).powi(8));
            continued(&disparity, &weight).values.iter().map(|d| d.recip()).collect::<Vec<f32>>()
        };
        Ok((layers, [own(|a| a), own(|a| 1.0 - a)].concat()))
    })?;
    let layers = PyArray1::from_vec(py, layers).reshape([2, size.height, size.width, 4])?;
    let depths = PyArray1::from_vec(py, depths).reshape([2, size.height, size.width])?;
    Ok((layers.into_any(), depths.into_any()))
}
