//! The destination of pictures: an array of the caller's or a new one, in the caller's dtype and colour format.

use super::color::{Alpha, ColorFormat};
use super::run::{detached, simd};
use super::samples::{SampleType, given, with_sample_type};
use crate::cancel::Cancel;
use crate::color::{Sample, Transfer};
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::rows::with_channels;
use crate::simd::Simd;
use bytemuck::Pod;
use numpy::ndarray::ArrayView1;
use numpy::{
    Element, PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray,
    PyUntypedArrayMethods, dtype,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use rayon::prelude::*;

/// Number of pixels that a worker takes at a time.
const CHUNK_PIXELS: usize = 1 << 12;
/// Number of pixels of one channel that are encoded together, in vectors.
const BLOCK: usize = 16;

/// The pictures that are to be rendered, and their destination.
pub struct Output<'a> {
    pub format: &'a ColorFormat,
    /// The size that is rendered.
    pub rendered: Size,
    /// The factor by which rendered colours are to be multiplied.
    pub brighter: f32,
    /// Number of pixels on every side that are left out.
    pub margin: usize,
    /// The number of pictures, if they have an axis of their own.
    pub stacked: Option<usize>,
}

impl Output<'_> {
    /// Returns the caller's array `out`, or a new one. `render` fills one slice per picture: interleaved, linear and
    /// premultiplied.
    pub fn fill<'py, R: Send>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<usize>,
        render: impl FnOnce(Vec<&mut [f32]>, &Cancel) -> Result<R> + Send,
    ) -> PyResult<(Bound<'py, PyAny>, R)> {
        with_sample_type!(self.format.sample_type, T => {
            let array = match out {
                Some(out) => self.checked::<T>(out)?,
                None => new_array::<T>(py, &self.shape())?,
            };
            let result = self.fill_array(py, &array, threads, render)?;
            Ok((array.into_any(), result))
        })
    }

    /// The size of a picture without its margin.
    fn size(&self) -> Size {
        let side = |n: usize| n - 2 * self.margin;
        let Size { width, height, channels } = self.rendered;
        Size { width: side(width), height: side(height), channels }
    }

    fn shape(&self) -> Vec<usize> {
        let Size { width, height, channels } = self.size();
        let stacked = self.stacked.into_iter().chain([height, width]);
        stacked.chain((!self.format.flat).then_some(channels)).collect()
    }

    /// The caller's array, if the pictures can be written into it.
    fn checked<'py, T: Element>(&self, out: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        let untyped: &Bound<'py, PyUntypedArray> = given("out", out)?;
        let (dtype, expected) = (untyped.dtype(), dtype::<T>(out.py()));
        if !dtype.is_equiv_to(&expected) {
            return Err(PyTypeError::new_err(format!(
                "out must have the dtype of color, {expected}; got {dtype}"
            )));
        }
        if untyped.shape() != self.shape() {
            return Err(PyValueError::new_err(format!(
                "out must have shape {:?}; got {:?}",
                self.shape(),
                untyped.shape()
            )));
        }
        if !untyped.is_c_contiguous() || !untyped.is_aligned() {
            return Err(PyValueError::new_err(
                "out must be C-contiguous and aligned; numpy.empty makes such an array",
            ));
        }
        Ok(out.cast::<PyArrayDyn<T>>()?.clone())
    }

    fn fill_array<'py, T: Sample + Element + Pod, R: Send>(
        &self,
        py: Python<'py>,
        array: &Bound<'py, PyArrayDyn<T>>,
        threads: Option<usize>,
        render: impl FnOnce(Vec<&mut [f32]>, &Cancel) -> Result<R> + Send,
    ) -> PyResult<R> {
        let mut writable = array.try_readwrite().map_err(|_| {
            PyValueError::new_err("out must be writable, and not be in use by another call at the same time")
        })?;
        let values: &mut [T] = writable.as_slice_mut()?;
        let length = self.rendered.pixels() * self.rendered.channels;
        let simd = simd()?;
        detached(py, threads, move |cancel| {
            if self.format.sample_type == SampleType::F32 && self.margin == 0 {
                let linear: &mut [f32] = bytemuck::cast_slice_mut(values);
                let result = render(linear.chunks_exact_mut(length).collect(), cancel)?;
                self.encode(simd, linear);
                return Ok(result);
            }
            let mut linear = Buffer::unset(self.stacked.unwrap_or(1) * length);
            let result = render(linear.chunks_exact_mut(length).collect(), cancel)?;
            self.encode(simd, &mut linear);
            self.convert(simd, &linear, values);
            Ok(result)
        })
    }

    /// Encodes linear, premultiplied pixels in the caller's format.
    fn encode(&self, simd: Simd, pixels: &mut [f32]) {
        let ColorFormat { alpha, transfer, .. } = *self.format;
        if alpha != Alpha::Straight && transfer == Transfer::Linear && self.brighter == 1.0 {
            return;
        }
        let lights = self.format.lights(self.rendered);
        pixels.par_chunks_mut(CHUNK_PIXELS * self.rendered.channels).for_each(|pixels| {
            with_channels!(self.rendered.channels, C => simd.run(#[inline(always)] || self.encode_pixels::<C>(lights, pixels)));
        });
    }

    /// Encodes some pixels, whose first `lights` channels hold light.
    #[inline(always)]
    fn encode_pixels<const C: usize>(&self, lights: usize, pixels: &mut [f32]) {
        let ColorFormat { alpha, transfer, .. } = *self.format;
        let pixels = pixels.as_chunks_mut::<C>().0;
        if alpha == Alpha::Straight {
            for pixel in pixels.iter_mut().filter(|pixel| pixel[C - 1] > 0.0) {
                let (color, alpha) = pixel.split_at_mut(C - 1);
                color.iter_mut().for_each(|v| *v /= alpha[0]);
            }
        }
        for c in 0..lights {
            let curve = if c < 3 { transfer } else { Transfer::Linear };
            // Unmixed colours may be brighter than all input colours.
            let encoded = |v: f32| curve.encode((v * self.brighter).clamp(f32::MIN, f32::MAX));
            let (blocks, rest) = pixels.as_chunks_mut::<BLOCK>();
            for block in blocks {
                let mut values: [f32; BLOCK] = std::array::from_fn(|x| block[x][c]);
                values.iter_mut().for_each(|v| *v = encoded(*v));
                (0..BLOCK).for_each(|x| block[x][c] = values[x]);
            }
            rest.iter_mut().for_each(|pixel| pixel[c] = encoded(pixel[c]));
        }
    }

    /// Writes pictures without their margin in the caller's dtype.
    fn convert<T: Sample>(&self, simd: Simd, pixels: &[f32], out: &mut [T]) {
        let (size, margin, channels) = (self.size(), self.margin, self.rendered.channels);
        let source = |row: usize| {
            let (picture, y) = (row / size.height, row % size.height + margin);
            let first = (picture * self.rendered.height + y) * self.rendered.width + margin;
            &pixels[first * channels..][..size.width * channels]
        };
        out.par_chunks_exact_mut(size.width * channels).enumerate().for_each(|(row, out)| {
            let source = source(row);
            simd.run(
                #[inline(always)]
                || out.iter_mut().zip(source).for_each(|(out, v)| *out = T::from_code(*v)),
            );
        });
    }
}

/// A new array. When it is freed, its memory is kept for the next render.
fn new_array<'py, T: Element + Pod + Send>(
    py: Python<'py>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let buffer = Buffer::<T>::unset(shape.iter().product());
    let values: *const [T] = &*buffer;
    let owner = PyCapsule::new_with_value(py, buffer, c"dofsim.Buffer")?;
    // SAFETY: the values live on the heap, where they stay while the capsule lives, and nothing else refers to them.
    let array = unsafe { PyArray1::borrow_from_array(&ArrayView1::from(&*values), owner.into_any()) };
    array.reshape(shape)
}
