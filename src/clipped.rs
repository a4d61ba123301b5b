//! The light of pixels that a photograph has clipped.
//!
//! What was brighter than white is white, so that a blurred lamp becomes a grey disc. How bright it was is not in the picture,
//! but two things tell a lamp from a white wall: how little of its surroundings is clipped with it, and how dark they are.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::refine::{Plane, fade};

/// Light from which on a pixel begins to be clipped, and at which it is: sensors and films approach white slowly.
const CLIPPED: [f32; 2] = [0.9, 0.995];
/// The standard deviation of the surroundings, in parts of the picture's longer side.
const SURROUNDINGS: f32 = 0.02;
/// The surroundings are looked at in pixels that are so many times as wide.
const COARSER: f32 = 8.0;

/// The factors by which the light of each pixel is to be multiplied: 1 where nothing is clipped, up to `bound`. `light` is
/// that of each pixel's brightest channel, 1 for white.
pub fn gains(light: &Plane, bound: f32, cancel: &Cancel) -> Result<Plane> {
    let clipped = light.with(light, |v, _| fade(v, CLIPPED[0], CLIPPED[1]));
    let sigma = SURROUNDINGS * light.width.max(light.height) as f32;
    let (mut share, mut dark) =
        (clipped.clone(), light.with(&clipped, |v, clipped| v.clamp(0.0, 1.0) * (1.0 - clipped)));
    let mut factor = 1.0;
    while 2.0 * factor <= COARSER.min(sigma) {
        (share, dark) = (share.halved(), dark.halved());
        factor *= 2.0;
    }
    cancel.check()?;
    let blurred = |plane: &Plane| plane.blurred((sigma / factor).max(0.5)).resized(light.width, light.height);
    let (share, dark) = (blurred(&share), blurred(&dark));
    cancel.check()?;
    // A step of light in the middle of a pixel would be as hard as the clipping: it rises over a pixel or two.
    let inside = clipped.blurred(1.0).with(&clipped, |soft, hard| soft * hard);
    let lamp = share.with(&dark, |share, light| {
        let (alone, dark) = ((1.0 - share).max(0.0), (1.0 - light / (1.0 - share).max(1e-3)).max(0.0));
        let (alone, dark) = (alone * alone, dark * dark);
        alone * alone * dark
    });
    Ok(inside.with(&lamp, |inside, lamp| 1.0 + (bound - 1.0) * inside * lamp))
}
