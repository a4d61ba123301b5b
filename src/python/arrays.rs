//! NumPy arrays at the border: checked once, converted to planar `f32`, and back.

use super::errors::choice;
use super::run::{installed, simd};
use crate::color::{Sample, Transfer};
use crate::depth::{DepthKind, Invalid, Rays, disparities, disparity_plane};
use crate::memory::Buffer;
use crate::optics::{Base, Frame, Lens};
use crate::picture::{Layer, Picture, Size};
use crate::rows::{bands, with_channels};
use crate::simd::Simd;
use bytemuck::Pod;
use half::f16;
use numpy::ndarray::{ArrayViewD, Axis, Ix2};
use numpy::{
    Element, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, dtype,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;

/// Sample types of colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleType {
    F16,
    F32,
    F64,
    U8,
    U16,
}

/// Runs a generic function for the sample type at hand.
macro_rules! with_sample_type {
    ($sample_type:expr, $t:ident => $call:expr) => {
        match $sample_type {
            SampleType::F16 => {
                type $t = f16;
                $call
            }
            SampleType::F32 => {
                type $t = f32;
                $call
            }
            SampleType::F64 => {
                type $t = f64;
                $call
            }
            SampleType::U8 => {
                type $t = u8;
                $call
            }
            SampleType::U16 => {
                type $t = u16;
                $call
            }
        }
    };
}
pub(super) use with_sample_type;

/// What the fourth channel is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alpha {
    /// Coverage that the colours have been multiplied by.
    Premultiplied,
    /// Coverage that they have not been multiplied by.
    Straight,
    /// A channel like any other.
    None,
}

/// How colour comes in and goes out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColorFormat {
    pub sample_type: SampleType,
    pub transfer: Transfer,
    pub alpha: Alpha,
    /// Whether pictures have no channel axis.
    pub flat: bool,
}

impl ColorFormat {
    /// How many of the channels hold light rather than coverage.
    pub fn lights(&self, size: Size) -> usize {
        size.channels - usize::from(self.alpha != Alpha::None)
    }
}

/// The words by which a caller describes depth.
pub struct DepthWords<'a> {
    pub depth_kind: &'a str,
    pub near: Option<f64>,
    pub far: Option<f64>,
}

/// The array that a caller gave for the argument `name`.
pub fn array<'a, 'py>(name: &str, value: &'a Bound<'py, PyAny>) -> PyResult<&'a Bound<'py, PyUntypedArray>> {
    value.cast::<PyUntypedArray>().map_err(|_| {
        let kind = value.get_type();
        PyTypeError::new_err(format!("{name} must be a NumPy array; got {kind}"))
    })
}

fn sample_type(name: &str, array: &Bound<'_, PyUntypedArray>, integers: bool) -> PyResult<SampleType> {
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
        PyTypeError::new_err(format!("{name} must have dtype {accepted} in native byte order; got {given}"))
    })
}

