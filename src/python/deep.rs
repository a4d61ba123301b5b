//! Bindings of [`crate::deep`], only for `dofsim.io` and the command line.

use super::run::detached;
use crate::deep::{Carried, DeepLayers, DeepSamples, Held};
use crate::files::openexr;
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::HashMap;
use std::path::PathBuf;

/// Colour and depth of layers; means; and sets of ids.
type LayersOfSamples<'py> = (
    Bound<'py, PyArray4<f32>>,
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray4<f32>>,
    Vec<Bound<'py, PyArray4<f32>>>,
);

/// Layers of the samples of deep pixels: the number of samples of each pixel, and those of channels, all pixels one after
/// another; at most so many layers of a window of the frame. Gives colour, shape (L, H, W, 4), depth, shape (L, H, W), and
/// of further channels by their names those of `means`, each "light" or "data", shape (L, H, W, N), and the sets of `ids`.
#[pyfunction]
#[pyo3(signature = (counts, channels, max_layers, *, window, means=Vec::new(), ids=Vec::new()))]
pub fn layers_of_samples<'py>(
    py: Python<'py>,
    counts: PyReadonlyArray2<'py, u32>,
    channels: HashMap<String, PyReadonlyArray1<'py, f32>>,
    max_layers: usize,
    window: (i64, i64, i64, i64),
    means: Vec<(String, String)>,
    ids: Vec<Vec<String>>,
) -> PyResult<LayersOfSamples<'py>> {
    let width = counts.shape()[1];
    let counts = counts.as_slice()?;
    let all: usize = counts.iter().map(|count| *count as usize).sum();
    let mut planes = HashMap::new();
    for (name, samples) in &channels {
        let samples = samples.as_slice()?;
        if samples.len() != all {
            let found = samples.len();
            return Err(PyValueError::new_err(format!(
                "channel {name} has {found} samples; counts have {all}"
            )));
        }
        planes.insert(name.as_str(), samples);
    }
    let plane = |name: &str| planes.get(name).copied();
    let needed =
        |name: &str| plane(name).ok_or_else(|| PyValueError::new_err(format!("channels must have {name}")));
    let z = needed("Z")?;
    let color = match (plane("R"), plane("Y")) {
        (None, Some(grey)) => [Some(grey); 3],
        _ => ["R", "G", "B"].map(plane),
    };
    let (alpha, back) = (plane("A"), plane("ZBack"));
    let mean = |(name, held): &(String, String)| Ok((read_held(name, held)?, needed(name)?));
    let mut carried = vec![Carried::Means(means.iter().map(mean).collect::<PyResult<_>>()?)];
    for set in &ids {
        carried.push(Carried::Ids(set.iter().map(|name| needed(name)).collect::<PyResult<_>>()?));
    }
    let samples = DeepSamples { width, counts, color, alpha, z, back, carried: &carried };
    let (x, y, across, down) = window;
    let merged = detached(py, None, |cancel| samples.layers(x..x + across, y..y + down, max_layers, cancel))?;
    let DeepLayers { layers, color, depth, carried: values } = merged;
    let [down, across] = [down as usize, across as usize];
    let mut values = values
        .into_iter()
        .zip(&carried)
        .map(|(values, of)| PyArray1::from_vec(py, values).reshape([layers, down, across, of.channels()]))
        .collect::<PyResult<Vec<_>>>()?;
    let ids = values.split_off(1);
    Ok((
        PyArray1::from_vec(py, color).reshape([layers, down, across, 4])?,
        PyArray1::from_vec(py, depth).reshape([layers, down, across])?,
        values.swap_remove(0),
        ids,
    ))
}

fn read_held(name: &str, held: &str) -> PyResult<Held> {
    match held {
        "light" => Ok(Held::Light),
        "data" => Ok(Held::Data),
        _ => {
            Err(PyValueError::new_err(format!("means of {name} must be \"light\" or \"data\"; got {held:?}")))
        }
    }
}

/// A window as (x, y, width, height).
type WindowWords = (i32, i32, usize, usize);

/// Numbers of samples, samples by channel, the data window and the display window.
type DeepWords<'py> = (Bound<'py, PyArray2<u32>>, Bound<'py, PyDict>, WindowWords, WindowWords);

/// The first deep part of an OpenEXR file that has a channel Z, if there is one: the number of samples of each pixel, the
/// samples of those of some channels that it has, all pixels one after another, its data window and its display window.
#[pyfunction]
pub fn read_deep_exr<'py>(
    py: Python<'py>,
    path: PathBuf,
    channels: Vec<String>,
) -> PyResult<Option<DeepWords<'py>>> {
    let window = |w: openexr::Window| (w.x, w.y, w.width, w.height);
    let Some(deep) = py.detach(|| openexr::read_deep(&path, "Z", &channels))? else { return Ok(None) };
    let openexr::Deep { counts, channels, data_window, display_window } = deep;
    let counts = PyArray1::from_vec(py, counts).reshape([data_window.height, data_window.width])?;
    let samples = PyDict::new(py);
    for (name, values) in channels {
        samples.set_item(name, PyArray1::from_vec(py, values))?;
    }
    Ok(Some((counts, samples, window(data_window), window(display_window))))
}
