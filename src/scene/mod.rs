//! A picture and the data that are prepared from it once, for any focus and any device.
//!
//! In the order of the work: [`edges`] finds depth discontinuities, [`matting`] separates the two surfaces of edge
//! pixels, [`inpaint`] fills the surfaces that the foreground hides, and [`layered`] holds the result.
//! [`depth_spans`] and [`depth_bounds`] bound the depths that occur, and [`highlights`] finds the bright cells.

pub(crate) mod colors;
pub(crate) mod depth_bounds;
pub(crate) mod depth_codes;
pub(crate) mod depth_spans;
pub(crate) mod edges;
pub(crate) mod grid;
pub(crate) mod half_plane;
pub(crate) mod highlights;
mod inpaint;
pub(crate) mod layer;
pub(crate) mod layered;
mod matting;

use crate::cancel::Cancel;
use crate::error::{Result, value_error};
use crate::optics::{FocusSurface, Optics};
use crate::picture::Picture;
use crate::simd::Simd;
use layered::LayeredScene;
use std::sync::{Arc, Mutex, PoisonError};

/// The largest radius of the circle of confusion that is rendered, in pixels.
const MAX_RADIUS_PX: f64 = 2048.0;

/// The strength of a lens and its focus surface, with the layers that were prepared for both.
type Prepared = (f64, FocusSurface, Arc<LayeredScene>);

/// A picture, and the data that have been prepared from it.
pub struct Scene {
    pub(crate) picture: Arc<Picture>,
    /// Number of channels that hold light; coverage is not counted.
    pub(crate) lights: usize,
    /// Pixels of the picture per pixel of the output, along each axis.
    pub(crate) supersample: usize,
    /// The picture with the focus surface subtracted from its depth, for the focus surface last used.
    flattened: Mutex<Option<(FocusSurface, Arc<Picture>)>>,
    /// The layers for the lens last used.
    layered: Mutex<Option<Prepared>>,
}

impl Scene {
    /// A scene of a picture whose width and height are multiples of `supersample`, and whose first `lights` channels
    /// hold light.
    pub fn new(picture: Picture, lights: usize, supersample: usize) -> Scene {
        let picture = Arc::new(picture);
        Scene { picture, lights, supersample, flattened: Mutex::new(None), layered: Mutex::new(None) }
    }

    /// The picture for which this focus surface is a plane that faces the camera.
    ///
    /// No lock is ever held over parallel work: a worker that waits inside it may be handed another render of the
    /// same scene, and would wait for itself.
    pub(crate) fn flattened(&self, surface: &FocusSurface) -> Arc<Picture> {
        if surface.is_facing() {
            return Arc::clone(&self.picture);
        }
        // A poisoned lock only means that another render was interrupted; its content is either whole or absent.
        let cached = || self.flattened.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand = cached().as_ref().filter(|(own, _)| own == surface).map(|(_, p)| Arc::clone(p));
        at_hand.unwrap_or_else(|| {
            let picture = Arc::new(self.picture.less(|x, y| surface.offset(x, y)));
            *cached() = Some((*surface, Arc::clone(&picture)));
            picture
        })
    }

    /// The layers of the flattened picture for this lens. They are rebuilt if the cached ones are for another lens.
    pub(crate) fn layered(
        &self,
        picture: &Picture,
        surface: &FocusSurface,
        optics: &Optics,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<Arc<LayeredScene>> {
        let cached = || self.layered.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |(k, own, _): &&Prepared| *k == optics.k && own == surface;
        let at_hand = cached().as_ref().filter(fits).map(|(_, _, layered)| Arc::clone(layered));
        check_radius(picture, optics)?;
        at_hand.map_or_else(
            || {
                let layered = Arc::new(layered::build(picture, optics.k, simd, cancel)?);
                *cached() = Some((optics.k, *surface, Arc::clone(&layered)));
                Ok(layered)
            },
            Ok,
        )
    }
}

/// Refuses a lens whose largest circle of confusion exceeds [`MAX_RADIUS_PX`].
fn check_radius(picture: &Picture, optics: &Optics) -> Result<()> {
    let radii = picture.layers.iter().map(|layer| optics.largest_radius_px(layer.disparity_range()));
    let radius = radii.fold(0.0, f64::max);
    if radius.is_nan() || radius > MAX_RADIUS_PX {
        return Err(value_error!(
            "lens: the largest circle of confusion would have a radius of {radius:.0} px; at most \
             {MAX_RADIUS_PX} px are rendered. Use a smaller aperture, or look for depths that are too near"
        ));
    }
    Ok(())
}
