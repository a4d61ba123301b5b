//! `dofsim.layers_from_views`.

use super::argument;
use super::color::{color_shape, read_format, read_layer_color};
use super::depth::{DepthArguments, DepthPlanes, read_depth, read_depth_arguments, read_invalid};
use super::errors::{reworded, shown};
use super::invalid_color::read_invalid_color;
use super::lens::PyLens;
use super::output_grid::OutputGrid;
use super::run::detached;
use super::samples::{array, in_order, sample_type, view, with_sample_type};
use crate::cancel::Cancel;
use crate::color::Sample;
use crate::depth::{DepthKind, Invalid, Rays, disparity_plane};
use crate::error::Result;
use crate::memory::Buffer;
use crate::optics::Base;
use crate::picture::Size;
use crate::views::camera::Camera;
use crate::views::{Cell, Settings, View, Views, axes, hidden};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Layers and their depth: one picture, and what other views saw behind its surfaces.
///
/// Where a lens sees past a foreground, `render` has to guess what one picture hides. The neighbouring frames of a moving
/// camera, the other picture of a stereo pair, or a few more renders from points of the lens have seen it.
///
/// Parameters
/// ----------
/// colors : ndarray or sequence of ndarray
///     The pictures, N of one size, each as of `render` with one layer: 1, 3 or 4 channels. 4 are premultiplied RGBA.
/// depths : ndarray or sequence of ndarray
///     Their depths, N of shape (H, W).
/// poses : array_like
///     Where the cameras stand, shape (N, 4, 4): from camera to world, in metres. The camera's axes are OpenCV's: x to the
///     right, y down, z forward. Poses in the axes of OpenGL and Blender times ``numpy.diag([1, -1, -1, 1])``.
/// intrinsics : array_like
///     Shape (3, 3), or (N, 3, 3) for each its own: ``[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`` in pixels. Pixel centres
///     have whole coordinates, as in OpenCV: the middle of the picture is at ``(W - 1) / 2``.
/// reference : int, optional
///     Which of the pictures is to be rendered.
/// layers : int, optional
///     The largest number of layers that come back, 2 to 16.
/// lens : Lens, optional
///     The lens through which the layers are to be seen. What it cannot see is left out, which saves time.
/// depth_kind, near, far, invalid, invalid_color, alpha, transfer, overscan, supersample, threads
///     As in `render`; no relative depth.
/// flow : ndarray or sequence, optional
///     Motion vectors of things that move, N of shape (H, W, 2), or None for a picture without. At a pixel of a picture, how
///     many pixels to the right and down the point that is seen there is away from it in the reference's picture. That is
///     what renderers write as motion vectors, and what optical flow from the picture to the reference is: the motion of
///     the camera is part of it. Where both are 0 or one is NaN, what is seen stands still. Those of the reference are not used.
///
/// Returns
/// -------
/// color : ndarray
///     float32, shape (L, H, W, 4): linear and premultiplied, as `render` takes layers, with alpha 0 where there is no
///     surface. The first layer is the reference. The others are what it hides: nearest first.
/// depth : ndarray
///     float32, shape (L, H, W): planar depth in metres, as ``depth_kind="z"``.
///
/// Raises
/// ------
/// ValueError, TypeError
///     If an argument cannot be used; the text names it, its value and what is accepted. Poses that mirror, or are in the
///     axes of OpenGL, are told where the pictures show it.
///
/// Notes
/// -----
/// Surfaces are resampled onto the pixels of the reference. Pixels on silhouettes mix two colours and are left out. Small
/// lamps consist of such pixels only, so what outshines its surroundings is separated from them, and its alpha is the part
/// of the pixel that it covers. Where several views see a surface they are averaged, by how finely each sees it, and by how
/// far they agree. What contradicts the reference or most other views is not used: things that have moved, poses or depths
/// that do not fit. What nobody has seen, `render` fills as ever. The order of the other views does not matter.
///
/// Without `flow`, what moves contradicts the reference, and is not used. With it, a point is carried to where it is when the
/// reference is taken, at the distance that it had: what comes nearer meanwhile is still not used. A camera that stands still
/// needs `lens`, too.
///
/// Examples
/// --------
/// A card before a wall, and the same from 0.1 m to the right.
///
/// >>> import dofsim
/// >>> import numpy as np
/// >>> x = np.arange(96) * np.ones((64, 1))
/// >>> card = [(x >= left) & (x < left + 32) for left in (32, 22)]
/// >>> depths = np.stack([np.where(one, 1.0, 2.0) for one in card])
/// >>> colors = np.stack([np.where(one, 0.9, 0.2)[..., None] * np.ones(3) for one in card])
/// >>> poses = np.stack([np.eye(4), np.eye(4)])
/// >>> poses[1, 0, 3] = 0.1
/// >>> intrinsics = [[100, 0, 47.5], [0, 100, 31.5], [0, 0, 1]]
/// >>> layers, z = dofsim.layers_from_views(colors, depths, poses, intrinsics)
/// >>> layers.shape, z[:, 32, 62]
/// ((2, 64, 96, 4), array([1., 2.], dtype=float32))
#[pyfunction]
#[pyo3(signature = (colors, depths, poses, intrinsics, *, reference=0, layers=4, lens=None, depth_kind="z", near=None,
    far=None, invalid="raise", invalid_color="raise", alpha=None, transfer=None, overscan=0, supersample=1, threads=None,
    flow=None))]
