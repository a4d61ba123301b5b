//! Channels that go through a lens as a guide finds the way: read and checked.

use super::color::{Alpha, ColorFormat};
use super::errors::{choice, reworded, shown};
use super::input::Input;
use super::run::installed;
use super::samples::{array, in_order, sample_type, view, with_sample_type};
use crate::carried::{Carried, Channel, ChannelKind};
use crate::color::{Sample, Transfer};
use crate::memory::Buffer;
use crate::method::Method;
use crate::optics::Lens;
use crate::picture::{ChannelGroup, Size, Weighting};
use crate::rows::bands;
use numpy::PyUntypedArrayMethods;
use numpy::ndarray::Axis;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;
use rayon::prelude::*;
use std::borrow::Cow;
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
        let (axes, of_color, same) = match own.len() {
            2 | 3 => (2, "(H, W) or (H, W, C)", "rows and columns"),
            4 => (3, "(L, H, W) or (L, H, W, C)", "layers, rows and columns"),
            _ => {
                return Err(PyValueError::new_err(format!(
                    "guide must have shape (H, W) or (H, W, C) with 1 to 4 channels, or (L, H, W, 4) for layers; got {own:?}"
                )));
            }
        };
        if !(axes..=axes + 1).contains(&shape.len()) || shape.contains(&0) {
            return Err(PyValueError::new_err(format!(
                "color must have shape {of_color} with guide of shape {own:?}; got {shape:?}"
            )));
        }
        if own[..axes] != shape[..axes] {
            return Err(PyValueError::new_err(format!(
                "guide must have the {same} of color, {:?}; got {:?}",
                &shape[..axes],
                &own[..axes]
            )));
        }
        read(guide).map_err(|error| of_guide(guide.py(), error))
    }

    /// The channels in `color`, which `input` carries, if it holds such.
    pub fn read(&self, color: &Bound<'py, PyAny>, input: &Input) -> PyResult<Option<Channels>> {
        if !self.any() {
            return Ok(None);
        }
        let array = &array("color", color)?;
        let sample_type = sample_type("color", array, false)?;
        // The guide says whether the first axis is that of layers.
        let layered = array.ndim() > 3 || (array.ndim() == 3 && self.is_layered()?);
        let shape = &array.shape()[usize::from(layered)..];
        let (flat, channels) = (shape.len() == 2, shape.get(2).copied().unwrap_or(1));
        let order = Carried::order(&self.read_kinds(channels)?);
        let sizes = Carried::groups_of(input.size, &order);
        let places: Vec<usize> = order.iter().map(|(_, place)| *place).collect();
        let mut layers = with_sample_type!(sample_type, T => view::<T, _>(array, |view| {
            let layer = |i: usize| if layered { view.index_axis(Axis(0), i) } else { view.view() };
            let separated = |samples: &[T]| separate(samples, channels, &places, &sizes);
            (0..input.layers()).map(|i| in_order(&layer(i), separated)).collect::<PyResult<Vec<_>>>()
        }))??;
        let weighted = installed(|| {
            let pixels = input.size.pixels();
            let planes = layers
                .iter_mut()
                .map(|groups| groups.iter_mut().flat_map(|g| g.chunks_exact_mut(pixels)).collect());
            weigh(planes.collect(), &order, &input.seen(), input.size.width)
        })??;
        let mut of_layers: Vec<_> = layers.into_iter().map(Vec::into_iter).collect();
        let groups = sizes.into_iter().map(|(size, weighting)| ChannelGroup {
            size,
            weighting,
            layers: of_layers.iter_mut().filter_map(Iterator::next).map(Arc::new).collect(),
        });
        let groups = groups.chain(weighted.weights.chunks(ChannelGroup::MOST).map(|weights| {
            let of_layer = |layer: usize| {
                let weights: Vec<&[f32]> = weights.iter().map(|of_layers| &of_layers[layer][..]).collect();
                Arc::new(Buffer::concat(&weights))
            };
            ChannelGroup {
                size: Size { channels: weights.len(), ..input.size },
                weighting: Weighting::Mean,
                layers: (0..input.layers()).map(of_layer).collect(),
            }
        }));
        let carried = Carried::new(groups.collect(), weighted.channels, weighted.given);
        let format = ColorFormat { sample_type, transfer: Transfer::Linear, alpha: Alpha::None, flat };
        Ok(Some(Channels { carried, format }))
    }

    /// Whether the guide has layers.
    fn is_layered(&self) -> PyResult<bool> {
        Ok(match self.guide {
            Some(guide) => array("guide", guide)?.ndim() == 4,
            None => false,
        })
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
    /// For each weight, a plane of each layer.
    weights: Vec<Vec<Buffer<f32>>>,
    /// See [`Carried::new`].
    given: Vec<Vec<(u32, f32)>>,
}

