//! Colour: shape, sample type, encoding and alpha; converted to planes of linear, premultiplied `f32`.

use super::errors::choice;
use super::invalid_color::{self, InvalidColor, InvalidPixels};
use super::run::{installed, simd};
use super::samples::{SampleType, in_order, sample_type, view, with_sample_type};
use crate::color::{Sample, Transfer};
use crate::memory::Buffer;
use crate::picture::Size;
use crate::rows::{bands, with_channels};
use crate::simd::Simd;
use numpy::ndarray::Axis;
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

/// The meaning of the fourth channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alpha {
    /// Coverage, with which the colours have been multiplied.
    Premultiplied,
    /// Coverage, with which the colours have not been multiplied.
    Straight,
    /// A channel like any other.
    None,
}

/// The format in which the caller gives and receives colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColorFormat {
    pub sample_type: SampleType,
    pub transfer: Transfer,
    pub alpha: Alpha,
    /// Whether pictures have no channel axis.
    pub flat: bool,
}

impl ColorFormat {
    /// Number of channels that hold light rather than coverage.
    pub fn lights(&self, size: Size) -> usize {
        size.channels - usize::from(self.alpha != Alpha::None)
    }
}

/// Shape of the colour: layers, rows, columns, channels.
pub struct ColorShape {
    pub layers: usize,
    pub size: Size,
    layered: bool,
    flat: bool,
}

/// The shape of an array of colour, if it has a valid one.
pub fn color_shape(shape: &[usize]) -> PyResult<ColorShape> {
    let (layers, height, width, channels, flat) = match *shape {
        [height, width] => (1, height, width, 1, true),
        [height, width, channels] => (1, height, width, channels, false),
        [layers, height, width, channels] => (layers, height, width, channels, false),
        _ => {
            return Err(PyValueError::new_err(format!(
                "color must have shape (H, W), (H, W, C) or (L, H, W, 4); got {shape:?}"
            )));
        }
    };
    let layered = shape.len() == 4;
    if layers == 0 || height == 0 || width == 0 {
        return Err(PyValueError::new_err(format!("color must not be empty; got shape {shape:?}")));
    }
    if !(1..=4).contains(&channels) {
        return Err(PyValueError::new_err(format!(
            "color must have 1 to 4 channels in its last axis; got shape {shape:?}"
        )));
    }
    if layered && channels != 4 {
        return Err(PyValueError::new_err(format!(
            "color in layers must have 4 channels (premultiplied RGBA); got shape {shape:?}"
        )));
    }
    if height.max(width) > MAX_SIDE {
        return Err(PyValueError::new_err(format!(
            "color may have at most {MAX_SIDE} rows and columns; got shape {shape:?}"
        )));
    }
    Ok(ColorShape { layers, size: Size { width, height, channels }, layered, flat })
}

/// Cell offsets are 32-bit integers: a padded frame must stay below 2^31 cells.
const MAX_SIDE: usize = 32_768;

/// The magnitude of a value as an integer. Integers are ordered like the magnitudes; those of NaN are above
/// [`INFINITE`].
fn magnitude(v: f32) -> u32 {
    v.abs().to_bits()
}

/// The magnitude of infinity.
const INFINITE: u32 = f32::INFINITY.to_bits();

/// Separates one layer of interleaved colour into planes. Also returns the largest magnitude in it.
fn color_planes<T: Sample>(
    samples: &[T],
    size: Size,
    format: &ColorFormat,
    simd: Simd,
) -> (Buffer<f32>, u32) {
    let (transfer, lights) = (format.transfer, format.lights(size));
    let mut planes = Buffer::unset(size.pixels() * size.channels);
    let mut rows = bands(planes.chunks_mut(size.pixels()), size.width);
    let samples = samples.par_chunks(size.width * size.channels);
    let largest = rows.par_iter_mut().zip(samples).map(|(rows, samples)| {
        simd.run(
            #[inline(always)]
            || with_channels!(size.channels, C => separate::<T, C>(samples, rows)),
        );
        for (c, row) in rows.iter_mut().enumerate() {
            if transfer != Transfer::Linear && c < lights.min(3) {
                simd.run(
                    #[inline(always)]
                    || row.iter_mut().for_each(|v| *v = transfer.decode(*v)),
                );
            }
        }
        let largest = rows.iter().map(|row| {
            simd.run(
                #[inline(always)]
                || row.iter().fold(0, |largest, v| magnitude(*v).max(largest)),
            )
        });
        largest.fold(0, u32::max)
    });
    let largest = largest.reduce(|| 0, u32::max);
    (planes, largest)
}

