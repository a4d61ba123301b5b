//! The focus of a lens: on pixels, on the nearest surface, on a mask, on a plane.

use super::super::argument::{self, Argument};
use super::super::depth::{DepthArguments, SeenDepth, read_seen_depth};
use super::PyLens;
use crate::error::{Result, value_error};
use crate::optics::{Base, Lens};
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::exceptions::{PyIndexError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyString;

/// The fraction of pixels that may be nearer than the "nearest" surface, or farther than the "farthest": single wrong
/// depths must not count.
const OUTLIERS: f64 = 0.01;
/// Side of the square that is the centre of the picture, relative to the picture's shorter side.
const CENTRE: f64 = 0.1;

/// What a picture of a focal stack has in focus.
pub enum Focus {
    /// A plane at a distance in metres, or at a relative disparity.
    Plane(f64),
    /// From the nearer end to the farther one.
    Range([f64; 2]),
}

impl Argument for Focus {
    const KIND: &'static str = "a number, or two for a range in focus";
    const RANGE: &'static str = f64::RANGE;

    fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.extract().map(Focus::Range).or_else(|_| value.extract().map(Focus::Plane))
    }
}

impl Focus {
    /// The lens with this in focus.
    pub fn of(&self, lens: &Lens) -> Result<Lens> {
        match (self, lens.base) {
            (&Focus::Range(range), _) => lens.focused_over(range),
            (&Focus::Plane(distance), Base::Thin { aperture_radius, fov, fov_axis, .. }) => {
                let there = Lens::thin(aperture_radius, distance, fov, fov_axis)?;
                there.mounted(lens.mount)?.with_aberrations(lens.aberrations.clone())
            }
            (&Focus::Plane(disparity), Base::Relative { .. }) => lens.focused_at_disparity(disparity),
        }
    }
}

/// A pixel by its column and row; negative numbers count from the end.
fn pixel(x: isize, y: isize, seen: &SeenDepth) -> PyResult<(usize, usize)> {
    let at = |name: &str, i: isize, n: usize| {
        let from_start = if i < 0 { i + n as isize } else { i };
        if (0..n as isize).contains(&from_start) {
            Ok(from_start as usize)
        } else {
            Err(PyIndexError::new_err(format!("{name} must lie within {n} pixels; got {i}")))
        }
    };
    Ok((at("x", x, seen.width)?, at("y", y, seen.height)?))
}

/// The disparity on the axis at which the lens is focused on a pixel, if the pixel's depth is valid.
fn on_axis(lens: &Lens, seen: &SeenDepth, (x, y): (usize, usize)) -> Option<f64> {
    lens.on_axis(seen.disparity(x, y)?, seen.place(x, y))
}

/// The pixels that a lens can be focused on at a finite distance, or at any relative disparity, by their indices in the
/// rows of `depth`.
#[pyfunction]
#[pyo3(signature = (lens, depth, *, depth_kind="z", near=None, far=None, depth_range=None))]
pub fn focusable_pixels<'py>(
    py: Python<'py>,
    lens: &PyLens,
    depth: &Bound<'py, PyAny>,
    depth_kind: &str,
    #[pyo3(from_py_with = argument::near)] near: Option<f64>,
    #[pyo3(from_py_with = argument::far)] far: Option<f64>,
    #[pyo3(from_py_with = argument::depth_range)] depth_range: Option<[f64; 2]>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let seen = read_seen_depth(depth, &DepthArguments { depth_kind, near, far, depth_range }, &lens.core)?;
    let relative = matches!(lens.core.base, Base::Relative { .. });
    let usable = |&i: &usize| {
        let disparity = on_axis(&lens.core, &seen, (i % seen.width, i / seen.width));
        disparity.is_some_and(|d| relative || d > 0.0)
    };
    let found = (0..seen.width * seen.height).filter(usable).map(|i| i as i64);
    Ok(PyArray1::from_iter(py, found))
}

/// Focuses the lens on a quantile of the disparity of these pixels: the fraction `quantile` of them is below it. The
/// disparity of each pixel is taken as it would be on the axis, under the lens's focus surface.
fn focused_on_pixels(
    lens: &Lens,
    seen: &SeenDepth,
    pixels: impl Iterator<Item = (usize, usize)>,
    quantile: f64,
    what: &str,
) -> Result<Lens> {
    let mut found: Vec<f64> = pixels.filter_map(|pixel| on_axis(lens, seen, pixel)).collect();
    if found.is_empty() {
        return Err(value_error!("depth has no depth {what} that the lens could be focused on"));
    }
    let i = ((found.len() - 1) as f64 * quantile).round() as usize;
    lens.focused_at_disparity(*found.select_nth_unstable_by(i, f64::total_cmp).1)
}

