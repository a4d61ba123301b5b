//! `dofsim.render`, `dofsim.coc` and `dofsim.Scene`.

use super::aperture::PyAperture;
use super::arrays::{
    ColorFormat, DepthWords, Input, read_depth, read_depth_kind, read_depth_words, read_invalid,
};
use super::devices::read_device;
use super::errors::DeviceError;
use super::lens::PyLens;
use super::methods::read_method;
use super::output::Output;
use super::run::{installed, simd};
use crate::depth::{DepthKind, Invalid, Rays, disparity_plane};
use crate::device::Device;
use crate::method::Method;
use crate::optics::{self, Base, Imaging, Lens};
use crate::picture::Size;
use crate::renderer::{PassTime, Renderer};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, PoisonError};

/// How the picture relates to the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Frame {
    /// Pixels of margin on every side, not in the output.
    overscan: usize,
    /// Pixels of the picture to one of the output, along each axis.
    supersample: usize,
}

impl Frame {
    fn new(size: Size, overscan: usize, supersample: usize) -> PyResult<Frame> {
        if !(1..=16).contains(&supersample) {
            return Err(PyValueError::new_err(format!(
                "supersample must be from 1 to 16; got {supersample}"
            )));
        }
        if !size.width.is_multiple_of(supersample) || !size.height.is_multiple_of(supersample) {
            return Err(PyValueError::new_err(format!(
                "supersample={supersample} must divide the rows and columns of color; got {} and {}",
                size.height, size.width
            )));
        }
        let smaller = size.width.min(size.height) / supersample;
        if 2 * overscan >= smaller {
            return Err(PyValueError::new_err(format!(
                "overscan must leave a picture: twice {overscan} is not less than {smaller} pixels"
            )));
        }
        Ok(Frame { overscan, supersample })
    }

    /// Size of the output with its margin.
    fn resolved(&self, size: Size) -> Size {
        Size { width: size.width / self.supersample, height: size.height / self.supersample, ..size }
    }

    /// The picture as the lens has it: the field of view spans the output, whose pixels the picture divides.
    fn geometry(&self, size: Size) -> optics::Frame {
        let Size { width, height, .. } = self.resolved(size);
        let (width, height) = (width - 2 * self.overscan, height - 2 * self.overscan);
        optics::Frame { width, height, finer: self.supersample, margin: self.overscan }
    }
}

