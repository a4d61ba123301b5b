//! Other programs' cameras as words: dictionaries, and the files that they come in.

use super::super::errors::shown;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

/// A number out of a mapping, by the first of several keys that it has.
pub fn number(words: &Bound<'_, PyDict>, keys: &[&str]) -> PyResult<Option<f64>> {
    for key in keys {
        if let Some(value) = words.get_item(key)? {
            return value
                .extract()
                .map(Some)
                .map_err(|_| PyTypeError::new_err(format!("{key} must be a number; got {}", shown(&value))));
        }
    }
    Ok(None)
}

/// A number that has to be there.
pub fn required(words: &Bound<'_, PyDict>, what: &str, keys: &[&str]) -> PyResult<f64> {
    number(words, keys)?.ok_or_else(|| PyValueError::new_err(format!("{what} has no {:?}", keys[0])))
}

/// A word out of a mapping.
pub fn text(words: &Bound<'_, PyDict>, key: &str, default: &str) -> PyResult<String> {
    words.get_item(key)?.map_or_else(|| Ok(default.to_owned()), |value| value.extract())
}

/// A scalar that a renderer keeps in an array of its own, mostly of single precision: then as it was written, 0.1
/// rather than 0.10000000149.
pub fn scalar(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let kept: f64 = value.extract().or_else(|_| value.get_item(0)?.extract())?;
    let single = kept as f32;
    let was_single = f64::from(single) == kept;
    Ok(if was_single { single.to_string().parse().unwrap_or(kept) } else { kept })
}

/// Whether a value is the path of a file.
pub fn is_path(value: &Bound<'_, PyAny>) -> PyResult<bool> {
    Ok(value.is_instance_of::<PyString>() || value.hasattr("__fspath__")?)
}

/// The words of a Blender camera: a dictionary, or the path of a JSON file that holds one.
pub fn blender_words<'py>(camera: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let py = camera.py();
    let words = if is_path(camera)? {
        let text = py.import("pathlib")?.call_method1("Path", (camera,))?.call_method0("read_bytes")?;
        py.import("json")?.call_method1("loads", (text,))?
    } else {
        camera.clone()
    };
    words.cast_into().map_err(|e| {
        PyTypeError::new_err(format!(
            "camera must be a dictionary or the path of a JSON file that holds one; got {}",
            shown(&e.into_inner())
        ))
    })
}

/// The one sensor of a Mitsuba scene file, as the dictionary that it would be loaded from.
pub fn mitsuba_words<'py>(path: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let py = path.py();
    let refused = |why: &str| PyValueError::new_err(format!("{path}: {why}"));
    let tree = py.import("xml.etree.ElementTree")?;
    let root = tree.call_method1("parse", (path,)).and_then(|tree| tree.call_method0("getroot"));
    let root = root.map_err(|error| {
        if error.is_instance_of::<pyo3::exceptions::PyOSError>(py) { error } else { refused("no XML file") }
    })?;
    let attribute = |element: &Bound<'py, PyAny>, name: &str| -> PyResult<String> {
        element.call_method1("get", (name, ""))?.extract()
    };
    let elements = |element: &Bound<'py, PyAny>, tag: &str| -> PyResult<Vec<Bound<'py, PyAny>>> {
        element.call_method1("iter", (tag,))?.try_iter()?.collect()
    };
    // `$name` stands for a parameter, whose value a <default> gives.
    let defaults = elements(&root, "default")?;
    let value_of = |element: &Bound<'py, PyAny>| -> PyResult<String> {
        let mut value = attribute(element, "value")?;
        for default in &defaults {
            value =
                value.replace(&format!("${}", attribute(default, "name")?), &attribute(default, "value")?);
        }
        match value.split_once('$') {
            None => Ok(value),
            Some((_, name)) => Err(refused(&format!("the parameter ${name} has no default"))),
        }
    };
    let sensors = elements(&root, "sensor")?;
    let [sensor] = sensors.as_slice() else {
        return Err(refused(&format!("one sensor is needed; there are {}", sensors.len())));
    };
    let words = PyDict::new(py);
    words.set_item("type", attribute(sensor, "type")?)?;
    for child in sensor.try_iter()? {
        let child = child?;
        let (tag, name) = (child.getattr("tag")?.extract::<String>()?, attribute(&child, "name")?);
        match tag.as_str() {
            "float" | "integer" => {
                let value = value_of(&child)?;
                let value: f64 = value
                    .trim()
                    .parse()
                    .map_err(|_| refused(&format!("{name} must be a number; got {value:?}")))?;
                words.set_item(name, value)?;
            }
            "string" => words.set_item(name, value_of(&child)?)?,
            // Where it stands, its film and its sampler.
            _ => {}
        }
    }
    Ok(words)
}
