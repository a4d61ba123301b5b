//! Numbers that a caller gives, and errors that name them.

use super::errors::shown;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// A type that arguments may have.
pub trait Argument: Sized {
    /// What a value of another type is told.
    const KIND: &'static str;
    /// What a value is told that is of this kind, but too small or too large for the type.
    const RANGE: &'static str = Self::KIND;

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self>;
}

/// The value of the argument `name`.
pub fn argument<T: Argument>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<T> {
    T::read(value).map_err(|error| {
        let text = |accepted| format!("{name} must be {accepted}; got {}", shown(value));
        match error.is_instance_of::<PyTypeError>(value.py()) {
            true => PyTypeError::new_err(text(T::KIND)),
            false => PyValueError::new_err(text(T::RANGE)),
        }
    })
}

/// What reads the argument of its own name.
macro_rules! arguments {
    ($($name:ident)*) => {$(
        pub fn $name<T: Argument>(value: &Bound<'_, PyAny>) -> PyResult<T> {
            argument(stringify!($name), value)
        }
    )*};
}

arguments! {
    aperture_radius apodization astigmatism axial_color barn_doors blades breathing_focal_length_mm cat_eye coc_limit_mm coma cx
    cy depth_range f_number far field_curvature focal_length_mm focus focus_distance focused_size fov fx half_diagonal_mm height in_focus
    lateral_color layers max_coc_px max_gain near obstruction overscan points principal_point radius_px ratio reference rotation roundness sensor_mm
    sensor_width_mm spherical strength_percent strength_px supersample threads tilt width x y z
}

impl Argument for f64 {
    const KIND: &'static str = "a number";
    const RANGE: &'static str = "a number from -1.7e308 to 1.7e308";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract()
    }
}

impl Argument for usize {
    const KIND: &'static str = "a whole number";
    const RANGE: &'static str = "a whole number from 0 to 2**63 - 1";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let value: i64 = value.extract()?;
        Ok(usize::try_from(value)?)
    }
}

impl Argument for isize {
    const KIND: &'static str = "a whole number";
    const RANGE: &'static str = "a whole number from -2**63 to 2**63 - 1";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract()
    }
}

impl Argument for u32 {
    const KIND: &'static str = "a whole number";
    const RANGE: &'static str = "a whole number from 0 to 2**32 - 1";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract()
    }
}

impl Argument for (f64, f64) {
    const KIND: &'static str = "a tuple of two numbers";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract()
    }
}

impl Argument for [f64; 2] {
    const KIND: &'static str = "two numbers";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract()
    }
}

impl Argument for (f64, f64, f64) {
    const KIND: &'static str = "a tuple of three numbers";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract()
    }
}

impl Argument for String {
    const KIND: &'static str = "a word";

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract()
    }
}

impl<T: Argument> Argument for Option<T> {
    const KIND: &'static str = T::KIND;
    const RANGE: &'static str = T::RANGE;

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        if value.is_none() { Ok(None) } else { T::read(value).map(Some) }
    }
}