/// The picture that a real lens would have taken.
///
/// Parameters
/// ----------
/// color : ndarray
///     The pinhole picture, shape (H, W) or (H, W, C) with 1 to 4 channels, or (L, H, W, 4) for layers from
///     front to back. float16, float32 or float64 in linear light, or uint8 or uint16 with `transfer`.
/// depth : ndarray
///     What each pixel sees, shape (H, W), or (L, H, W) for layers. float16, float32 or float64; metres unless
///     `depth_kind` says otherwise. Infinity is background.
/// lens : Lens
///     The lens.
/// method : {"lens", "poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"}, optional
///     How to compute; see the notes. All but ``"lens"`` take one layer and are for speed or for their own looks.
/// device : str, optional
///     Where to compute: ``"cpu"``, ``"gpu"``, one of `devices` by its ``id`` or its name, or ``"auto"`` (default): a
///     GPU if there is one, else the CPU. A software rasteriser is used only if it is named. The environment variable
///     ``DOFSIM_DEVICE`` says what ``"auto"`` and ``"gpu"`` stand for.
/// aperture : Aperture, optional
///     Shape of the opening; a disc if not given. Methods that cannot draw another shape refuse it.
/// depth_kind : str, optional
///     ``"z"`` (planar, metres, default), ``"distance"`` (from the pinhole along the ray, metres),
///     ``"inverse_z"`` (1/m), ``"disparity"`` (relative; needs `Lens.from_disparity`), ``"relative"`` (the same of any
///     scale, brought to 0 (far) to 1 (near) robustly first: those are its 1st and 99th percentile),
///     ``"zbuffer"`` (0 to 1 between `near` and `far`) or ``"distance_from_near"`` (Mitsuba's depth AOV: along the
///     ray from the near plane, 0 where nothing is hit).
/// near, far : float, optional
///     Clip planes in metres, for the kinds that need them.
/// invalid : {"raise", "far"}, optional
///     What to do with depth that is none (NaN, negative, zero).
/// alpha : {"premultiplied", "straight", "none"}, optional
///     What the last of 4 (or 2) channels is; premultiplied coverage is the default for 4.
/// transfer : {"linear", "srgb"}, optional
///     How samples stand for light. Must be given for integers; floats are linear unless told otherwise.
/// overscan : int, optional
///     Pixels of margin that the picture has on every side beyond the output (in output pixels). The field of
///     view is that of the output.
/// supersample : int, optional
///     The picture is this many times larger than the output along each axis, sampled at its pixels' centres.
/// threads : int, optional
///     Worker threads; one per processor by default. The result does not depend on it.
/// out : ndarray, optional
///     A C-contiguous array of the result's shape and dtype to render into, which may be `color` itself. What it holds
///     after an error is undefined.
/// **options
///     Options of the method; see the notes.
///
/// Returns
/// -------
/// ndarray
///     The picture, in the dtype and format of `color`; (H, W, 4) for layers.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted.
/// DeviceError
///     If the device cannot be used.
///
/// Notes
/// -----
/// What lies beyond the border of the picture is taken for its mirror image. The methods and their options:
///
/// ``"lens"`` integrates over the lens with visibility for every lens point. With a fixed number of views it is what
/// an accumulation buffer and distributed ray tracing compute, the references of real-time methods.
///
/// - ``views``, int: lens points used wherever visibility matters, 16 to 16384. By default 64 to 512, chosen for
///   each tile from the largest circle of confusion that reaches it.
///
/// ``"poisson"`` averages over taps scattered over each pixel's own circle of confusion; after the first half of
/// Riguer, Tatarchuk and Isidoro, "Real-Time Depth of Field Simulation", ShaderX2. It takes apertures of any shape.
///
/// - ``taps``, int or array: number of taps beside the pixel itself, 1 to 128, by default the article's own 12; or
///   their places, shape (N, 2) or (N, 3): columns to the right and rows down in units of the circle's radius,
///   and weights, where the pixel's own is 1. The pattern is turned by 180 degrees behind the focus plane.
/// - ``bokeh``, "uniform" (default), "ring", "gaussian" or "inverse": where light falls within a blurred point:
///   evenly, on the rim alone, more in the middle, or more towards the rim.
/// - ``max_coc_px``, float: the radius that circles of confusion are limited to, by default 5 pixels. Twelve taps do
///   not fill a larger one.
/// - ``leak_test``, "on" (default) or "off": whether taps in front of a pixel count by their own blurriness, so that
///   what is sharp does not leak onto what is blurred behind it.
///
/// ``"gaussian"`` lays a half-size copy, blurred by 25 x 25 of its pixels, over the picture by blurriness, 0 to 1; after
/// the second half of the same article. What is sharp does not spread. Its tables weigh the middle row and column of
/// the blur more than their neighbours, which shows as a cross where a very bright point is.
///
/// - ``max_coc_px``, float: the radius of the circle of confusion from which on blurriness is 1, by default the 24
///   pixels of a disc that spreads light as far as the blur does.
/// - ``focal_range``, float: instead, the distance in metres from the focus plane from which on it is 1.
///
/// ``"taps"`` makes a few look-ups at fixed places up to two pixels away, each mixed with the centre by the product
/// of both blur factors; after the "DepthOfField Sample" of Microsoft's DirectX SDK. A blur factor is a square, at
/// most 0.75.
///
/// - ``variant``, "thirteen" (default), "seven", "six", "four" or "four_rings": the number of look-ups, the centre
///   among them. ``"four_rings"`` mixes by the centre's factor alone, which draws a ring around what is sharp.
/// - ``hyperfocal_factor``, float: what the blur factor is the square of, per metre of distance from the focus
///   plane. By default it is the radius of the circle of confusion over the distance of the farthest look-up.
///
/// ``"hexagonal"`` blurs along the sides of three rhombi that make a hexagon; after the article "A depth of field
/// implementation" (2013) and the game "Need for Speed: The Run". What is in front of the focus spreads over
/// everything, what is behind it only over what has at least half its circle of confusion. `aperture` may have 4 or 6
/// blades; without it, the hexagon has a corner straight up. The article's circle of confusion on a z-buffer,
/// ``z * CoCScale + CoCBias``, is ``depth_kind="zbuffer"`` with `near` and `far` and a lens of `Lens.from_camera`.
///
/// - ``max_coc_px``, float: circles of confusion are cut at this radius, 1 to 256; 64 by default. Time grows with the
///   largest radius there is.
///
/// ``"levels"`` interpolates between the picture and two of five blurs in a row; after "Depth of Field: Controlling
/// Camera Parameters" (NVIDIA, 2004). It knows nothing of edges: what is sharp leaks into what is blurred.
///
/// - ``c0_px``, float: the diameter up to which the picture stays sharp, 0.5 to 1024; at twice that the blur is
///   strongest, and as wide as that circle of confusion. (Of the paper's two readings of 0.5, it is the diameter of 1.5
///   ``c0_px`` here.) By default half of the largest diameter in the frame.
///
/// ``"sprites"`` draws every blurred pixel as a picture of the opening, in layers in front and behind at half the size;
/// after "Geometry-Shader-Free Bokeh Depth of Field Rendering" (2012). Any `aperture`, or any picture. Time grows with
/// the number of blurred pixels and the area of their circles of confusion.
///
/// - ``sprite``, array of shape (N, M): transmission over the square around the circle of confusion, in place of
///   `aperture`; turned by 180 degrees in front of the focus.
/// - ``coc_threshold_px``, float: the radius above which a pixel is drawn, at least 0.5; 1 by default. Pixels set in
///   between it and twice that.
/// - ``max_coc_px``, float: circles of confusion are cut at this radius, 1 to 256; 64 by default.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> color = np.random.default_rng(0).random((48, 64, 3), dtype=np.float32)
/// >>> depth = np.full((48, 64), 4.0)
/// >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=42.0)
/// >>> dofsim.render(color, depth, lens).shape
/// (48, 64, 3)
#[pyfunction]
#[pyo3(signature = (color, depth, lens, *, method="lens", device="auto", aperture=None, depth_kind="z", near=None,
    far=None, invalid="raise", alpha=None, transfer=None, overscan=0, supersample=1, threads=None, out=None,
    **options))]
