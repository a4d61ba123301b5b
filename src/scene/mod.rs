//! A picture and the data that are prepared from it once, for any focus and any device.
//!
//! In the order of the work: [`depth_noise`] takes the noise out of the depths, which become [`shifts`], and [`edges`] finds
//! depth discontinuities. Of [`one_layer`], [`matting`] separates the two surfaces of edge pixels of the [`front_layer`]
//! into [`mixed_cells`], and [`inpaint`] fills the surfaces that the foreground hides, by the [`exits`] of rays; behind both,
//! lamps have their [`lamp_ends`]. [`given_layers`] have surfaces of their own, and [`lamps`] are taken apart there.
//! [`carried`] takes other channels the same way, [`holdouts`] come between them, and [`layered`] holds the result.
//! [`depth_spans`] and [`depth_bounds`] bound the depths that occur, and [`highlights`] finds the bright cells, by the
//! [`block_light`] around and by their [`crowding`], and tells the [`contrast`] of what they leave.

pub(crate) mod block_light;
pub(crate) mod carried;
pub(crate) mod coarser;
pub(crate) mod colors;
pub(crate) mod contrast;
pub(crate) mod crowding;
pub(crate) mod depth_bounds;
pub(crate) mod depth_codes;
mod depth_noise;
pub(crate) mod depth_spans;
pub(crate) mod edges;
mod exits;
pub(crate) mod front_layer;
pub(crate) mod given_layers;
pub(crate) mod grid;
pub(crate) mod half_plane;
pub(crate) mod highlights;
mod holdouts;
mod inpaint;
mod lamp_ends;
mod lamps;
pub(crate) mod layer;
pub(crate) mod layered;
pub(crate) mod matting;
mod mixed_cells;
mod one_layer;
pub(crate) mod origins;
pub(crate) mod recipe;
mod shifts;

use crate::cancel::Cancel;
use crate::carried::Carried;
use crate::error::{Result, value_error};
use crate::optics::{DisparityMap, Optics};
use crate::picture::{Layer, Picture, Size};
use crate::simd::Simd;
use layered::LayeredScene;
use origins::Origins;
use std::sync::{Arc, Mutex, PoisonError};

/// The largest radius of the circle of confusion that is rendered, in pixels.
const MAX_RADIUS_PX: f64 = 16384.0;

/// The strength of a lens and a picture with mapped disparity, with what was prepared for both.
type Prepared<T> = (f64, Arc<Picture>, Arc<T>);

/// A picture, and the data that have been prepared from it.
pub struct Scene {
    pub(crate) picture: Arc<Picture>,
    /// Number of channels that hold light; coverage is not counted.
    pub(crate) lights: usize,
    /// The channels that the picture carries; these are then rendered in place of its own.
    pub(crate) carried: Option<Carried>,
    /// Pixels of the picture per pixel of the output, along each axis.
    pub(crate) supersample: usize,
    /// The picture with mapped disparity, for the map last used.
    mapped: Mutex<Option<(DisparityMap, Arc<Picture>)>>,
    /// The layers for the lens last used.
    layered: Mutex<Option<Prepared<LayeredScene>>>,
    /// What these are made of, if gradients have asked for it.
    origins: Mutex<Option<Prepared<Origins>>>,
}

impl Scene {
    /// A scene of a picture whose width and height are multiples of `supersample`, and whose first `lights` channels
    /// hold light, with the channels that it carries.
    pub fn new(mut picture: Picture, lights: usize, carried: Option<Carried>, supersample: usize) -> Scene {
        picture.carried = carried.as_ref().map_or_else(Arc::default, |carried| Arc::clone(&carried.groups));
        let picture = Arc::new(picture);
        Scene {
            picture,
            lights,
            carried,
            supersample,
            mapped: Mutex::new(None),
            layered: Mutex::new(None),
            origins: Mutex::new(None),
        }
    }

    /// Whether the output has the pixels of a picture of one layer.
    pub(crate) fn has_own_pixels(&self) -> bool {
        self.supersample == 1 && self.picture.layers.len() == 1
    }

    /// The picture with its disparity mapped: that of a plain lens.
    ///
    /// No lock is ever held over parallel work: a worker that waits inside it may be handed another render of the
    /// same scene, and would wait for itself.
    pub(crate) fn mapped(&self, map: &DisparityMap) -> Arc<Picture> {
        let mut layers = self.picture.layers.iter().chain(self.picture.holdouts.iter());
        if layers.all(|layer| map.keeps(|| layer.disparity_range())) {
            return Arc::clone(&self.picture);
        }
        // A poisoned lock only means that another render was interrupted; its content is either whole or absent.
        let cached = || self.mapped.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand = cached().as_ref().filter(|(own, _)| own == map).map(|(_, p)| Arc::clone(p));
        at_hand.unwrap_or_else(|| {
            let picture = Arc::new(self.picture.with_disparity(|x, y, d| map.at(x, y, d)));
            *cached() = Some((*map, Arc::clone(&picture)));
            picture
        })
    }

