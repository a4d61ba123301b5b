//! The light of pixels that a photograph has clipped.
//!
//! What was brighter than white is white, so that a blurred lamp becomes a grey disc. How bright it was is not in the picture,
//! but two things tell a lamp from a white wall: how little of its surroundings is clipped with it, and how dark they are.
//! Where the photograph has a gain map, that says it.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::refine::{Plane, fade};

/// Light from which on a pixel begins to be clipped, and at which it is: sensors and films approach white slowly.
const CLIPPED: [f32; 2] = [0.9, 0.995];
/// The standard deviation of the surroundings, in parts of the picture's longer side.
const SURROUNDINGS: f32 = 0.02;
/// The surroundings are looked at in pixels that are so many times as wide.
const COARSER: f32 = 8.0;

/// The factors by which the light of each pixel is to be multiplied, as its surroundings suggest: 1 where nothing is
/// clipped, up to `bound`. `light` is that of each pixel's brightest channel, 1 for white.
pub fn guessed_gains(light: &Plane, bound: f32, cancel: &Cancel) -> Result<Plane> {
    let clipped = clipped(light);
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
    let lamp = share.with(&dark, |share, light| {
        let (alone, dark) = ((1.0 - share).max(0.0), (1.0 - light / (1.0 - share).max(1e-3)).max(0.0));
        let (alone, dark) = (alone * alone, dark * dark);
        alone * alone * dark
    });
    Ok(inside(&clipped).with(&lamp, |inside, lamp| 1.0 + (bound - 1.0) * inside * lamp))
}

/// The same factors, as a gain map says them: `map` has those of white, and any size.
pub fn mapped_gains(light: &Plane, map: &Plane, bound: f32) -> Plane {
    let map = map.resized(light.width, light.height);
    inside(&clipped(light)).with(&map, |inside, gain| 1.0 + (gain.clamp(1.0, bound) - 1.0) * inside)
}

/// How much each pixel is clipped, 0 to 1.
fn clipped(light: &Plane) -> Plane {
    light.with(light, |v, _| fade(v, CLIPPED[0], CLIPPED[1]))
}

/// The same, softer: a step of light in the middle of a pixel would be as hard as the clipping, so it rises over a
/// pixel or two.
fn inside(clipped: &Plane) -> Plane {
    clipped.blurred(1.0).with(clipped, |soft, hard| soft * hard)
}