#[expect(clippy::too_many_arguments, reason = "the public function's own, keyword-only in Python")]
pub fn render<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    depth: &Bound<'py, PyAny>,
    lens: &PyLens,
    method: &str,
    device: &str,
    aperture: Option<&PyAperture>,
    depth_kind: &str,
    near: Option<f64>,
    far: Option<f64>,
    invalid: &str,
    alpha: Option<&str>,
    transfer: Option<&str>,
    overscan: usize,
    supersample: usize,
    threads: Option<usize>,
    out: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let method = read_method(method, aperture, options)?;
    let scene = PyScene::new(
        color,
        depth,
        device,
        depth_kind,
        near,
        far,
        invalid,
        alpha,
        transfer,
        overscan,
        supersample,
    )?;
    scene.picture(py, &lens.core, &method, threads, out)
}

/// Signed radius of the circle of confusion in pixels.
///
/// Parameters
/// ----------
/// depth : ndarray
///     Shape (H, W), or (L, H, W) for layers; float16, float32 or float64.
/// lens : Lens
///     The lens.
/// depth_kind, near, far, invalid
///     As in `render`.
///
/// Returns
/// -------
/// ndarray
///     float32, the shape of `depth`. Positive behind the focus, negative in front of it; without axial colour.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> import numpy as np
/// >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=90.0)
/// >>> dofsim.coc(np.array([[1.0, 2.0, np.inf, 4.0]]), lens)
/// array([[-0.1 ,  0.  ,  0.1 ,  0.05]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (depth, lens, *, depth_kind="z", near=None, far=None, invalid="raise"))]
pub fn coc<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    lens: &PyLens,
    depth_kind: &str,
    near: Option<f64>,
    far: Option<f64>,
    invalid: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let kind = read_depth_kind(&DepthWords { depth_kind, near, far }, &lens.core)?;
    let invalid = read_invalid(invalid)?;
    let planes = read_depth(depth)?;
    let size = (planes.width, planes.height);
    let frame = optics::Frame::plain(size.0, size.1);
    let (imaging, rays) = (frame.imaging(&lens.core)?, frame.rays(&lens.core));
    let mut radius = Vec::with_capacity(size.0 * size.1 * planes.planes.len());
    for plane in &planes.planes {
        let disparity = installed(|| disparity_plane(plane, size.0, kind, rays, invalid))??;
        // Adding zero turns the negative zero of the focus plane into a plain one.
        radius.extend(disparity.iter().enumerate().map(|(i, &d)| {
            let offset = imaging.surface.offset((i % size.0) as f64, (i / size.0) as f64);
            (0.0 - imaging.optics.shift_px(f64::from(d) - offset)) as f32 + 0.0
        }));
    }
    let shape: Vec<usize> = depth.getattr("shape")?.extract()?;
    Ok(PyArray1::from_vec(py, radius).reshape(shape)?.into_any())
}

