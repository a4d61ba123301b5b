//! The core's errors as Python exceptions.

use crate::error::Error;
use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;

create_exception!(dofsim, DeviceError, PyRuntimeError, "The device asked for cannot be used.");

impl From<Error> for PyErr {
    fn from(error: Error) -> PyErr {
        match error {
            Error::Value(text) => PyValueError::new_err(text),
            Error::Device(text) => DeviceError::new_err(text),
            Error::Memory(text) => PyMemoryError::new_err(text),
            // The signal that caused the stop raises its own exception; this is for a stop without a signal.
            Error::Cancelled => PyKeyboardInterrupt::new_err("the render was interrupted"),
        }
    }
}

/// The text of a value in an error message: as Python writes it, but no longer than a line.
pub fn shown(value: &Bound<'_, PyAny>) -> String {
    const LONGEST: usize = 80;
    let text = value.repr().map_or_else(|_| value.get_type().to_string(), |repr| repr.to_string());
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// What is wrong with an argument, in other words: a `TypeError` stays one, all else is a `ValueError`.
pub fn reworded(py: Python<'_>, error: &PyErr, text: String) -> PyErr {
    match error.is_instance_of::<PyTypeError>(py) {
        true => PyTypeError::new_err(text),
        false => PyValueError::new_err(text),
    }
}

/// The value of a name, which must be among those accepted.
pub fn choice<T: Copy>(argument: &str, name: &str, accepted: &[(&str, T)]) -> PyResult<T> {
    let found = accepted.iter().find(|(n, _)| *n == name).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let names: Vec<String> = accepted.iter().map(|(n, _)| format!("{n:?}")).collect();
        PyValueError::new_err(format!("{argument} must be one of {}; got {name:?}", names.join(", ")))
    })
}