#[expect(clippy::too_many_arguments, reason = "the public function's own, keyword-only in Python")]
pub fn layers_from_views<'py>(
    py: Python<'py>,
    colors: &Bound<'py, PyAny>,
    depths: &Bound<'py, PyAny>,
    poses: &Bound<'py, PyAny>,
    intrinsics: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = argument::reference)] reference: usize,
    #[pyo3(from_py_with = argument::layers)] layers: usize,
    lens: Option<&PyLens>,
    depth_kind: &str,
    #[pyo3(from_py_with = argument::near)] near: Option<f64>,
    #[pyo3(from_py_with = argument::far)] far: Option<f64>,
    invalid: &str,
    invalid_color: &str,
    alpha: Option<&str>,
    transfer: Option<&str>,
    #[pyo3(from_py_with = argument::overscan)] overscan: usize,
    #[pyo3(from_py_with = argument::supersample)] supersample: usize,
    #[pyo3(from_py_with = argument::threads)] threads: Option<usize>,
    flow: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let kind = read_depth_arguments(&DepthArguments { depth_kind, near, far, depth_range: None })?;
    if matches!(kind, DepthKind::Disparity | DepthKind::Relative | DepthKind::RelativeBetween { .. }) {
        return Err(PyValueError::new_err(format!(
            "depth_kind must be metric, as poses are; got {depth_kind:?}. The disparity of a stereo pair in pixels, divided \
             by its baseline and its focal length, is \"inverse_z\""
        )));
    }
    if !(2..=16).contains(&layers) {
        return Err(PyValueError::new_err(format!("layers must be from 2 to 16; got {layers}")));
    }
    let (invalid, invalid_color) = (read_invalid(invalid)?, read_invalid_color(invalid_color)?);
    let (colors, depths) = (items("colors", colors)?, items("depths", depths)?);
    let count = colors.len();
    if count == 0 {
        return Err(PyValueError::new_err("colors must hold at least one picture; got none"));
    }
    let flow = flow.map(|flow| items("flow", flow)).transpose()?;
    for (name, items) in [("depths", Some(&depths)), ("flow", flow.as_ref())] {
        if let Some(given) = items.map(Vec::len).filter(|given| *given != count) {
            return Err(PyValueError::new_err(format!(
                "{name} must be as many as colors, {count}; got {given}"
            )));
        }
    }
    if reference >= count {
        return Err(PyValueError::new_err(format!(
            "reference must be from 0 to {}, one of {count} pictures; got {reference}",
            count - 1
        )));
    }
    let (poses, intrinsics) =
        (matrices("poses", poses, 4, count)?, matrices("intrinsics", intrinsics, 3, count)?);

    let mut frames = Vec::with_capacity(count);
    // Of the first picture: its size, and how many channels hold light.
    let mut first = None;
    for (i, (color, depth)) in colors.iter().zip(&depths).enumerate() {
        let named = |error: PyErr| of_item(py, error, i);
        let array = array("color", color).map_err(named)?;
        let shape = color_shape(array.shape()).map_err(named)?;
        // Each picture may have samples of its own type.
        let format = read_format(&array, &shape, alpha, transfer).map_err(named)?;
        let (size, _) = *first.get_or_insert_with(|| (shape.size, format.lights(shape.size)));
        if shape.layers > 1 || shape.size.channels == 2 {
            return Err(PyValueError::new_err(format!(
                "colors[{i}] must have one layer and 1, 3 or 4 channels; got shape {:?}",
                array.shape()
            )));
        }
        if shape.size != size {
            return Err(PyValueError::new_err(format!(
                "colors must all have the size of the first one, {}; colors[{i}] has {}",
                sized(size),
                sized(shape.size)
            )));
        }
        let (color, _, filled) =
            read_layer_color(&array, &shape, 0, &format, invalid_color).map_err(named)?;
        if let Some(filled) = filled {
            filled.warn(py, size)?;
        }
        let depth = read_depth(depth, kind).map_err(named)?;
        if (depth.planes.len(), depth.height, depth.width) != (1, size.height, size.width) {
            return Err(PyValueError::new_err(format!(
                "depths must have the size of colors, {} x {}; depths[{i}] has {} x {}",
                size.height, size.width, depth.height, depth.width
            )));
        }
        let camera = camera(&poses[16 * i..][..16], &intrinsics[9 * i..][..9], i, count)?;
        let given = flow.as_ref().map(|flow| &flow[i]).filter(|flow| !flow.is_none());
        let flow = given.map(|flow| read_flow(&format!("flow[{i}]"), flow, size)).transpose()?;
        frames.push(Taken { color, depth, flow, camera });
    }
    let (size, lights) = first.expect("there is at least one picture");
    let lens_k = lens.map(|lens| lens_strength(lens, size, overscan, supersample)).transpose()?;

    let given_z = frames[reference].depth.planes[0].clone();
    let (color, depth, found) = detached(py, threads, |cancel| {
        let views = views(frames, (size, lights), reference, kind, invalid)?;
        if let Some(i) = axes::of_opengl(&views, cancel)? {
            return Err(crate::error::Error::Value(format!(
                "poses[{i}] is in the axes of OpenGL or Blender (x right, y up, z backward): with them the pictures fit \
                 together, and with OpenCV's they do not. Pass poses @ numpy.diag([1, -1, -1, 1])"
            )));
        }
        let settings = Settings { surfaces: layers - 1, lens_k };
        let hidden = hidden(&views, &settings, cancel)?;
        let reference = &views.views[views.reference];
        let (color, depth) = arrays(reference, size, &given_z, kind, &hidden, cancel)?;
        Ok((color, depth, hidden.len() + 1))
    })?;
    let color = PyArray1::from_vec(py, color).reshape([found, size.height, size.width, 4])?;
    let depth = PyArray1::from_vec(py, depth).reshape([found, size.height, size.width])?;
    Ok((color.into_any(), depth.into_any()))
}