/// Calls `read` with a view of the array, whatever its strides.
fn view<T: Element, R>(
    array: &Bound<'_, PyUntypedArray>,
    read: impl FnOnce(ArrayViewD<'_, T>) -> R,
) -> PyResult<R> {
    let typed = array.cast::<PyArrayDyn<T>>()?.try_readonly()?;
    Ok(read(typed.as_array()))
}

/// Shape of the colour: layers, rows, columns, channels.
struct ColorShape {
    layers: usize,
    size: Size,
    layered: bool,
    flat: bool,
}

fn color_shape(shape: &[usize]) -> PyResult<ColorShape> {
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

/// An error if some value is not finite, with how many there are and where the first is.
fn refuse_infinite(planes: &[f32], size: Size) -> PyResult<()> {
    for (c, plane) in planes.chunks(size.pixels()).enumerate() {
        if let Some(first) = plane.iter().position(|v| !v.is_finite()) {
            let bad = plane.iter().filter(|v| !v.is_finite()).count();
            return Err(PyValueError::new_err(format!(
                "color has {bad} values in channel {c} that are not finite (or too large for float32); \
                 the first is at row {}, column {}",
                first / size.width,
                first % size.width
            )));
        }
    }
    Ok(())
}

/// Does `work` with the samples of an array in row-major order, copied if they are not, on the workers that are set.
fn in_order<T: Sample + Pod, R: Send>(
    view: &ArrayViewD<'_, T>,
    work: impl FnOnce(&[T]) -> R + Send,
) -> PyResult<R> {
    match view.as_slice() {
        Some(samples) => installed(|| work(samples)),
        None => installed(|| work(&ordered(view))),
    }
}

/// The samples of an array of rows of pixels, or of values, in row-major order, whatever its strides.
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

/// The magnitude of a value as a number that is in order with others' and beyond [`INFINITE`] for what is none.
fn magnitude(v: f32) -> u32 {
    v.abs().to_bits()
}

/// The magnitude of infinity.
const INFINITE: u32 = f32::INFINITY.to_bits();

/// Takes one layer of interleaved colour apart into planes; also the largest magnitude in it.
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

/// Takes one row of interleaved samples apart, a block of pixels at a time: the compiler makes shuffles of that, where
/// it would make slow gathers of a loop over all.
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

/// The power of two that brings a colour of extreme brightness down to where the sums of many squares are numbers. What
/// it divides keeps all its bits.
fn brighter_than_usual(largest: f32) -> f32 {
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

fn read_format(
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

fn read_layer_color(
    array: &Bound<'_, PyUntypedArray>,
    shape: &ColorShape,
    layer: usize,
    format: &ColorFormat,
) -> PyResult<(Buffer<f32>, f32)> {
    let size = shape.size;
    let simd = simd()?;
    let (mut planes, largest) = with_sample_type!(format.sample_type, T => view::<T, _>(array, |view| {
        let view = if shape.layered { view.index_axis_move(Axis(0), layer) } else { view };
        in_order(&view, |samples| color_planes(samples, size, format, simd))
    }))??;
    if largest >= INFINITE {
        refuse_infinite(&planes, size)?;
    }
    if format.alpha != Alpha::None {
        let alpha = &planes[size.pixels() * (size.channels - 1)..];
        if let Some(i) = alpha.iter().position(|a| !(0.0..=1.0 + 1e-3).contains(a)) {
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
    Ok((planes, f32::from_bits(largest)))
}

fn positive(name: &str, value: Option<f64>, kind: &str) -> PyResult<f64> {
    match value {
        Some(v) if v > 0.0 => Ok(v),
        Some(v) => {
            Err(PyValueError::new_err(format!("{name} must be a distance in metres greater than 0; got {v}")))
        }
        None => Err(PyValueError::new_err(format!("{name} must be given for depth_kind={kind:?}"))),
    }
}

/// The kind of depth that the words describe, checked against the lens it is for.
pub fn read_depth_kind(words: &DepthWords, lens: &Lens) -> PyResult<DepthKind> {
    let kind = read_depth_words(words)?;
    match (kind, lens.base) {
        (DepthKind::Disparity | DepthKind::Relative, Base::Thin { .. }) => {
            Err(PyValueError::new_err(format!(
                "depth_kind={:?} is relative and needs a lens made by Lens.from_disparity; metric inverse \
                 depth is depth_kind=\"inverse_z\"",
                words.depth_kind
            )))
        }
        (DepthKind::Disparity | DepthKind::Relative, Base::Relative { .. }) => Ok(kind),
        (_, Base::Relative { .. }) => Err(PyValueError::new_err(format!(
            "depth_kind={:?} is metric, but the lens was made by Lens.from_disparity, which needs \
             depth_kind=\"disparity\" or \"relative\"",
            words.depth_kind
        ))),
        (_, Base::Thin { .. }) => Ok(kind),
    }
}

/// The kind of depth that the words describe.
pub fn read_depth_words(words: &DepthWords) -> PyResult<DepthKind> {
    let name = words.depth_kind;
    let names = [
        ("z", DepthKind::Z),
        ("distance", DepthKind::Distance),
        ("inverse_z", DepthKind::InverseZ),
        ("disparity", DepthKind::Disparity),
        ("relative", DepthKind::Relative),
        ("zbuffer", DepthKind::ZBuffer { near: 0.0, far: 0.0 }),
        ("distance_from_near", DepthKind::DistanceFromNear { near: 0.0 }),
    ];
    Ok(match choice("depth_kind", name, &names)? {
        DepthKind::ZBuffer { .. } => {
            let (near, far) = (positive("near", words.near, name)?, positive("far", words.far, name)?);
            if far <= near {
                return Err(PyValueError::new_err(format!(
                    "far must be greater than near ({near}); got {far}"
                )));
            }
            DepthKind::ZBuffer { near, far }
        }
        DepthKind::DistanceFromNear { .. } => {
            DepthKind::DistanceFromNear { near: positive("near", words.near, name)? }
        }
        kind => {
            if words.near.is_some() || words.far.is_some() {
                return Err(PyValueError::new_err(format!(
                    "near and far are for depth_kind=\"zbuffer\" and \"distance_from_near\"; got depth_kind={name:?}"
                )));
            }
            kind
        }
    })
}

/// What to do with values that are no depth.
pub fn read_invalid(name: &str) -> PyResult<Invalid> {
    choice("invalid", name, &[("raise", Invalid::Raise), ("far", Invalid::Far)])
}

/// Raw depth planes of an array of shape (H, W), or (L, H, W).
pub struct DepthPlanes {
    pub width: usize,
    pub height: usize,
    pub planes: Vec<Buffer<f32>>,
}

/// Reads depth as it is, without taking it for anything.
pub fn read_depth(depth: &Bound<'_, PyAny>) -> PyResult<DepthPlanes> {
    let array = array("depth", depth)?;
    let sample_type = sample_type("depth", array, false)?;
    let shape = array.shape();
    let (layers, height, width) = match *shape {
        [height, width] => (1, height, width),
        [layers, height, width] => (layers, height, width),
        _ => {
            return Err(PyValueError::new_err(format!(
                "depth must have shape (H, W), or (L, H, W) for layers; got {shape:?}"
            )));
        }
    };
    if layers * height * width == 0 {
        return Err(PyValueError::new_err(format!("depth must not be empty; got shape {shape:?}")));
    }
    let planes = with_sample_type!(sample_type, T => view::<T, _>(array, |view| {
        let layer = |i: usize| if view.ndim() == 3 { view.index_axis(Axis(0), i) } else { view.view() };
        let values = |v: &[T]| Buffer::of_each(v, |d| d.to_code());
        (0..layers).map(|i| in_order(&layer(i), values)).collect::<PyResult<_>>()
    }))??;
    Ok(DepthPlanes { width, height, planes })
}

/// The disparity of a picture, and the places of its pixels before a lens.
pub struct SeenDepth {
    pub width: usize,
    pub height: usize,
    disparity: Buffer<f32>,
    /// For a lens over relative disparity, which has no places, pixels.
    rays: Rays,
}

impl SeenDepth {
    /// Disparity of a pixel, if it has a depth.
    pub fn disparity(&self, x: usize, y: usize) -> Option<f64> {
        let d = self.disparity[y * self.width + x];
        (!d.is_nan()).then_some(f64::from(d))
    }

    /// Where a pixel looks, in focal lengths from the optical axis.
    pub fn place(&self, x: usize, y: usize) -> [f64; 2] {
        let Rays { focal_px, centre } = self.rays;
        [(x as f64 - centre[0]) / focal_px, (y as f64 - centre[1]) / focal_px]
    }
}

/// Reads depth as a lens sees it.
pub fn read_seen_depth(depth: &Bound<'_, PyAny>, words: &DepthWords, lens: &Lens) -> PyResult<SeenDepth> {
    let kind = read_depth_kind(words, lens)?;
    let planes = read_depth(depth)?;
    let (width, height) = (planes.width, planes.height);
    let rays = Frame::plain(width, height).rays(lens);
    let (disparity, _) = installed(|| disparities(&planes.planes[0], width, kind, rays))??;
    let rays = rays.unwrap_or(Rays { focal_px: 1.0, centre: [0.0; 2] });
    Ok(SeenDepth { width, height, disparity, rays })
}

/// Colour and depth, read but not yet seen through a lens.
pub struct Input {
    pub size: Size,
    pub format: ColorFormat,
    /// By what the colours that came in are brighter than those that are rendered, a power of two.
    pub brighter: f32,
    /// Colour planes of each layer.
    color: Vec<Arc<Buffer<f32>>>,
    /// Raw depth of each layer.
    depth: Vec<Buffer<f32>>,
}

impl Input {
    /// Reads and checks both arrays.
    pub fn read(
        color: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        alpha: Option<&str>,
        transfer: Option<&str>,
    ) -> PyResult<Input> {
        let array = array("color", color)?;
        let shape = color_shape(array.shape())?;
        let format = read_format(array, &shape, alpha, transfer)?;
        let planes = read_depth(depth)?;
        let expected = (shape.layers, shape.size.height, shape.size.width);
        if (planes.planes.len(), planes.height, planes.width) != expected {
            return Err(PyValueError::new_err(format!(
                "depth must have the same layers, rows and columns as color, {expected:?}; got {:?}",
                (planes.planes.len(), planes.height, planes.width)
            )));
        }
        let (mut color, largest): (Vec<_>, Vec<_>) = (0..shape.layers)
            .map(|layer| read_layer_color(array, &shape, layer, &format))
            .collect::<PyResult<Vec<_>>>()?
            .into_iter()
            .unzip();
        let brighter = brighter_than_usual(largest.into_iter().fold(0.0, f32::max));
        if brighter > 1.0 {
            let lights = format.lights(shape.size) * shape.size.pixels();
            let planes = color.iter_mut().map(|planes| &mut planes[..lights]);
            planes.for_each(|planes| planes.iter_mut().for_each(|v| *v /= brighter));
        }
        let color = color.into_iter().map(Arc::new).collect();
        Ok(Input { size: shape.size, format, brighter, color, depth: planes.planes })
    }

    /// The number of layers.
    pub fn layers(&self) -> usize {
        self.color.len()
    }

    /// The picture in disparity. Kinds of depth along the ray need `rays`.
    pub fn picture(&self, kind: DepthKind, rays: Option<Rays>, invalid: Invalid) -> PyResult<Picture> {
        let size = self.size;
        let layered = self.color.len() > 1;
        if layered && kind == DepthKind::Relative {
            return Err(PyValueError::new_err(
                "depth_kind=\"relative\" brings one picture's disparity to 0 to 1, and cannot be used with layers; \
                 do that yourself and pass \"disparity\"",
            ));
        }
        let layers = self
            .color
            .iter()
            .zip(&self.depth)
            .map(|(color, depth)| {
                // Where a layer has no surface its depth means nothing.
                let mut depth = Cow::Borrowed(depth);
                if layered {
                    let alpha = &color[size.pixels() * (size.channels - 1)..];
                    let background = match kind {
                        DepthKind::InverseZ
                        | DepthKind::Disparity
                        | DepthKind::Relative
                        | DepthKind::DistanceFromNear { .. } => 0.0,
                        DepthKind::ZBuffer { .. } => 1.0,
                        DepthKind::Z | DepthKind::Distance => f32::INFINITY,
                    };
                    let values = depth.to_mut().iter_mut();
                    values.zip(alpha).filter(|(_, a)| **a <= 0.0).for_each(|(d, _)| *d = background);
                }
                let disparity = installed(|| disparity_plane(&depth, size.width, kind, rays, invalid))??;
                Ok(Layer::new(Arc::clone(color), disparity))
            })
            .collect::<PyResult<_>>()?;
        Ok(Picture { size, layers })
    }
}
