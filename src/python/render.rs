//! `dofsim.render`.

use super::aperture::PyAperture;
use super::argument;
use super::lens::PyLens;
use super::methods::read_method;
use super::scene::PyScene;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::Instant;

/// The picture that a lens of finite aperture would have taken.
///
/// Parameters
/// ----------
/// color : ndarray
///     The pinhole picture, shape (H, W) or (H, W, C) with 1 to 4 channels, or (L, H, W, 4) for layers from
///     front to back. float16, float32 or float64 in linear light, or uint8 or uint16 with `transfer`.
/// depth : ndarray
///     What each pixel sees, shape (H, W), or (L, H, W) for layers. float16, float32 or float64; metres unless
///     `depth_kind` says otherwise. Infinity is background. With ``depth_kind="relative"`` also uint8 or uint16, as parts of
///     their greatest value.
/// lens : Lens
///     The lens.
/// holdout : tuple of ndarray, optional
///     What blocks the light of what is behind it and is not seen itself: its alpha, 0 to 1, and its depth, both as floats
///     of shape (H, W), or (L, H, W) in any order. It goes through the same lens as the picture: out of focus it blocks
///     softly, by visibility for every lens point. What is blocked is missing in the picture's alpha, if it has one. Where a
///     holdout is as far away as a surface, it is in front. For ``method="lens"``.
/// guide : ndarray, optional
///     The picture that decides, shape (H, W) or (H, W, C) with 1 to 4 channels, or (L, H, W, 4) for layers: what `color` is
///     without it. `color` then holds any number of channels of any meaning, as floats, of shape (H, W, N), or (L, H, W, N)
///     with values in each layer. Each channel goes through the lens alone, by the same weights: visibility, edges, hidden surfaces, coverage and highlights are found from the guide. `alpha`, `transfer` and
///     `invalid_color` are about the guide. For ``method="lens"``.
/// kinds : str or sequence of str, optional
///     What the channels are, one word for all or one for each: ``"light"`` (default), ``"matte"`` (coverage and masks: as
///     light, but not darkened by `vignetting` of the lens), ``"data"`` (numbers such as positions, depths or motion: a mean
///     of what is seen, weighted by the guide's coverage if it has any, in which what is infinite or NaN has no weight) or
///     ``"normal"`` (data of three channels in a row that are brought to unit length). Without `guide`, up to 4
///     channels are their own.
/// method : {"lens", "poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"}, optional
///     How to compute; see the notes. All but ``"lens"`` take one layer and are for speed or for their own looks.
/// device : str, optional
///     Where to compute: ``"cpu"``, ``"gpu"``, one of `devices` by its ``id`` or its name, or ``"auto"`` (default): a
///     discrete GPU if there is one, else the CPU. ``"gpu"`` is the best GPU of any kind; a software rasteriser is used only
///     if it is named. The environment variable ``DOFSIM_DEVICE`` says what ``"auto"`` and ``"gpu"`` stand for.
/// aperture : Aperture, optional
///     Shape of the aperture; a disc if not given. A method that cannot draw another shape raises an error.
/// depth_kind : str, optional
///     ``"z"`` (planar, metres, default), ``"distance"`` (from the pinhole along the ray, metres),
///     ``"inverse_z"`` (1/m), ``"disparity"`` (relative; needs `Lens.from_disparity`), ``"relative"`` (the same of any
///     scale, brought to 0 (far) to 1 (near) robustly first: those are its 1st and 99th percentile),
///     ``"zbuffer"`` (0 at `near` to 1 at `far`), ``"opengl_ndc"`` (the same from -1 to 1) or ``"distance_from_near"``
///     (Mitsuba's depth AOV: along the ray from the near plane, 0 where nothing is hit).
/// near, far : float, optional
///     Clip planes in metres, for the kinds that need them. A reversed z-buffer is 0 at the farther plane: give that one
///     as `near`. Either may be infinite.
/// depth_range : tuple of float, optional
///     With ``depth_kind="relative"``, the disparities that become 0 (far) and 1 (near), in place of the percentiles of
///     this picture: one range for all pictures of a sequence keeps what does not move as blurred as it is. Where larger
///     is farther, the first is the larger. Of integers, in parts of their greatest value.
/// invalid : {"raise", "far"}, optional
///     What to do with invalid depth (NaN, negative or zero): raise an error, or take it for the background.
/// invalid_color : {"raise", "fill"}, optional
///     What to do with pixels of which a channel is NaN or infinite: refuse the picture, or give them the mean of the valid
///     pixels around them; a warning then says how many.
/// alpha : {"premultiplied", "straight", "none"}, optional
///     What the last of 4 (or 2) channels is; premultiplied coverage is the default for 4.
/// transfer : {"linear", "srgb"}, optional
///     How samples stand for light. Must be given for integers; floats are linear unless told otherwise.
/// overscan : int, optional
///     Pixels of margin that the picture has on every side beyond the output (in output pixels). The field of
///     view is that of the output.
/// supersample : int, optional
///     The picture is this many times larger than the output along each axis, sampled at its pixels' centres.
/// in_focus : tuple of float, optional
///     A range in focus in place of the lens's own focus: short for ``lens.replace(in_focus=...)``, see `Lens`.
/// max_coc_px : float, optional
///     The largest radius of circles of confusion, in pixels of `color`. What would have a larger one is drawn with this
///     one, so that a depth that is far too near neither spreads over the picture nor refuses it. Blur of axial colour
///     is added to it. Without it ``"lens"`` refuses radii of more than 16384 pixels, and of more than 2048 pixels where all
///     is swept at full resolution (see ``resolution``); some methods have a bound of their own; see the notes.
/// refine : bool, optional
///     Whether to refine the depth first, as `refine_depth` does; it may then be smaller or larger than the picture. What is
///     found of the coverage of edges helps to take their pixels apart.
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
///     The picture, in the dtype and format of `color`; (H, W, 4) for layers, or (H, W, N) for channels in layers.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted.
/// DeviceError
///     If the device cannot be used.
/// MemoryError
///     If the device has not enough memory.
///
/// Notes
/// -----
/// The logger ``dofsim.render`` is told on one line, at the level ``INFO``, the range of the depth, the focus, the radius
/// of the blur and the time; and as a ``WARNING`` what of it is suspicious.
///
/// What lies beyond the border of the picture is taken for its mirror image. The methods and their options:
///
/// ``"lens"`` integrates over the lens with visibility for every lens point. With a fixed number of views it is what
/// an accumulation buffer and distributed ray tracing compute, the references of real-time methods.
///
/// - ``views``, int: lens points used wherever visibility matters, 16 to 16384. By default 64 to 512, chosen for
///   each tile from the largest circle of confusion that reaches it.
/// - ``resolution``, "adaptive" (default) or "full": whether what is blurred by many pixels is rendered in a coarser scene,
///   of four, eight, and up to 256 pixels a cell. That costs less and differs by about what the noise of the views does.
///   GPUs, gradients, layers, holdouts, and lenses with cat's eyes or aberrations do all at full resolution.
///
/// ``"poisson"`` averages over taps scattered over each pixel's own circle of confusion; after the first half of
/// Riguer, Tatarchuk and Isidoro, "Real-Time Depth of Field Simulation", ShaderX2. It takes apertures of any shape.
///
/// - ``taps``, int or array: number of taps beside the pixel itself, 1 to 128, by default the article's own 12; or
///   their places, shape (N, 2) or (N, 3): columns to the right and rows down in units of the circle's radius,
///   and weights, where the pixel's own is 1. The pattern is turned by 180 degrees behind the focus plane.
/// - ``bokeh``, "uniform" (default), "ring", "gaussian" or "inverse": where light falls within a blurred point:
///   evenly, on the rim alone, more in the middle, or more towards the rim.
/// - `max_coc_px` is 5 pixels by default. Twelve taps do not fill a larger circle.
/// - ``leak_test``, "on" (default) or "off": whether taps in front of a pixel count by their own blurriness, so that
///   what is sharp does not leak onto what is blurred behind it.
///
/// ``"gaussian"`` lays a half-size copy, blurred by 25 x 25 of its pixels, over the picture by blurriness, 0 to 1; after
/// the second half of the same article. What is sharp does not spread. Its tables weigh the middle row and column of
/// the blur more than their neighbours, which shows as a cross where a very bright point is.
///
/// - `max_coc_px` is the radius from which on blurriness is 1, by default the 24 pixels of a disc that spreads light as
///   far as the blur does.
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
/// - `max_coc_px` is from 1 to 256, and 64 by default. Time grows with the largest radius there is.
///
/// ``"levels"`` interpolates between the picture and two of five blurs in a row; after "Depth of Field: Controlling
/// Camera Parameters" (NVIDIA, 2004). It knows nothing of edges: what is sharp leaks into what is blurred.
///
/// - ``c0_px``, float: the diameter up to which the picture stays sharp, 0.5 to 1024; at twice that the blur is
///   strongest, and as wide as that circle of confusion. (Of the paper's two readings of 0.5, it is the diameter of 1.5
///   ``c0_px`` here.) By default half of the largest diameter in the frame.
///
/// ``"sprites"`` draws every blurred pixel as a picture of the aperture, in layers in front and behind at half the size;
/// after "Geometry-Shader-Free Bokeh Depth of Field Rendering" (2012). Any `aperture`, or any picture. Time grows with
/// the number of blurred pixels and the area of their circles of confusion.
///
/// - ``sprite``, array of shape (N, M): transmission over the square around the circle of confusion, in place of
///   `aperture`; turned by 180 degrees in front of the focus.
/// - ``coc_threshold_px``, float: the radius above which a pixel is drawn, at least 0.5; 1 by default. Pixels set in
///   between it and twice that.
/// - `max_coc_px` is from 1 to 256, and 64 by default.
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
#[pyo3(signature = (color, depth, lens, *, holdout=None, guide=None, kinds=None, method="lens", device="auto", aperture=None,
    depth_kind="z", near=None, far=None, depth_range=None, invalid="raise", invalid_color="raise", alpha=None, transfer=None,
    overscan=0, supersample=1, in_focus=None, max_coc_px=None, refine=false, threads=None, out=None, **options))]