#[pymethods]
impl PyLens {
    /// The same lens focused on what pixel (x, y) sees.
    ///
    /// Parameters
    /// ----------
    /// depth : ndarray
    ///     Depth of the picture, shape (H, W).
    /// x, y : int
    ///     Column and row of the pixel; negative values count from the right and the bottom.
    /// radius_px : int, optional
    ///     Take the median over the square of pixels up to so far away, those without depth left out.
    /// depth_kind : str, optional
    ///     How to read `depth`, as in `render`.
    /// near, far, depth_range : float, optional
    ///     Clip planes in metres, for the kinds that need them.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     A new lens. If its focus plane is tilted or curved, that passes through the point.
    ///
    /// Raises
    /// ------
    /// IndexError
    ///     If the pixel is outside the picture.
    /// ValueError
    ///     If the depth there is invalid.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> import numpy as np
    /// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
    /// >>> lens.focused_at(np.full((4, 6), 2.0), 5, 1).focus_distance
    /// 2.0
    #[pyo3(signature = (depth, x, y, *, radius_px=0, depth_kind="z", near=None, far=None, depth_range=None))]
    #[expect(clippy::too_many_arguments, reason = "the public method's own, keyword-only in Python")]
    fn focused_at(
        &self,
        depth: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = argument::x)] x: isize,
        #[pyo3(from_py_with = argument::y)] y: isize,
        #[pyo3(from_py_with = argument::radius_px)] radius_px: usize,
        depth_kind: &str,
        #[pyo3(from_py_with = argument::near)] near: Option<f64>,
        #[pyo3(from_py_with = argument::far)] far: Option<f64>,
        #[pyo3(from_py_with = argument::depth_range)] depth_range: Option<[f64; 2]>,
    ) -> PyResult<PyLens> {
        let seen =
            read_seen_depth(depth, &DepthArguments { depth_kind, near, far, depth_range }, &self.core)?;
        let (x, y) = pixel(x, y, &seen)?;
        let around = |v: usize, n: usize| {
            v.saturating_sub(radius_px)..v.saturating_add(radius_px).saturating_add(1).min(n)
        };
        let pixels = around(y, seen.height).flat_map(|y| around(x, seen.width).map(move |x| (x, y)));
        let what = format!("at row {y}, column {x}");
        Ok(PyLens { core: focused_on_pixels(&self.core, &seen, pixels, 0.5, &what)? })
    }

    /// The same lens focused on a part of the picture.
    ///
    /// Parameters
    /// ----------
    /// depth : ndarray
    ///     Depth of the picture, shape (H, W).
    /// target : {"nearest", "farthest", "centre"} or ndarray
    ///     What to focus on: the nearest or farthest surface, all but a hundredth of the pixels being farther or
    ///     nearer; the median of the middle, a tenth of the shorter side wide and high; or that of a mask, shape (H,
    ///     W) of bool.
    /// depth_kind : str, optional
    ///     How to read `depth`, as in `render`.
    /// near, far, depth_range : float, optional
    ///     Clip planes in metres, for the kinds that need them.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     A new lens.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     If the target is none of these, or no pixel of it has a depth.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> import numpy as np
    /// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
    /// >>> depth = np.linspace(1.0, 5.0, 400).reshape(20, 20)
    /// >>> round(lens.focused_on(depth, "nearest").focus_distance, 2)
    /// 1.04
    #[pyo3(signature = (depth, target, *, depth_kind="z", near=None, far=None, depth_range=None))]
    fn focused_on(
        &self,
        depth: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        depth_kind: &str,
        #[pyo3(from_py_with = argument::near)] near: Option<f64>,
        #[pyo3(from_py_with = argument::far)] far: Option<f64>,
        #[pyo3(from_py_with = argument::depth_range)] depth_range: Option<[f64; 2]>,
    ) -> PyResult<PyLens> {
        let seen =
            read_seen_depth(depth, &DepthArguments { depth_kind, near, far, depth_range }, &self.core)?;
        let (width, height) = (seen.width, seen.height);
        let all = || (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)));
        let focused = |pixels: &mut dyn Iterator<Item = (usize, usize)>, quantile: f64| {
            focused_on_pixels(&self.core, &seen, pixels, quantile, "in the target")
        };
        let core = if let Ok(name) = target.cast::<PyString>() {
            match name.to_str()? {
                "nearest" => focused(&mut all(), 1.0 - OUTLIERS),
                "farthest" => focused(&mut all(), OUTLIERS),
                "centre" | "center" => {
                    let side = (CENTRE * width.min(height) as f64).ceil().max(1.0) as usize;
                    let middle = |n: usize| (n - side) / 2..(n - side) / 2 + side;
                    let pixels = middle(height).flat_map(|y| middle(width).map(move |x| (x, y)));
                    focused(&mut pixels.into_iter(), 0.5)
                }
                other => {
                    return Err(PyValueError::new_err(format!(
                        "target must be \"nearest\", \"farthest\", \"centre\" or a mask; got {other:?}"
                    )));
                }
            }
        } else {
            let mask: PyReadonlyArray2<bool> = target.extract().map_err(|_| {
                PyTypeError::new_err(format!(
                    "target must be a word or a two-dimensional array of bool; got {}",
                    super::super::errors::shown(target)
                ))
            })?;
            let mask = mask.as_array();
            if mask.dim() != (height, width) {
                return Err(PyValueError::new_err(format!(
                    "target must have the shape of depth, {:?}; got {:?}",
                    (height, width),
                    mask.dim()
                )));
            }
            focused(&mut all().filter(|&(x, y)| mask[(y, x)]), 0.5)
        };
        Ok(PyLens { core: core? })
    }

    /// The same lens with its focus plane through what three pixels see.
    ///
    /// Parameters
    /// ----------
    /// depth : ndarray
    ///     Depth of the picture, shape (H, W).
    /// pixels : sequence of three (x, y)
    ///     Columns and rows; they must not lie on one line.
    /// depth_kind : str, optional
    ///     How to read `depth`, as in `render`.
    /// near, far, depth_range : float, optional
    ///     Clip planes in metres, for the kinds that need them.
    ///
    /// Returns
    /// -------
    /// Lens
    ///     With the `tilt` and the `focus_distance` of that plane.
    ///
    /// Raises
    /// ------
    /// IndexError
    ///     If a pixel is outside the picture.
    /// ValueError
    ///     If a pixel has no depth, the pixels span no plane, or the lens is over relative disparity.
    ///
    /// Examples
    /// --------
    /// >>> import dofsim
    /// >>> import numpy as np
    /// >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=90.0)
    /// >>> floor = 1.0 / np.linspace(0.1, 0.9, 9)[:, np.newaxis] * np.ones(9)
    /// >>> tilted = lens.focused_on_plane(floor, [(0, 8), (8, 8), (4, 2)])
    /// >>> round(tilted.focus_distance, 6), [round(angle, 3) for angle in tilted.tilt]
    /// (2.0, [41.987, 0.0])
    #[pyo3(signature = (depth, pixels, *, depth_kind="z", near=None, far=None, depth_range=None))]
    fn focused_on_plane(
        &self,
        depth: &Bound<'_, PyAny>,
        pixels: [[isize; 2]; 3],
        depth_kind: &str,
        #[pyo3(from_py_with = argument::near)] near: Option<f64>,
        #[pyo3(from_py_with = argument::far)] far: Option<f64>,
        #[pyo3(from_py_with = argument::depth_range)] depth_range: Option<[f64; 2]>,
    ) -> PyResult<PyLens> {
        let seen =
            read_seen_depth(depth, &DepthArguments { depth_kind, near, far, depth_range }, &self.core)?;
        let mut places = [[0.0; 3]; 3];
        for (place, [x, y]) in places.iter_mut().zip(pixels) {
            let (x, y) = pixel(x, y, &seen)?;
            let disparity = seen.disparity(x, y).ok_or_else(|| {
                PyValueError::new_err(format!("pixels: depth has no depth at row {y}, column {x}"))
            })?;
            let u = seen.place(x, y);
            *place = [u[0], u[1], disparity];
        }
        Ok(PyLens { core: self.core.focused_on_plane(places)? })
    }
}
