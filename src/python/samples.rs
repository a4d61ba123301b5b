//! NumPy arrays of any strides and sample type, read in row-major order.

use super::run::installed;
use crate::color::Sample;
use crate::memory::Buffer;
use bytemuck::Pod;
use half::f16;
use numpy::ndarray::{ArrayViewD, Axis, Ix2};
use numpy::{
    Element, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, dtype,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// Sample types of colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleType {
    F16,
    F32,
    F64,
    U8,
    U16,
}

/// Runs a generic function with the given sample type.
macro_rules! with_sample_type {
    ($sample_type:expr, $t:ident => $call:expr) => {
        match $sample_type {
            $crate::python::samples::SampleType::F16 => {
                type $t = half::f16;
                $call
            }
            $crate::python::samples::SampleType::F32 => {
                type $t = f32;
                $call
            }
            $crate::python::samples::SampleType::F64 => {
                type $t = f64;
                $call
            }
            $crate::python::samples::SampleType::U8 => {
                type $t = u8;
                $call
            }
            $crate::python::samples::SampleType::U16 => {
                type $t = u16;
                $call
            }
        }
    };
}
pub(super) use with_sample_type;

/// The caller's array for the argument `name`, as it is.
pub fn given<'a, 'py>(name: &str, value: &'a Bound<'py, PyAny>) -> PyResult<&'a Bound<'py, PyUntypedArray>> {
    value.cast::<PyUntypedArray>().map_err(|_| {
        let kind = value.get_type();
        PyTypeError::new_err(format!("{name} must be a NumPy array; got {kind}"))
    })
}

/// The array that a caller gave for the argument `name`, in a layout that can be viewed.
pub fn array<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    viewable(given(name, value)?)
}

/// The array itself if its elements can be viewed where they are, else a copy in row-major order.
///
/// A view counts strides in whole elements, at addresses that suit the type, in the byte order of this machine. The
/// fields of packed records have strides in bytes, and buffers may begin anywhere.
pub fn viewable<'py>(array: &Bound<'py, PyUntypedArray>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let dtype = array.dtype();
    let size = dtype.itemsize().max(1) as isize;
    let native = dtype.is_native_byteorder() != Some(false);
    if native && array.is_aligned() && array.strides().iter().all(|stride| stride % size == 0) {
        return Ok(array.clone());
    }
    let native = dtype.call_method1("newbyteorder", ("=",))?;
    Ok(array.call_method1("astype", (native, "C"))?.cast_into::<PyUntypedArray>()?)
}

/// The sample type of an array; `integers` says whether integers are accepted.
pub fn sample_type(name: &str, array: &Bound<'_, PyUntypedArray>, integers: bool) -> PyResult<SampleType> {
    let (py, given) = (array.py(), array.dtype());
    let known = [
        (dtype::<f16>(py), SampleType::F16),
        (dtype::<f32>(py), SampleType::F32),
        (dtype::<f64>(py), SampleType::F64),
        (dtype::<u8>(py), SampleType::U8),
        (dtype::<u16>(py), SampleType::U16),
    ];
    let usable = known.iter().take(if integers { 5 } else { 3 });
    usable.clone().find(|(dtype, _)| given.is_equiv_to(dtype)).map(|(_, t)| *t).ok_or_else(|| {
        let accepted = if integers {
            "float16, float32, float64, uint8 or uint16"
        } else {
            "float16, float32 or float64"
        };
        PyTypeError::new_err(format!("{name} must have dtype {accepted}; got {given}"))
    })
}

/// Calls `read` with a view of the array, whatever its strides.
pub fn view<T: Element, R>(
    array: &Bound<'_, PyUntypedArray>,
    read: impl FnOnce(ArrayViewD<'_, T>) -> R,
) -> PyResult<R> {
    let typed = array.cast::<PyArrayDyn<T>>()?.try_readonly()?;
    Ok(read(typed.as_array()))
}

/// Runs `work`, on the current workers, with the samples of an array in row-major order. They are copied if they are
/// not.
pub fn in_order<T: Sample + Pod, R: Send>(
    view: &ArrayViewD<'_, T>,
    work: impl FnOnce(&[T]) -> R + Send,
) -> PyResult<R> {
    match view.as_slice() {
        Some(samples) => installed(|| work(samples)),
        None => installed(|| work(&ordered(view))),
    }
}

/// The samples of an array of pixel rows, or of values, in row-major order, whatever its strides.
fn ordered<T: Sample + Pod>(view: &ArrayViewD<'_, T>) -> Buffer<T> {
    let mut samples = Buffer::unset(view.len());
    let length = view.len() / view.len_of(Axis(0));
    samples.par_chunks_mut(length).enumerate().for_each(|(y, out)| {
        let row = view.index_axis(Axis(0), y);
        let row = if row.ndim() == 1 { row.insert_axis(Axis(1)) } else { row };
        let pixels = row.into_dimensionality::<Ix2>().expect("rows hold values, or pixels of channels");
        for (x, out) in out.chunks_exact_mut(pixels.ncols()).enumerate() {
            out.iter_mut().enumerate().for_each(|(c, out)| *out = pixels[[x, c]]);
        }
    });
    samples
}