#[expect(clippy::too_many_arguments, reason = "the public function's own, keyword-only in Python")]
pub fn render<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    depth: &Bound<'py, PyAny>,
    lens: &PyLens,
    holdout: Option<&Bound<'py, PyAny>>,
    guide: Option<&Bound<'py, PyAny>>,
    kinds: Option<&Bound<'py, PyAny>>,
    method: &str,
    device: &str,
    aperture: Option<&PyAperture>,
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
    #[pyo3(from_py_with = argument::in_focus)] in_focus: Option<[f64; 2]>,
    #[pyo3(from_py_with = argument::max_coc_px)] max_coc_px: Option<f64>,
    refine: bool,
    #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
    out: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let method = read_method(method, aperture, max_coc_px, options)?;
    let lens = lens.with_range(in_focus)?;
    let scene = PyScene::new(
        color,
        depth,
        holdout,
        guide,
        kinds,
        device,
        depth_kind,
        near,
        far,
        depth_range,
        invalid,
        invalid_color,
        alpha,
        transfer,
        overscan,
        supersample,
        refine,
    )?;
    let start = Instant::now();
    let picture = scene.picture(py, &lens, &method, threads, out)?;
    if is_logged(py)? {
        let seconds = start.elapsed().as_secs_f64();
        let words = PyDict::new(py);
        words.set_item("depth_kind", depth_kind)?;
        words.set_item("near", near)?;
        words.set_item("far", far)?;
        words.set_item("depth_range", depth_range)?;
        words.set_item("overscan", overscan)?;
        words.set_item("supersample", supersample)?;
        words.set_item("max_coc_px", max_coc_px)?;
        let log_render = py.import("dofsim._report")?.getattr("log_render")?;
        let depth = if refine { scene.depth(py)? } else { depth.clone() };
        log_render.call((depth, PyLens { core: lens }, seconds), Some(&words))?;
    }
    Ok(picture)
}

/// Whether anyone listens to what the logger of renders says. A process that has not imported `logging` has set up no
/// logger.
fn is_logged(py: Python<'_>) -> PyResult<bool> {
    const INFO: i32 = 20;
    let modules = py.import("sys")?.getattr("modules")?.cast_into::<PyDict>()?;
    let Some(logging) = modules.get_item("logging")? else { return Ok(false) };
    logging.call_method1("getLogger", ("dofsim.render",))?.call_method1("isEnabledFor", (INFO,))?.extract()
}
