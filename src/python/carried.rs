//! Channels that go through a lens as a guide finds the way: read and checked.

use super::color::{Alpha, ColorFormat};
use super::errors::{choice, reworded, shown};
use super::input::Input;
use super::run::installed;
use super::samples::{array, in_order, sample_type, view, with_sample_type};
use crate::carried::{Carried, Channel, ChannelKind};
use crate::color::{Sample, Transfer};
use crate::device::Device;
use crate::memory::Buffer;
use crate::method::Method;
use crate::optics::Lens;
use crate::picture::{ChannelGroup, Size, Weighting};
use crate::rows::bands;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;
use rayon::prelude::*;
use std::sync::Arc;

/// Channels with a guide, and the format in which they are given back.
pub struct Channels {
    pub carried: Carried,
    pub format: ColorFormat,
}

/// The arguments beside `color` that say that it holds channels, if they are given.
#[derive(Clone, Copy)]
pub struct ChannelArguments<'a, 'py> {
    pub guide: Option<&'a Bound<'py, PyAny>>,
    pub kinds: Option<&'a Bound<'py, PyAny>>,
}

/// What an error says of `color` is said of the guide.
fn of_guide(py: Python<'_>, error: PyErr) -> PyErr {
    let about_it = error.is_instance_of::<PyValueError>(py) || error.is_instance_of::<PyTypeError>(py);
    match error.value(py).to_string().strip_prefix("color ").filter(|_| about_it) {
        Some(rest) => reworded(py, &error, format!("guide {rest}")),
        None => error,
    }
}

impl<'a, 'py> ChannelArguments<'a, 'py> {
    /// Whether `color` holds channels.
    pub fn any(&self) -> bool {
        self.guide.is_some() || self.kinds.is_some()
    }

    /// The device of channels: the CPU, for which "auto" stands here.
    pub fn device(&self, name: &str, read: impl FnOnce() -> PyResult<Device>) -> PyResult<Device> {
        if !self.any() {
            return read();
        }
        match name {
            "auto" | "cpu" => Ok(Device::Cpu),
            _ => Err(PyValueError::new_err(format!(
                "device must be \"cpu\" or \"auto\" with guide or kinds, which are not rendered on a GPU; got {name:?}"
            ))),
        }
    }