/// A picture with depth, prepared once and rendered through many lenses.
///
/// Parameters
/// ----------
/// color, depth
///     As in `render`.
/// device, depth_kind, near, far, invalid, alpha, transfer, overscan, supersample
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
    frame: Frame,
    device: Device,
    kind: DepthKind,
    depth_words: (String, Option<f64>, Option<f64>),
    invalid: Invalid,
    /// The scene in disparity, with the rays that it was converted with, where they matter.
    scene: Mutex<Option<(Option<Rays>, Arc<Renderer>)>>,
}

impl PyScene {
    /// The scene in disparity, as this lens needs it.
    fn scene(&self, lens: &Lens) -> PyResult<Arc<Renderer>> {
        let (depth_kind, near, far) = (self.depth_words.0.as_str(), self.depth_words.1, self.depth_words.2);
        read_depth_kind(&DepthWords { depth_kind, near, far }, lens)?;
        let size = self.input.size;
        let rays = self.frame.geometry(size).rays(lens).filter(|_| self.kind.needs_rays());
        // As for the sheets of a scene, the lock is not held over parallel work.
        let cached = || self.scene.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand =
            cached().as_ref().filter(|(made_with, _)| *made_with == rays).map(|(_, s)| Arc::clone(s));
        if let Some(scene) = at_hand {
            return Ok(scene);
        }
        let picture = self.input.picture(self.kind, rays, self.invalid)?;
        let scene = Arc::new(Renderer::new(picture, self.format().lights(size), self.frame.supersample));
        *cached() = Some((rays, Arc::clone(&scene)));
        Ok(scene)
    }

    fn format(&self) -> &ColorFormat {
        &self.input.format
    }

