//! Whether poses are in the axes of OpenGL and Blender, where the pictures themselves show it.

use super::camera::{Camera, Warp};
use super::depth_map::{DepthMap, SAME_PX};
use super::view::{View, Views};
use crate::cancel::Cancel;
use crate::error::Result;
use rayon::prelude::*;

/// Every how manieth row and column is looked at.
const STEP: usize = 4;
/// Views whose pixels contradict the reference by no more than this fit well enough.
const FITS: f64 = 0.005;
/// How many times better the other axes have to fit.
const BETTER: f64 = 4.0;

/// The first view that does not fit the reference in the given axes, and does in those of OpenGL.
pub fn of_opengl(views: &Views, cancel: &Cancel) -> Result<Option<usize>> {
    let reference = &views.views[views.reference];
    for (i, view) in views.views.iter().enumerate().filter(|(i, _)| *i != views.reference) {
        cancel.check()?;
        let given = contradictions(views, reference, view, |camera| *camera);
        if given > FITS && given > BETTER * contradictions(views, reference, view, turned) {
            return Ok(Some(i));
        }
    }
    Ok(None)
}

/// A camera whose pose was in the axes of OpenGL: y up and z backward.
fn turned(camera: &Camera) -> Camera {
    Camera { rotation: camera.rotation.map(|[x, y, z]| [x, -y, -z]), ..*camera }
}

/// The share of a view's pixels that the reference has seen through.
fn contradictions(views: &Views, reference: &View, view: &View, axes: fn(&Camera) -> Camera) -> f64 {
    let map =
        DepthMap { width: views.size.width, height: views.size.height, disparity: &reference.disparity };
    let (from, to) = (axes(&view.camera), axes(&reference.camera));
    let k = (from.baseline(&to) * to.focal_px()) as f32;
    let warp = Warp::between(&from, &to);
    let row = |y: usize| {
        let (mut all, mut through) = (0u32, 0);
        for x in (0..map.width).step_by(STEP) {
            let d = f64::from(view.disparity[y * map.width + x]);
            let Some(seen) = warp.at(x as f64, y as f64, d) else {
                // What is seen is behind the other camera: as wrong as can be.
                (all, through) = (all + 1, through + 1);
                continue;
            };
            let Some(at) = map.pixel_at(seen.x, seen.y) else { continue };
            let in_front = |i: usize| map.behind_px(i, seen.disparity as f32, k) < -SAME_PX;
            all += 1;
            through += u32::from(in_front(at) && map.around(at).all(in_front));
        }
        [all, through]
    };
    let rows = (0..map.height).into_par_iter().step_by(STEP).map(row);
    let [all, through] = rows.reduce(|| [0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
    f64::from(through) / f64::from(all.max(1))
}
