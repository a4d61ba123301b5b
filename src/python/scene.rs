//! `dofsim.Scene`.

use super::aperture::PyAperture;
use super::argument::{self, argument};
use super::carried::{self, ChannelArguments, Channels};
use super::color::ColorFormat;
use super::depth::{DepthArguments, read_depth_arguments, read_depth_kind, read_invalid};
use super::devices::read_device;
use super::errors::DeviceError;
use super::holdout::Holdout;
use super::input::Input;
use super::invalid_color::read_invalid_color;
use super::lens::PyLens;
use super::lens::focus::Focus;
use super::methods::read_method;
use super::output::Output;
use super::output_grid::OutputGrid;
use super::refine::Refining;
use super::run::simd;
use crate::depth::{DepthKind, Invalid, Rays};
use crate::device::Device;
use crate::method::Method;
use crate::optics::{Imaging, Lens, MaxRadius};
use crate::picture::Size;
use crate::renderer::{PassTime, Renderer};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, PoisonError};

/// A picture with depth, prepared once and rendered through many lenses.
///
/// Parameters
/// ----------
/// color, depth
///     As in `render`.
/// holdout, guide, kinds, device, depth_kind, near, far, depth_range, invalid, invalid_color
///     As in `render`.
/// alpha, transfer, overscan, supersample, refine
///     As in `render`.
///
/// Raises
/// ------
/// ValueError, TypeError, DeviceError
///     As in `render`.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> scene = dofsim.Scene(np.ones((32, 48, 3), np.float32), np.full((32, 48), 2.0))
/// >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=3.0, fov=42.0)
/// >>> scene.focal_stack(lens, [1.0, 2.0, 4.0]).shape
/// (3, 32, 48, 3)
#[pyclass(name = "Scene", module = "dofsim", frozen)]
pub struct PyScene {
    input: Input,
    /// The channels in `color` that a guide leads, if it holds such; `input` has the guide.
    channels: Option<Channels>,
    grid: OutputGrid,
    device: Device,
    /// The device as it was given.
    device_name: String,
    kind: DepthKind,
    depth_arguments: (String, Option<f64>, Option<f64>, Option<[f64; 2]>),
    invalid: Invalid,
    /// The picture with disparity on its device, and the rays with which it was converted, if the conversion needs
    /// them.
    renderer: Mutex<Option<(Option<Rays>, Arc<Renderer>)>>,
}

impl PyScene {
    /// The renderer of the picture, with the disparity that this lens needs.
    fn renderer(&self, lens: &Lens) -> PyResult<Arc<Renderer>> {
        let (ref depth_kind, near, far, depth_range) = self.depth_arguments;
        read_depth_kind(&DepthArguments { depth_kind, near, far, depth_range }, lens)?;
        let size = self.input.size;
        let rays = self.grid.geometry(size).rays(lens).filter(|_| self.kind.needs_rays());
        // As with the layers of a scene, the lock is not held over parallel work.
        let cached = || self.renderer.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand =
            cached().as_ref().filter(|(made_with, _)| *made_with == rays).map(|(_, s)| Arc::clone(s));
        if let Some(renderer) = at_hand {
            return Ok(renderer);
        }
        let picture = self.input.picture(self.kind, rays, self.invalid)?;
        let carried = self.channels.as_ref().map(|channels| channels.carried.clone());
        let lights = self.input.format.lights(size);
        let renderer = Arc::new(Renderer::new(picture, lights, carried, self.grid.supersample));
        *cached() = Some((rays, Arc::clone(&renderer)));
        Ok(renderer)
    }

    /// The device for these lenses: the CPU for those whose rays a GPU does not trace, for which "auto" stands here.
    fn device_for(&self, lenses: &[Lens]) -> PyResult<Device> {
        let name = lenses.iter().find_map(|lens| lens.aberrations.transverse());
        match (name, self.device, &*self.device_name) {
            (None, device, _) | (Some(_), device @ Device::Cpu, _) => Ok(device),
            (Some(_), _, "auto") => Ok(Device::Cpu),
            (Some(name), _, device) => Err(PyValueError::new_err(format!(
                "device must be \"cpu\" or \"auto\" for a lens with {name}, which is not rendered on a GPU; got {device:?}"
            ))),
        }
    }

    /// The format and the size of what is given and rendered, and the factor by which that is brighter.
    fn output(&self) -> (&ColorFormat, Size, f32) {
        match &self.channels {
            None => (&self.input.format, self.input.size, self.input.brighter),
            Some(Channels { carried, format }) => {
                (format, Size { channels: carried.outputs(), ..self.input.size }, 1.0)
            }
        }
    }