    /// The scene through lenses that differ in their focus alone, as an array, and the passes that made it. The
    /// pictures have an axis of their own if `stacked` says how many there are.
    fn rendered<'py>(
        &self,
        py: Python<'py>,
        lenses: &[Lens],
        stacked: Option<usize>,
        method: &Method,
        threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Vec<PassTime>)> {
        let size = self.input.size;
        for lens in lenses.iter().take(1) {
            method.check(lens, self.input.layers(), self.format().lights(size))?;
        }
        let geometry = self.frame.geometry(size);
        let imagings: Vec<Imaging> =
            lenses.iter().map(|lens| geometry.imaging(lens)).collect::<crate::error::Result<_>>()?;
        let scene = self.scene(&lenses[0])?;
        let (simd, device) = (simd()?, self.device);
        let rendered = self.frame.resolved(size);
        let output = Output {
            format: self.format(),
            rendered,
            brighter: self.input.brighter,
            margin: self.frame.overscan,
            stacked,
        };
        output.fill(py, out, threads, |outs, cancel| {
            scene.render_each(&imagings, method, device, simd, cancel, outs)
        })
    }

    /// The scene through one lens.
    fn picture<'py>(
        &self,
        py: Python<'py>,
        lens: &Lens,
        method: &Method,
        threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        Ok(self.rendered(py, std::slice::from_ref(lens), None, method, threads, out)?.0)
    }
}

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (color, depth, *, device="auto", depth_kind="z", near=None, far=None, invalid="raise",
        alpha=None, transfer=None, overscan=0, supersample=1))]
    #[expect(clippy::too_many_arguments, reason = "the public constructor's own, keyword-only in Python")]
    fn new(
        color: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        device: &str,
        depth_kind: &str,
        near: Option<f64>,
        far: Option<f64>,
        invalid: &str,
        alpha: Option<&str>,
        transfer: Option<&str>,
        overscan: usize,
        supersample: usize,
    ) -> PyResult<PyScene> {
        let device = read_device(color.py(), device)?;
        let kind = read_depth_words(&DepthWords { depth_kind, near, far })?;
        let invalid = read_invalid(invalid)?;
        let input = Input::read(color, depth, alpha, transfer)?;
        let frame = Frame::new(input.size, overscan, supersample)?;
        let depth_words = (depth_kind.to_owned(), near, far);
        Ok(PyScene { input, frame, device, kind, depth_words, invalid, scene: Mutex::new(None) })
    }

    /// The scene through a lens.
    ///
    /// Parameters
    /// ----------
    /// lens : Lens
    ///     The lens.
    /// method, aperture, threads, out, **options
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
    #[pyo3(signature = (lens, *, method="lens", aperture=None, threads=None, out=None, **options))]
    #[expect(clippy::too_many_arguments, reason = "the public method's own, keyword-only in Python")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        lens: &PyLens,
        method: &str,
        aperture: Option<&PyAperture>,
        threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let method = read_method(method, aperture, options)?;
        self.picture(py, &lens.core, &method, threads, out)
    }

    /// The scene through one lens focused at many distances.
    ///
    /// What does not depend on the focus is prepared once.
    ///
    /// Parameters
    /// ----------
    /// lens : Lens
    ///     The lens; its own focus does not matter.
    /// distances : sequence of float
    ///     Distances in focus in metres (disparities for a lens made by `Lens.from_disparity`).
    /// method, aperture, threads, out, **options
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
    #[pyo3(signature = (lens, distances, *, method="lens", aperture=None, threads=None, out=None, **options))]
    #[expect(clippy::too_many_arguments, reason = "the public method's own, keyword-only in Python")]
    fn focal_stack<'py>(
        &self,
        py: Python<'py>,
        lens: &PyLens,
        distances: &Bound<'py, PyAny>,
        method: &str,
        aperture: Option<&PyAperture>,
        threads: Option<usize>,
        out: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let method = read_method(method, aperture, options)?;
        let distances: Vec<f64> = distances
            .try_iter()
            .and_then(|all| all.map(|d| d?.extract()).collect())
            .map_err(|_| PyTypeError::new_err("distances must be a sequence of numbers"))?;
        if distances.is_empty() {
            return Err(PyValueError::new_err("distances must hold at least one distance"));
        }
        let focused = distances.iter().map(|&distance| match lens.core.base {
            Base::Thin { aperture_radius, fov, fov_axis, .. } => {
                let lens_there = Lens::thin(aperture_radius, distance, fov, fov_axis)?;
                lens_there.mounted(lens.core.mount)?.flawed(lens.core.aberrations)
            }
            Base::Relative { .. } => lens.core.focused_at_disparity(distance),
        });
        let lenses = focused.collect::<crate::error::Result<Vec<_>>>()?;
        Ok(self.rendered(py, &lenses, Some(lenses.len()), &method, threads, out)?.0)
    }

    /// What a render takes on the GPU, pass by pass.
    ///
    /// Parameters
    /// ----------
    /// lens, method, aperture, threads, **options
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
    #[pyo3(signature = (lens, *, method="lens", aperture=None, threads=None, **options))]
    fn profile(
        &self,
        py: Python<'_>,
        lens: &PyLens,
        method: &str,
        aperture: Option<&PyAperture>,
        threads: Option<usize>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Vec<(&'static str, f64)>> {
        let method = read_method(method, aperture, options)?;
        let lens = std::slice::from_ref(&lens.core);
        let (_, passes) = self.rendered(py, lens, None, &method, threads, None)?;
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
        let Size { width, height, channels } = self.input.size;
        format!("<dofsim.Scene of {height} x {width} pixels, {channels} channels>")
    }
}