/// What was given of one picture.
struct Taken {
    color: Buffer<f32>,
    depth: DepthPlanes,
    flow: Option<[Buffer<f32>; 2]>,
    camera: Camera,
}

/// Reads motion vectors, as planes.
fn read_flow(name: &str, given: &Bound<'_, PyAny>, size: Size) -> PyResult<[Buffer<f32>; 2]> {
    let array = &array(name, given)?;
    let sample_type = sample_type(name, array, false)?;
    if *array.shape() != [size.height, size.width, 2] {
        return Err(PyValueError::new_err(format!(
            "{name} must have two values for each pixel of colors, shape ({}, {}, 2); got {:?}",
            size.height,
            size.width,
            array.shape()
        )));
    }
    let vectors = with_sample_type!(sample_type, T => self::view::<T, _>(array, |view| {
        in_order(&view, |v: &[T]| Buffer::of_each(v, |v| v.to_code()))
    }))??;
    if let Some(i) = vectors.iter().position(|v| v.is_infinite()) {
        let (x, y) = (i / 2 % size.width, i / 2 / size.width);
        return Err(PyValueError::new_err(format!(
            "{name} must be finite, or NaN where no motion is known; got {} at pixel ({x}, {y})",
            vectors[i]
        )));
    }
    Ok([0, 1].map(|c| vectors.iter().skip(c).step_by(2).copied().collect()))
}