    /// The picture that decides, by `read`: the guide, or the channels themselves.
    pub fn picture(
        &self,
        color: &Bound<'py, PyAny>,
        read: impl FnOnce(&Bound<'py, PyAny>) -> PyResult<Input>,
    ) -> PyResult<Input> {
        let Some(guide) = self.guide else {
            if self.kinds.is_some() {
                let shape = array("color", color)?.shape().to_vec();
                if shape.len() == 3 && shape[2] > 4 {
                    return Err(PyValueError::new_err(format!(
                        "guide must be given for color of more than 4 channels: the picture that decides; got color of \
                         shape {shape:?}"
                    )));
                }
            }
            return read(color);
        };
        let (own, shape) = (array("guide", guide)?.shape().to_vec(), array("color", color)?.shape().to_vec());
        if !matches!(own.len(), 2 | 3) {
            return Err(PyValueError::new_err(format!(
                "guide must have shape (H, W) or (H, W, C) with 1 to 4 channels: a picture of one layer; got {own:?}"
            )));
        }
        if !matches!(shape.len(), 2 | 3) || shape.contains(&0) {
            return Err(PyValueError::new_err(format!(
                "color must have shape (H, W) or (H, W, C) with guide; got {shape:?}"
            )));
        }
        if own[..2] != shape[..2] {
            return Err(PyValueError::new_err(format!(
                "guide must have the rows and columns of color, {:?}; got {:?}",
                &shape[..2],
                &own[..2]
            )));
        }
        read(guide).map_err(|error| of_guide(guide.py(), error))
    }

    /// The channels in `color`, which `input` carries, if it holds such.
    pub fn read(&self, color: &Bound<'py, PyAny>, input: &Input) -> PyResult<Option<Channels>> {
        if !self.any() {
            return Ok(None);
        }
        if input.layers() > 1 {
            return Err(PyValueError::new_err(
                "kinds is for color of one layer: layers are rendered as light",
            ));
        }
        let array = &array("color", color)?;
        let sample_type = sample_type("color", array, false)?;
        let shape = array.shape();
        let (flat, channels) = (shape.len() == 2, shape.get(2).copied().unwrap_or(1));
        let order = Carried::order(&self.read_kinds(channels)?);
        let sizes = Carried::groups_of(input.size, &order);
        let places: Vec<usize> = order.iter().map(|(_, place)| *place).collect();
        let mut planes = with_sample_type!(sample_type, T => view::<T, _>(array, |view| {
            in_order(&view, |samples| separate(samples, channels, &places, &sizes))
        }))??;
        let weighted = installed(|| {
            let planes = planes.iter_mut().flat_map(|group| group.chunks_exact_mut(input.size.pixels()));
            let planes: Vec<_> = planes.collect();
            weigh(planes, &order, input.coverage(), input.size.width)
        })??;
        let groups = sizes.into_iter().zip(planes);
        let groups = groups.chain(weighted.weights.chunks(ChannelGroup::MOST).map(|weights| {
            let weights: Vec<&[f32]> = weights.iter().map(|weights| &weights[..]).collect();
            let size = Size { channels: weights.len(), ..input.size };
            ((size, Weighting::Mean), Buffer::concat(&weights))
        }));
        let groups = groups.map(|((size, weighting), planes)| ChannelGroup {
            size,
            weighting,
            planes: Arc::new(planes),
        });
        let carried = Carried::new(groups.collect(), weighted.channels, weighted.given);
        let format = ColorFormat { sample_type, transfer: Transfer::Linear, alpha: Alpha::None, flat };
        Ok(Some(Channels { carried, format }))
    }

    fn read_kinds(&self, channels: usize) -> PyResult<Vec<ChannelKind>> {
        let Some(given) = self.kinds else { return Ok(vec![ChannelKind::Light; channels]) };
        let kind = |name: &str| choice("kinds", name, &ChannelKind::NAMES);
        let kinds = if let Ok(name) = given.cast::<PyString>() {
            vec![kind(&name.to_cow()?)?; channels]
        } else {
            let names: Vec<String> = given.extract().map_err(|_| {
                PyTypeError::new_err(format!(
                    "kinds must be a kind, or a sequence of one for each channel; got {}",
                    shown(given)
                ))
            })?;
            if names.len() != channels {
                return Err(PyValueError::new_err(format!(
                    "kinds must name one kind, or one for each of {channels} channels; got {}",
                    names.len()
                )));
            }
            names.iter().map(|name| kind(name)).collect::<PyResult<_>>()?
        };
        let runs = kinds.chunk_by(|a, b| a == b);
        let broken = |run: &[ChannelKind]| run[0] == ChannelKind::Normal && !run.len().is_multiple_of(3);
        if let Some(run) = runs.into_iter().find(|run| broken(run)) {
            return Err(PyValueError::new_err(format!(
                "kinds must have \"normal\" for three channels in a row, which are brought to unit length together; got it \
                 for {} in a row",
                run.len()
            )));
        }
        Ok(kinds)
    }
}

/// Separates interleaved samples into the planes of groups of these sizes; `places` has the channel of each plane.
fn separate<T: Sample>(
    samples: &[T],
    channels: usize,
    places: &[usize],
    sizes: &[(Size, Weighting)],
) -> Vec<Buffer<f32>> {
    let Some((Size { width, .. }, _)) = sizes.first().copied() else { return Vec::new() };
    let mut groups: Vec<Buffer<f32>> =
        sizes.iter().map(|(size, _)| Buffer::unset(size.pixels() * size.channels)).collect();
    let pixels = sizes[0].0.pixels();
    let rows = bands(groups.iter_mut().flat_map(|group| group.chunks_exact_mut(pixels)), width);
    rows.into_par_iter().zip(samples.par_chunks(width * channels)).for_each(|(mut rows, samples)| {
        for (row, &place) in rows.iter_mut().zip(places) {
            row.iter_mut()
                .zip(samples.chunks_exact(channels))
                .for_each(|(v, pixel)| *v = pixel[place].to_code());
        }
    });
    groups
}

/// Channels of which data have been multiplied by weights.
struct Weighted {
    channels: Vec<Channel>,
    weights: Vec<Buffer<f32>>,
    /// See [`Carried::new`].
    given: Vec<Vec<(u32, f32)>>,
}

/// Multiplies data by the coverage of their pixel. What is infinite or NaN is of no weight; light must be finite.
fn weigh(
    planes: Vec<&mut [f32]>,
    order: &[(ChannelKind, usize)],
    coverage: Option<&[f32]>,
    width: usize,
) -> PyResult<Weighted> {
    let mut all = Weighted { channels: Vec::new(), weights: Vec::new(), given: Vec::new() };
    let mut of_coverage = None;
    let count = planes.len();
    for (plane, &(kind, place)) in planes.into_iter().zip(order) {
        let infinite = first_infinite(plane);
        if kind < ChannelKind::Data {
            if let Some(i) = infinite {
                let (row, column) = (i / width, i % width);
                return Err(PyValueError::new_err(format!(
                    "color must be finite where it is light or a matte; got {} in channel {place} at row {row}, \
                     column {column}",
                    plane[i]
                )));
            }
            all.channels.push(Channel { kind, place, weight: None });
            continue;
        }
        let whole = |i: usize| coverage.map_or(1.0, |coverage| coverage[i]);
        let weight_of = |i: usize| if plane[i].is_finite() { whole(i) } else { 0.0 };
        let is_covered = |i: usize| coverage.is_none_or(|coverage| coverage[i] > 0.0);
        let is_unknown = |i: usize| !plane[i].is_finite() && is_covered(i);
        let weight = match infinite.filter(|&first| (first..plane.len()).any(is_unknown)) {
            Some(_) => {
                all.weights.push((0..plane.len()).map(weight_of).collect());
                Some(all.weights.len() - 1)
            }
            None => coverage.map(|coverage| {
                *of_coverage.get_or_insert_with(|| {
                    all.weights.push(Buffer::from(coverage));
                    all.weights.len() - 1
                })
            }),
        };
        let mut given = Vec::new();
        if let Some(weight) = weight {
            for (i, (v, &weight)) in plane.iter_mut().zip(&*all.weights[weight]).enumerate() {
                if weight != 1.0 {
                    given.push((i as u32, *v));
                    *v = if weight > 0.0 { *v * weight } else { 0.0 };
                }
            }
        }
        all.channels.push(Channel { kind, place, weight: weight.map(|weight| count + weight) });
        all.given.push(given);
    }
    Ok(all)
}

/// The first value that is infinite or NaN.
fn first_infinite(plane: &[f32]) -> Option<usize> {
    const VALUES: usize = 1 << 14;
    // The greatest magnitude as an integer, which the compiler finds in vectors.
    let is_infinite = |values: &[f32]| {
        values.iter().fold(0, |largest, v| v.abs().to_bits().max(largest)) >= f32::INFINITY.to_bits()
    };
    let part = plane.par_chunks(VALUES).position_first(is_infinite)?;
    plane[part * VALUES..].iter().position(|v| !v.is_finite()).map(|i| part * VALUES + i)
}

/// Refuses lenses and methods that cannot be the same linear map for every channel.
pub fn check(method: &Method, lens: &Lens) -> PyResult<()> {
    if !matches!(method, Method::Lens(_)) {
        return Err(PyValueError::new_err(format!(
            "guide and kinds are for method=\"lens\"; got method={:?}",
            method.name()
        )));
    }
    for (aberration, values) in
        [("axial_color", lens.aberrations.axial_color), ("lateral_color", lens.aberrations.lateral_color)]
    {
        if values != [values[0]; 3] {
            return Err(PyValueError::new_err(format!(
                "lens: {aberration} is of red, green and blue, and channels with guide or kinds have no colour; remove it \
                 with lens.replace({aberration}=(0.0, 0.0, 0.0))"
            )));
        }
    }
    Ok(())
}
