//! Depth as the world has it: soft, coarse and noisy maps become sharp ones of the picture's size.
//!
//! Everything here works on disparity, in which a lens's blur is linear, and on no scale of it in particular.

mod lamps;
mod noise;
mod plane;
mod quantile;
mod registration;
mod softness;
mod steps;

pub use plane::{Plane, fade};
pub use steps::Edges;

use crate::cancel::Cancel;
use crate::error::Result;
use quantile::quantiles;
use rayon::prelude::*;

/// Edges that are up to this wide are sharp, and from the second width on soft: between two pixels of sharp depth there
/// is one pixel.
const SHARP_PX: [f32; 2] = [1.1, 1.4];
/// Depth is refined at half of its size first if that many times as much of its edges is seen there.
const MANY: f32 = 2.0;
/// Smaller depth is not halved.
const SMALLEST_PX: usize = 64;

/// Refined depth.
pub struct Refined {
    /// Depth, of the picture's size.
    pub depth: Plane,
    /// How pixels are divided between two surfaces that meet in them.
    pub edges: Edges,
    /// The width of the given edges in pixels.
    pub width_px: f32,
}

/// Refines disparity, of any scale and of any size, for a picture whose channels of linear light are `colors`.
///
/// Depth that is sharp and without noise comes back to the bit.
pub fn refine(disparity: &Plane, colors: &[Plane], cancel: &Cancel) -> Result<Refined> {
    let light = &brightest(colors);
    let enlarged = (disparity.width, disparity.height) != (light.width, light.height);
    let depth = if enlarged { disparity.resized(light.width, light.height) } else { disparity.clone() };
    let [low, high] = quantiles(depth.values.par_iter().copied(), [0.005, 0.995]);
    let range = high - low;
    if range <= 0.0 {
        return Ok(unchanged(depth, 1.0));
    }
    cancel.check()?;
    // Means over squares of the picture's pixels, enlarged here or before.
    let by = light.width / disparity.width;
    let whole = (disparity.width * by, disparity.height * by) == (light.width, light.height);
    let blocks = match enlarged {
        true if whole && (2..=8).contains(&by) && 24 % by == 0 => by,
        true => 1,
        false => depth.enlarged_by(range),
    };
    let noise = noise::deviation(&depth);
    let depth = noise::without_noise(&depth, noise, range).unwrap_or(depth);
    refined(&depth, light, colors, Map { range, noise, blocks }, cancel)
}

/// What is known of a map as a whole.
#[derive(Clone, Copy)]
struct Map {
    /// The extent of its depths.
    range: f32,
    /// The standard deviation of its noise.
    noise: f32,
    /// Pixels along a side of the squares whose means it was enlarged from; 1 if it was not.
    blocks: usize,
}

/// Refines depth of the picture's size, whose extent and noise are known.
fn refined(depth: &Plane, light: &Plane, colors: &[Plane], map: Map, cancel: &Cancel) -> Result<Refined> {
    let Map { range, noise, .. } = map;
    cancel.check()?;
    let (width_px, edges_px) = softness::width_px(depth, range, noise);
    // Edges that are too wide for the window are seen at half of the size.
    let at_half = (depth.width.min(depth.height) > SMALLEST_PX).then(|| depth.halved());
    let wide = at_half.filter(|half| 2.0 * softness::width_px(half, range, noise).1 > MANY * edges_px);
    if let Some(half) = wide {
        let coarse =
            refined(&half, &light.halved(), &[], Map { blocks: (map.blocks / 2).max(1), ..map }, cancel)?;
        let depth = coarse.depth.resized(depth.width, depth.height);
        let (sharper_px, _) = softness::width_px(&depth, range, noise);
        let found = at(&depth, light, sharper_px, Map { blocks: 1, ..map }, cancel)?;
        return Ok(Refined { width_px: 2.0 * coarse.width_px, ..found });
    }
    // Where the edges are is told by steps, not by all of a ramp.
    let found = at(depth, light, width_px, map, cancel)?;
    let Some(misfit) = registration::misfit(&found.depth, colors, range) else { return Ok(found) };
    cancel.check()?;
    let shifted = misfit.shifted(depth);
    let (shifted_px, _) = softness::width_px(&shifted, range, noise);
    let found = at(&shifted, light, shifted_px, Map { blocks: 1, ..map }, cancel)?;
    let shrunk = misfit.shrunk(&found.depth);
    // What is known of the edges is known of where they were.
    let edges = if shrunk.is_some() { Edges::none(depth) } else { found.edges };
    Ok(Refined { depth: shrunk.unwrap_or(found.depth), edges, width_px })
}

/// Refines depth whose edges are `width_px` wide.
fn at(depth: &Plane, light: &Plane, width_px: f32, map: Map, cancel: &Cancel) -> Result<Refined> {
    let strength = fade(width_px, SHARP_PX[0], SHARP_PX[1]);
    if strength <= 0.0 {
        return Ok(unchanged(depth.clone(), width_px));
    }
    let found = lamps::steps_and_lamps(depth, light, width_px, map.range, map.blocks, cancel)?;
    let Edges { coverage, trust } = found.edges;
    let trust = trust.with(&trust, |trust, _| strength * trust);
    Ok(Refined { depth: mixed(depth, &found.depth, strength), edges: Edges { coverage, trust }, width_px })
}

/// The brightest channel of each pixel.
pub fn brightest(colors: &[Plane]) -> Plane {
    colors[0].like(|y, out| {
        out.fill(0.0);
        for color in colors {
            out.iter_mut().zip(color.row(y as isize)).for_each(|(out, v)| *out = out.max(*v));
        }
    })
}

/// The first plane, and the second as far as it counts.
fn mixed(from: &Plane, to: &Plane, share: f32) -> Plane {
    from.with(to, |from, to| from + share * (to - from))
}

fn unchanged(depth: Plane, width_px: f32) -> Refined {
    let edges = Edges::none(&depth);
    Refined { depth, edges, width_px }
}