/// Multiplies data by how much is [seen](Input::seen) of their pixel. What is infinite or NaN is of no weight; light must be
/// finite. `layers` has the planes of each layer, in this order.
fn weigh(
    mut layers: Vec<Vec<&mut [f32]>>,
    order: &[(ChannelKind, usize)],
    seen: &[Cow<[f32]>],
    width: usize,
) -> PyResult<Weighted> {
    let mut all = Weighted { channels: Vec::new(), weights: Vec::new(), given: Vec::new() };
    let mut of_seen = None;
    let whole = |layer: usize, i: usize| seen.get(layer).map_or(1.0, |seen| seen[i]);
    for (c, &(kind, place)) in order.iter().enumerate() {
        let planes: Vec<&[f32]> = layers.iter().map(|planes| &*planes[c]).collect();
        let mut infinite =
            planes.iter().enumerate().filter_map(|(l, plane)| Some((l, first_infinite(plane)?)));
        if kind < ChannelKind::Data {
            if let Some((layer, i)) = infinite.next() {
                let (row, column) = (i / width, i % width);
                let of_layer = if planes.len() > 1 { format!(" of layer {layer}") } else { String::new() };
                return Err(PyValueError::new_err(format!(
                    "color must be finite where it is light or a matte; got {} in channel {place} at row {row}, \
                     column {column}{of_layer}",
                    planes[layer][i]
                )));
            }
            all.channels.push(Channel { kind, place, weight: None });
            continue;
        }
        let is_unknown = |l: usize, i: usize| !planes[l][i].is_finite() && whole(l, i) > 0.0;
        let weight = if infinite.any(|(l, first)| (first..planes[l].len()).any(|i| is_unknown(l, i))) {
            let weight_of = |l: usize, i: usize| if planes[l][i].is_finite() { whole(l, i) } else { 0.0 };
            let of_layer = |l: usize| (0..planes[l].len()).map(|i| weight_of(l, i)).collect();
            all.weights.push((0..planes.len()).map(of_layer).collect());
            Some(all.weights.len() - 1)
        } else if seen.is_empty() {
            None
        } else {
            Some(*of_seen.get_or_insert_with(|| {
                all.weights.push(seen.iter().map(|seen| Buffer::from(&seen[..])).collect());
                all.weights.len() - 1
            }))
        };
        let mut given = Vec::new();
        if let Some(weight) = weight {
            for (planes, weights) in layers.iter_mut().zip(&all.weights[weight]) {
                for (i, (v, &weight)) in planes[c].iter_mut().zip(&**weights).enumerate() {
                    if weight != 1.0 {
                        given.push((i as u32, *v));
                        *v = if weight > 0.0 { *v * weight } else { 0.0 };
                    }
                }
            }
        }
        all.channels.push(Channel { kind, place, weight: weight.map(|weight| order.len() + weight) });
        // What is seen of several layers is none of them.
        all.given.push(if layers.len() == 1 { given } else { Vec::new() });
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