/// Separates one row of interleaved samples, a block of pixels at a time. The compiler turns such a block into
/// shuffles; it would turn a loop over all pixels into slow gathers.
#[inline(always)]
fn separate<T: Sample, const C: usize>(samples: &[T], rows: &mut [&mut [f32]]) {
    const BLOCK: usize = 16;
    let pixels = samples.as_chunks::<C>().0;
    let (blocks, rest) = pixels.as_chunks::<BLOCK>();
    for (i, block) in blocks.iter().enumerate() {
        for (c, row) in rows.iter_mut().enumerate() {
            let codes: [f32; BLOCK] = std::array::from_fn(|x| block[x][c].to_code());
            row[i * BLOCK..][..BLOCK].copy_from_slice(&codes);
        }
    }
    for (x, pixel) in (pixels.len() - rest.len()..).zip(rest) {
        rows.iter_mut().zip(pixel).for_each(|(row, v)| row[x] = v.to_code());
    }
}

/// The power of two by which a colour of extreme brightness is divided so that sums of many squares stay finite.
/// Colours that are divided by it keep all their bits.
pub fn brighter_than_usual(largest: f32) -> f32 {
    const USUAL_EXPONENT: i32 = 32;
    let exponent = (magnitude(largest) >> 23) as i32 - 127;
    2.0f32.powi((exponent - USUAL_EXPONENT).max(0))
}

/// Multiplies or divides the colour planes by the last one, coverage.
fn scale_by_alpha(planes: &mut [f32], size: Size, scale: impl Fn(f32, f32) -> f32 + Sync) {
    let (color, alpha) = planes.split_at_mut(size.pixels() * (size.channels - 1));
    color.par_chunks_mut(size.pixels()).for_each(|plane| {
        for (v, a) in plane.iter_mut().zip(alpha.iter()) {
            *v = scale(*v, *a);
        }
    });
}

/// The format of an array of colour: its sample type, and its encoding and alpha according to the caller's arguments.
pub fn read_format(
    array: &Bound<'_, PyUntypedArray>,
    shape: &ColorShape,
    alpha: Option<&str>,
    transfer: Option<&str>,
) -> PyResult<ColorFormat> {
    let sample_type = sample_type("color", array, true)?;
    let integer = matches!(sample_type, SampleType::U8 | SampleType::U16);
    let transfer = match transfer {
        Some(name) => choice("transfer", name, &Transfer::NAMES)?,
        None if integer => {
            return Err(PyValueError::new_err(format!(
                "transfer must be given for integer color ({}): \"srgb\" for ordinary pictures, or \"linear\"",
                array.dtype()
            )));
        }
        None => Transfer::Linear,
    };
    let names =
        [("premultiplied", Alpha::Premultiplied), ("straight", Alpha::Straight), ("none", Alpha::None)];
    let alpha = match alpha {
        None if shape.size.channels == 4 => Alpha::Premultiplied,
        None => Alpha::None,
        Some(name) => choice("alpha", name, &names)?,
    };
    if alpha != Alpha::None && !matches!(shape.size.channels, 2 | 4) {
        return Err(PyValueError::new_err(format!(
            "alpha must be \"none\" for color of {} channels: only 2 or 4 channels can hold coverage",
            shape.size.channels
        )));
    }
    if shape.layered && alpha == Alpha::None {
        return Err(PyValueError::new_err(
            "alpha must be \"premultiplied\" or \"straight\" for color in layers: it says where a layer has a surface",
        ));
    }
    Ok(ColorFormat { sample_type, transfer, alpha, flat: shape.flat })
}

/// The planes of one layer, linear and premultiplied, the largest magnitude in them, and the pixels that were filled, if
/// any.
pub fn read_layer_color(
    array: &Bound<'_, PyUntypedArray>,
    shape: &ColorShape,
    layer: usize,
    format: &ColorFormat,
    invalid: InvalidColor,
) -> PyResult<(Buffer<f32>, f32, Option<InvalidPixels>)> {
    let size = shape.size;
    let simd = simd()?;
    let (mut planes, mut largest) = with_sample_type!(format.sample_type, T => view::<T, _>(array, |view| {
        let view = if shape.layered { view.index_axis_move(Axis(0), layer) } else { view };
        in_order(&view, |samples| color_planes(samples, size, format, simd))
    }))??;
    let found = if largest >= INFINITE { invalid_color::find(&planes, size) } else { None };
    if let (Some(found), InvalidColor::Raise) = (found, invalid) {
        return Err(found.error(size));
    }
    if format.alpha != Alpha::None {
        let alpha = &planes[size.pixels() * (size.channels - 1)..];
        if let Some(i) = alpha.iter().position(|a| a.is_finite() && !(0.0..=1.0 + 1e-3).contains(a)) {
            return Err(PyValueError::new_err(format!(
                "color must have alpha from 0 to 1; got {} at row {}, column {}",
                alpha[i],
                i / size.width,
                i % size.width
            )));
        }
    }
    if format.alpha == Alpha::Straight {
        installed(|| scale_by_alpha(&mut planes, size, |v, a| v * a))?;
    }
    // Premultiplied colours have means, where straight ones would count what nobody sees.
    if found.is_some() {
        installed(|| invalid_color::fill(&mut planes, size))??;
        largest = planes.iter().fold(0, |largest, v| magnitude(*v).max(largest));
    }
    Ok((planes, f32::from_bits(largest), found))
}
