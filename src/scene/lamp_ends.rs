//! A lamp that shines beside an edge is not taken to go on behind it.
//!
//! What is behind the surface in front of a mixed pixel has the colour of what is around. Where that is a lamp, and the pixel
//! itself shows next to nothing of it, this would be one more lamp that the lens sees.

use super::front_layer::FrontLayer;
use super::highlights::Limits;
use super::matting::MixedPixel;
use crate::rows::mix;
use rayon::prelude::*;

/// From this part of a pixel's light on, the pixel shows that a lamp is behind its surface in front.
const SHOWN: f32 = 0.5;

/// Takes the light that these pixels do not show from the surfaces behind them.
pub fn end_lamps(mixed: &mut [MixedPixel], frame: &FrontLayer, limits: &Limits) {
    let light = |color: [f32; 4]| color[..frame.lights].iter().map(|v| v.max(0.0)).sum::<f32>();
    mixed.par_iter_mut().filter(|m| m.coverage > 0.0).for_each(|m| {
        let going_on = limits.going_on(&m.back, m.index);
        if going_on == 1.0 {
            return;
        }
        let (back, own) = (light(m.back), light(frame.color_at(m.index)));
        let shown = (1.0 - m.coverage) * back / (SHOWN * own).max(f32::MIN_POSITIVE);
        m.recipe.back_light = mix(going_on, 1.0, shown.min(1.0));
        let ends = m.recipe.end(m.coverage, [m.front, m.back]);
        for (end, color) in ends.into_iter().zip([&mut m.front, &mut m.back]) {
            color[..frame.lights].copy_from_slice(&end[..frame.lights]);
        }
    });
}