/// The items of a sequence, or of an array along its first axis.
fn items<'py>(name: &str, values: &Bound<'py, PyAny>) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let items = values.try_iter().and_then(|items| items.collect::<PyResult<_>>());
    items.map_err(|_| {
        PyTypeError::new_err(format!(
            "{name} must be an array or a sequence of arrays; got {}",
            values.get_type()
        ))
    })
}

/// An error about "color" or "depth", as one about the picture with this number.
fn of_item(py: Python<'_>, error: PyErr, number: usize) -> PyErr {
    let text = error.value(py).to_string();
    let text = match text.split_once(' ') {
        Some((name @ ("color" | "depth" | "depth:"), rest)) => {
            format!("{}s[{number}] {rest}", name.trim_end_matches(':'))
        }
        _ => format!("colors[{number}]: {text}"),
    };
    reworded(py, &error, text)
}

fn sized(size: Size) -> String {
    format!("{} x {} x {}", size.height, size.width, size.channels)
}

/// As many square matrices as there are pictures, one after another. A single one of `intrinsics` is that of all.
fn matrices(name: &str, given: &Bound<'_, PyAny>, side: usize, count: usize) -> PyResult<Vec<f64>> {
    let numpy = given.py().import("numpy")?;
    let array = numpy
        .call_method1("asarray", (given, "float64"))
        .and_then(|array| array.extract::<PyReadonlyArrayDyn<'_, f64>>());
    let array =
        array.map_err(|_| PyTypeError::new_err(format!("{name} must be numbers; got {}", shown(given))))?;
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    let values = match *array.shape() {
        [n, rows, columns] if (n, rows, columns) == (count, side, side) => values,
        [rows, columns] if (rows, columns) == (side, side) && side == 3 => values.repeat(count),
        _ => {
            let single = if side == 3 { "(3, 3) or " } else { "" };
            return Err(PyValueError::new_err(format!(
                "{name} must have shape {single}({count}, {side}, {side}), one for each of colors; got {:?}",
                array.shape()
            )));
        }
    };
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => {
            let (n, i) = (i / (side * side), i % (side * side));
            Err(PyValueError::new_err(format!(
                "{name} must be finite; {name}[{n}] has {} in row {}, column {}",
                values[n * side * side + i],
                i / side,
                i % side
            )))
        }
        None => Ok(values),
    }
}

/// How far the axes of a pose may be from being at right angles and of length 1: poses come in single precision, and as
/// text of a few digits.
const RIGID: f64 = 1e-3;

/// The camera of a picture.
fn camera(pose: &[f64], intrinsics: &[f64], i: usize, count: usize) -> PyResult<Camera> {
    let pose = |row: usize, column: usize| pose[4 * row + column];
    let refused = |why: String| Err(PyValueError::new_err(why));
    let last: [f64; 4] = std::array::from_fn(|j| pose(3, j));
    if last != [0.0, 0.0, 0.0, 1.0] {
        return refused(format!("poses[{i}] must have the last row [0, 0, 0, 1]; got {last:?}"));
    }
    let rotation: [[f64; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| pose(r, c)));
    let dot = |a: usize, b: usize| (0..3).map(|r| rotation[r][a] * rotation[r][b]).sum::<f64>();
    let pairs = (0..3).flat_map(|a| (a..3).map(move |b| (a, b)));
    let skewed = pairs.map(|(a, b)| (dot(a, b) - f64::from(u8::from(a == b))).abs()).fold(0.0, f64::max);
    if skewed > RIGID {
        return refused(format!(
            "poses[{i}] must be rigid, three axes of length 1 at right angles; they are off by {skewed:.1e}"
        ));
    }
    let [a, b, c] = rotation;
    let determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0]);
    if determinant < 0.0 {
        return refused(format!(
            "poses[{i}] must be a rotation and a position; it mirrors (its determinant is -1), as poses in left-handed axes \
             do: x to the right, y down and z forward are right-handed"
        ));
    }
    let of_all = || if count > 1 { format!("intrinsics (of colors[{i}])") } else { "intrinsics".to_owned() };
    let k: [[f64; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| intrinsics[3 * r + c]));
    if k[1][0] != 0.0 || k[2] != [0.0, 0.0, 1.0] || k[0][0] <= 0.0 || k[1][1] <= 0.0 {
        return refused(format!(
            "{} must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with fx and fy greater than 0; got {k:?}",
            of_all()
        ));
    }
    Ok(Camera { intrinsics: k, rotation, position: std::array::from_fn(|r| pose(r, 3)) })
}