    /// Renders the scene through lenses that differ only in their focus, and returns an array and the GPU passes. The
    /// pictures have an axis of their own if `stacked` gives their number.
    fn rendered<'py>(
        &self,
        py: Python<'py>,
        lenses: &[Lens],
        stacked: Option<usize>,
        (method, max_radius): &(Method, Option<MaxRadius>),
        threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Vec<PassTime>)> {
        let size = self.input.size;
        for lens in lenses {
            if self.channels.is_some() {
                carried::check(method, lens)?;
            }
            if self.input.holdout.is_some() {
                Holdout::check(method)?;
            }
            method.check(lens, self.input.layers(), self.input.format.lights(size))?;
        }
        let geometry = self.grid.geometry(size);
        let imaging = |lens| Ok(Imaging { max_radius: *max_radius, ..geometry.imaging(lens)? });
        let imagings: Vec<Imaging> = lenses.iter().map(imaging).collect::<crate::error::Result<_>>()?;
        let renderer = self.renderer(&lenses[0])?;
        let (simd, device) = (simd()?, self.device_for(lenses)?);
        let (format, size, brighter) = self.output();
        let output = Output {
            format,
            rendered: self.grid.resolved(size),
            brighter,
            margin: self.grid.overscan,
            stacked,
        };
        output.fill(py, out, threads, |outs, cancel| {
            renderer.render_each(&imagings, method, device, simd, cancel, outs)
        })
    }

    /// Renders the scene through one lens.
    pub fn picture<'py>(
        &self,
        py: Python<'py>,
        lens: &Lens,
        method: &(Method, Option<MaxRadius>),
        threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        Ok(self.rendered(py, std::slice::from_ref(lens), None, method, threads, out)?.0)
    }

    /// The renderer of the picture, and how a lens images it, for a method that can render it so.
    pub fn exposed(
        &self,
        lens: &Lens,
        (method, max_radius): &(Method, Option<MaxRadius>),
    ) -> PyResult<(Arc<Renderer>, Imaging, Size)> {
        let size = self.input.size;
        method.check(lens, self.input.layers(), self.input.format.lights(size))?;
        let imaging = Imaging { max_radius: *max_radius, ..self.grid.geometry(size).imaging(lens)? };
        Ok((self.renderer(lens)?, imaging, size))
    }
}

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (color, depth, *, holdout=None, guide=None, kinds=None, device="auto", depth_kind="z", near=None,
        far=None, depth_range=None, invalid="raise", invalid_color="raise", alpha=None, transfer=None, overscan=0, supersample=1, refine=false))]
    #[expect(clippy::too_many_arguments, reason = "the public constructor's own, keyword-only in Python")]
    pub fn new<'py>(
        color: &Bound<'py, PyAny>,
        depth: &Bound<'py, PyAny>,
        holdout: Option<&Bound<'py, PyAny>>,
        guide: Option<&Bound<'py, PyAny>>,
        kinds: Option<&Bound<'py, PyAny>>,
        device: &str,
        depth_kind: &str,
        #[pyo3(from_py_with = argument::near)] near: Option<f64>,
        #[pyo3(from_py_with = argument::far)] far: Option<f64>,
        #[pyo3(from_py_with = argument::depth_range)] depth_range: Option<[f64; 2]>,
        invalid: &str,
        invalid_color: &str,
        alpha: Option<&str>,
        transfer: Option<&str>,
        #[pyo3(from_py_with = argument::overscan)] overscan: usize,
        #[pyo3(from_py_with = argument::supersample)] supersample: usize,
        refine: bool,
    ) -> PyResult<PyScene> {
        let channels = ChannelArguments { guide, kinds };
        let device_name = device.to_owned();
        let device = read_device(color.py(), device)?;
        let kind = read_depth_arguments(&DepthArguments { depth_kind, near, far, depth_range })?;
        let invalid = read_invalid(invalid)?;
        let refining = refine.then_some(Refining { kind, invalid, threads: None });
        let invalid_color = read_invalid_color(invalid_color)?;
        let read = |color: &Bound<'py, PyAny>| {
            Input::read(color, (depth, kind), alpha, transfer, invalid_color, refining)
        };
        let mut input = channels.picture(color, read)?;
        input.holdout = holdout.map(|given| Holdout::read(given, input.size)).transpose()?;
        let channels = channels.read(color, &input)?;
        let grid = OutputGrid::new(input.size, overscan, supersample)?;
        let depth_arguments = (depth_kind.to_owned(), near, far, depth_range);
        Ok(PyScene {
            input,
            channels,
            grid,
            device,
            device_name,
            kind,
            depth_arguments,
            invalid,
            renderer: Mutex::new(None),
        })
    }

    /// Number of pixels whose colour was NaN or infinite and was filled, as ``invalid_color="fill"`` asks for.
    #[getter]
    fn filled_pixels(&self) -> usize {
        self.input.filled_pixels
    }

    /// The depth that is rendered, as it was given or refined: float32, of the shape that the picture has without channels.
    #[getter]
    pub fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let Size { height, width, .. } = self.input.size;
        let planes = self.input.depth();
        let values = PyArray1::from_vec(py, planes.concat());
        Ok(match planes.len() {
            1 => values.reshape([height, width])?.into_any(),
            layers => values.reshape([layers, height, width])?.into_any(),
        })
    }

    /// The picture of the scene through a lens.
    ///
    /// What does not depend on the focus is prepared once. `in_focus`, and `max_coc_px` where it bounds something, change
    /// the depths: what is prepared then serves the next lens with the same focus and the same bound.
    ///
    /// Parameters
    /// ----------
    /// lens : Lens
    ///     The lens.
    /// method, aperture, in_focus, max_coc_px, threads, out, **options
    ///     As in the function `render`.
    ///
    /// Returns
    /// -------
    /// ndarray
    ///     As the function `render` returns it.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     If an argument cannot be used.
    #[pyo3(signature = (lens, *, method="lens", aperture=None, in_focus=None, max_coc_px=None, threads=None, out=None,
        **options))]
    #[expect(clippy::too_many_arguments, reason = "the public method's own, keyword-only in Python")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        lens: &PyLens,
        method: &str,
        aperture: Option<&PyAperture>,
        #[pyo3(from_py_with = argument::in_focus)] in_focus: Option<[f64; 2]>,
        #[pyo3(from_py_with = argument::max_coc_px)] max_coc_px: Option<f64>,
        #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let method = read_method(method, aperture, max_coc_px, options)?;
        self.picture(py, &lens.with_range(in_focus)?, &method, threads, out)
    }

    /// The pictures of the scene through one lens focused at many distances.
    ///
    /// What does not depend on the focus is prepared once.
    ///
    /// Parameters
    /// ----------
    /// lens : Lens
    ///     The lens; its own focus does not matter.
    /// distances : sequence of float
    ///     Distances in focus in metres (disparities for a lens made by `Lens.from_disparity`); a pair is a range in focus,
    ///     as `in_focus` of `Lens`.
    /// method, aperture, max_coc_px, threads, out, **options
    ///     As in the function `render`.
    ///
    /// Returns
    /// -------
    /// ndarray
    ///     One picture a distance, shape (N, H, W, C) or (N, H, W).
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     If an argument cannot be used.
    #[pyo3(signature = (lens, distances, *, method="lens", aperture=None, max_coc_px=None, threads=None, out=None,
        **options))]
    #[expect(clippy::too_many_arguments, reason = "the public method's own, keyword-only in Python")]
    fn focal_stack<'py>(
        &self,
        py: Python<'py>,
        lens: &PyLens,
        distances: &Bound<'py, PyAny>,
        method: &str,
        aperture: Option<&PyAperture>,
        #[pyo3(from_py_with = argument::max_coc_px)] max_coc_px: Option<f64>,
        #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let method = read_method(method, aperture, max_coc_px, options)?;
        let distances: Vec<Focus> = distances
            .try_iter()
            .map_err(|_| PyTypeError::new_err("distances must be a sequence of numbers"))?
            .map(|distance| argument("each of distances", &distance?))
            .collect::<PyResult<_>>()?;
        if distances.is_empty() {
            return Err(PyValueError::new_err("distances must hold at least one distance"));
        }
        let focused = distances.iter().map(|focus| focus.of(&lens.core));
        let lenses = focused.collect::<crate::error::Result<Vec<_>>>()?;
        Ok(self.rendered(py, &lenses, Some(lenses.len()), &method, threads, out)?.0)
    }

    /// The time of each pass of a render on the GPU, in milliseconds.
    ///
    /// Parameters
    /// ----------
    /// lens, method, aperture, in_focus, max_coc_px, threads, **options
    ///     As in the function `render`.
    ///
    /// Returns
    /// -------
    /// list of tuple of str and float
    ///     Each pass, by the name of its shader, and its time on the device in milliseconds; in the order of their
    ///     beginning, passes of one name together.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     If an argument cannot be used.
    /// DeviceError
    ///     If the render is done on the CPU, or the GPU keeps no time.
    #[pyo3(signature = (lens, *, method="lens", aperture=None, in_focus=None, max_coc_px=None, threads=None,
        **options))]
    #[expect(clippy::too_many_arguments, reason = "the public method's own, keyword-only in Python")]
    fn profile(
        &self,
        py: Python<'_>,
        lens: &PyLens,
        method: &str,
        aperture: Option<&PyAperture>,
        #[pyo3(from_py_with = argument::in_focus)] in_focus: Option<[f64; 2]>,
        #[pyo3(from_py_with = argument::max_coc_px)] max_coc_px: Option<f64>,
        #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Vec<(&'static str, f64)>> {
        let method = read_method(method, aperture, max_coc_px, options)?;
        let lens = lens.with_range(in_focus)?;
        let (_, passes) = self.rendered(py, &[lens], None, &method, threads, None)?;
        let mut times: Vec<(&'static str, f64)> = Vec::new();
        for pass in passes {
            let ms = 1e3 * pass.seconds;
            match times.iter_mut().find(|(name, _)| *name == pass.name) {
                Some((_, total)) => *total += ms,
                None => times.push((pass.name, ms)),
            }
        }
        if times.is_empty() {
            return Err(DeviceError::new_err(
                "profile: there are no times to show, because the render is done on the CPU or the GPU keeps none",
            ));
        }
        Ok(times)
    }

    fn __repr__(&self) -> String {
        let Size { width, height, channels } = self.output().1;
        format!("<dofsim.Scene of {width} x {height} pixels, {channels} channels>")
    }
}