    /// The layers of a [mapped](Self::mapped) picture for this lens. They are rebuilt if the cached ones are for another lens.
    pub(crate) fn layered(
        &self,
        picture: &Arc<Picture>,
        optics: &Optics,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<Arc<LayeredScene>> {
        check_radius(picture, optics)?;
        let build = || layered::build(picture, self.lights, optics.k, simd, cancel);
        prepared(&self.layered, picture, optics.k, build)
    }

    /// The same layers, and the pixels of which they are made. Those of a picture of one layer are found together.
    pub(crate) fn layered_with_origins(
        &self,
        picture: &Arc<Picture>,
        optics: &Optics,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<(Arc<LayeredScene>, Arc<Origins>)> {
        check_radius(picture, optics)?;
        if picture.layers.len() > 1 {
            let layered = self.layered(picture, optics, simd, cancel)?;
            let find = || given_layers::origins(picture, self.lights, optics.k, simd, cancel);
            return Ok((layered, prepared(&self.origins, picture, optics.k, find)?));
        }
        let mut layered = None;
        let find = || {
            let (found, origins) = layered::build_with_origins(picture, self.lights, optics.k, simd, cancel)?;
            layered = Some(found);
            Ok(origins)
        };
        let origins = prepared(&self.origins, picture, optics.k, find)?;
        let build = || match layered {
            Some(found) => Ok(found),
            None => layered::build(picture, self.lights, optics.k, simd, cancel),
        };
        Ok((prepared(&self.layered, picture, optics.k, build)?, origins))
    }
}

/// What has been prepared for a picture and the strength of a lens, or is now.
fn prepared<T>(
    last: &Mutex<Option<Prepared<T>>>,
    picture: &Arc<Picture>,
    k: f64,
    prepare: impl FnOnce() -> Result<T>,
) -> Result<Arc<T>> {
    let cached = || last.lock().unwrap_or_else(PoisonError::into_inner);
    let fits = |(own_k, own, _): &&Prepared<T>| *own_k == k && Arc::ptr_eq(own, picture);
    if let Some((_, _, at_hand)) = cached().as_ref().filter(fits) {
        return Ok(Arc::clone(at_hand));
    }
    let new = Arc::new(prepare()?);
    *cached() = Some((k, Arc::clone(picture), Arc::clone(&new)));
    Ok(new)
}

/// Refuses a lens whose largest circle of confusion exceeds [`MAX_RADIUS_PX`].
fn check_radius(picture: &Picture, optics: &Optics) -> Result<()> {
    let too_large = |shift: &f64| shift.is_nan() || shift.abs() > MAX_RADIUS_PX;
    for (name, layers) in [("depth", &picture.layers[..]), ("depth of holdout", &picture.holdouts[..])] {
        if layers.iter().any(|layer| too_large(&optics.largest_radius_px(layer.disparity_range()))) {
            refuse(name, layers, picture.size, optics, too_large)?;
        }
    }
    Ok(())
}

/// Refuses some layers, of whose shifts some may be too large.
fn refuse(
    name: &str,
    layers: &[Layer],
    size: Size,
    optics: &Optics,
    too_large: impl Fn(&f64) -> bool,
) -> Result<()> {
    let shifts = layers.iter().flat_map(|layer| &layer.disparity[..]);
    let shifts = shifts.map(|d| optics.shift_px(f64::from(*d)));
    let refused: Vec<(usize, f64)> = shifts.enumerate().filter(|(_, shift)| too_large(shift)).collect();
    let Some(&(first, shift)) = refused.first() else { return Ok(()) };
    let side = match refused.iter().filter(|(_, shift)| *shift > 0.0).count() {
        0 => "too far behind the focus",
        near if near == refused.len() => "too near",
        _ => "too near or too far behind the focus",
    };
    let place = first % size.pixels();
    Err(value_error!(
        "{name} has {} of {} values that are {side} for this lens: their circles of confusion would have a radius of \
         more than {MAX_RADIUS_PX} px; the first, of {:.0} px, is at row {}, column {}. Pass max_coc_px to bound the \
         radius, use a smaller aperture, or correct these depths",
        refused.len(),
        layers.len() * size.pixels(),
        shift.abs(),
        place / size.width,
        place % size.width
    ))
}