/// Pixels of blur to a unit of disparity, through a lens of a metric scene.
fn lens_strength(lens: &PyLens, size: Size, overscan: usize, supersample: usize) -> PyResult<f64> {
    if matches!(lens.core.base, Base::Relative { .. }) {
        return Err(PyValueError::new_err(
            "lens must be metric, as poses are; got one made by Lens.from_disparity",
        ));
    }
    Ok(OutputGrid::new(size, overscan, supersample)?.geometry(size).imaging(&lens.core)?.optics.k)
}

/// The pictures with their disparities.
fn views(
    frames: Vec<Taken>,
    (size, lights): (Size, usize),
    reference: usize,
    kind: DepthKind,
    invalid: Invalid,
) -> Result<Views> {
    let views = frames.into_iter().enumerate().map(|(i, Taken { color, depth, flow, camera })| {
        let [[fx, skew, cx], [_, fy, cy], _] = camera.intrinsics;
        if kind.needs_rays() && ((fx - fy).abs() > 1e-6 * fx || skew != 0.0) {
            return Err(crate::error::Error::Value(format!(
                "intrinsics must have square pixels (fx = fy, no skew) for depth along the ray; colors[{i}] has fx {fx}, fy \
                 {fy}, skew {skew}. Pass planar depth, depth_kind=\"z\""
            )));
        }
        let rays = Some(Rays { focal_px: fx, centre: [cx, cy] });
        let disparity = disparity_plane(&depth.planes[0], size.width, kind, rays, invalid);
        let disparity = disparity.map_err(|error| match error {
            crate::error::Error::Value(text) => crate::error::Error::Value(format!("depths[{i}]: {text}")),
            other => other,
        })?;
        Ok(View { color, channels: size.channels, disparity, flow, camera })
    });
    let views = views.collect::<Result<Vec<_>>>()?;
    Ok(Views { size, lights, views, reference })
}

/// Colour and depth in layers, interleaved.
fn arrays(
    reference: &View,
    size: Size,
    given: &[f32],
    kind: DepthKind,
    hidden: &[Vec<Cell>],
    cancel: &Cancel,
) -> Result<(Vec<f32>, Vec<f32>)> {
    let n = size.pixels();
    // One channel is grey; a fourth one is coverage.
    let rgba = |color: [f32; 4], coverage: f32| match size.channels {
        1 => [color[0], color[0], color[0], coverage],
        4 => color,
        _ => [color[0], color[1], color[2], coverage],
    };
    let layers = hidden.len() + 1;
    let (mut color, mut depth) = (vec![0.0; 4 * n * layers], vec![f32::INFINITY; n * layers]);
    for i in 0..n {
        color[4 * i..][..4].copy_from_slice(&rgba(reference.color_at(i), 1.0));
        let d = reference.disparity[i];
        // Depth that is given as it is returned keeps its bits.
        depth[i] = if kind == DepthKind::Z && d > 0.0 { given[i] } else { d.recip() };
    }
    for (layer, cells) in (1..).zip(hidden) {
        cancel.check()?;
        for cell in cells {
            let at = layer * n + cell.index;
            color[4 * at..][..4].copy_from_slice(&rgba(cell.color, cell.coverage));
            depth[at] = cell.disparity.recip();
        }
    }
    Ok((color, depth))
}
