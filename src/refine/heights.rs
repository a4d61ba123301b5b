//! The depth of what is thinner than a coarse map's pixels.
//!
//! No pixel of the map has the depth of a twig or a rail that is thinner than it: its mean is also of what is behind. But a
//! mean keeps sums. What the steps, averaged alike, leave unexplained of the map is by how much such things are not near
//! enough, times how much of each pixel they are.

use super::plane::{Plane, Tile, fade};
use super::spread::{Local, Spread};
use super::steps::{LEAST_CONTRAST, reach_px};

/// From the farther to the nearer of two surfaces, as a part of the contrast on either side of the middle.
const MIDDLE: f32 = 0.1;
/// The variance of coverage below which it says nothing of a height.
const LEAST_VARIANCE: f32 = 1e-3;

/// The width of edges in sides of squares. Means over squares, interpolated, have edges of up to two sides; where they are
/// wider, the map was soft before, and what it has lost is not known.
const WIDTH: [f32; 2] = [1.75, 2.25];

/// Sharp depth whose nearer surfaces explain the map as well as they can, one height at a place. The map was enlarged from
/// means over squares of `side` pixels.
pub fn explained(map: &Plane, sharp: &Plane, side: usize, width_px: f32, range: f32) -> Plane {
    let known = fade(-width_px / side as f32, -WIDTH[1], -WIDTH[0]);
    if known <= 0.0 {
        return sharp.clone();
    }
    let (spread, reach) = (Spread::Blocks(side), reach_px(width_px));
    // A square and the interpolation to its neighbours spread a point by half a side. The window has twice that deviation,
    // and ends at three of its own.
    let window_px = side as f32;
    // What is found at neighbouring pixels of a thing differs by what the map does not tell: less than a square apart, it
    // is one height.
    let even_px = 0.5 * side as f32;
    let margin = (3 * side + 2 * side + 2 * reach + (3.0 * even_px).ceil() as usize).next_multiple_of(side);
    let (low, high) = map.range();
    let tiles = Tile::each([map, sharp], margin, |Tile { planes: [map, sharp], .. }| {
        let (least, most) = sharp.range();
        (most - least > LEAST_CONTRAST * range).then(|| {
            let near = nearer(&sharp, reach, range);
            let probe = spread.of(&near);
            let unexplained = map.with(&spread.of(&sharp), |map, explained| map - explained);
            let local = Local::new(&probe, window_px);
            let shared = local.covariance(&unexplained);
            let lack = shared.with(&local.covariance(&probe), |shared, own| shared / (own + LEAST_VARIANCE));
            let lack = lack.with(&near, |lack, near| known * lack * near);
            // Nothing is nearer than all that is near.
            let raised = sharp
                .with(&lack, |sharp, lack| if lack == 0.0 { sharp } else { (sharp + lack).clamp(low, high) });
            let near = nearer(&raised, reach, range);
            let sums = raised.with(&near, |raised, near| raised * near).blurred(even_px);
            let means = sums.with(&near.blurred(even_px), |sum, near| sum / near.max(1e-6));
            let even = means.with(&near, |mean, near| known * near * mean);
            let left = near.with(&raised, |near, raised| (1.0 - known * near) * raised);
            even.with(&left, |even, left| even + left)
        })
    });
    let mut out = sharp.clone();
    out.write_tiles(margin, tiles.iter().map(Option::as_ref));
    out
}

/// How much each pixel is of the nearer of two surfaces within reach, from 0 to 1; 0 where there is one only.
fn nearer(sharp: &Plane, reach: usize, range: f32) -> Plane {
    let (high, low) = (sharp.maxima(reach), sharp.minima(reach));
    sharp.like(|y, out| {
        let y = y as isize;
        let rows = sharp.row(y).iter().zip(high.row(y).iter().zip(low.row(y)));
        out.iter_mut().zip(rows).for_each(|(out, (v, (high, low)))| {
            let contrast = high - low;
            let side = (v - 0.5 * (high + low)) / contrast.max(f32::MIN_POSITIVE);
            *out = fade(contrast / range, LEAST_CONTRAST, 2.0 * LEAST_CONTRAST) * fade(side, -MIDDLE, MIDDLE);
        });
    })
}
