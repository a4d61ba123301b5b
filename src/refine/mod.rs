//! Depth as the world has it: soft, coarse and noisy maps become sharp ones of the picture's size.
//!
//! Everything here works on disparity, in which a lens's blur is linear, and on no scale of it in particular.

mod heights;
mod lamps;
mod noise;
mod plane;
mod registration;
mod softness;
mod spread;
mod steps;

pub use plane::{Plane, fade};
pub use steps::Edges;

use crate::cancel::Cancel;
use crate::error::Result;
use crate::noise::deviation;
use crate::picture::Size;
use steps::Steps;

/// Edges that are up to this wide are sharp, and from the second width on soft: between two pixels of sharp depth there
/// is one pixel.
const SHARP_PX: [f32; 2] = [1.1, 1.4];
/// Depth is refined at half of its size first as far as so many times as much of its edges is seen there.
const MANY: [f32; 2] = [2.0, 3.0];
/// Smaller depth is not halved.
const SMALLEST_PX: usize = 64;

/// Refined depth.
pub struct Refined {
    /// Depth, of the picture's size.
    pub depth: Plane,
    /// How pixels are divided between two surfaces that meet in them, if any are.
    pub edges: Option<Edges>,
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
    let range = extent(&depth);
    if range <= 0.0 {
        return Ok(Refined { depth, edges: None, width_px: 1.0 });
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
    let size = Size { width: depth.width, height: depth.height, channels: 1 };
    let noise = deviation(&depth.values, size);
    let depth = noise::without_noise(&depth, noise, range).unwrap_or(depth);
    refined(&depth, light, colors, Map { range, noise, blocks }, cancel)
}

/// The extent of depths, without the half percent at either end, in which outliers are.
fn extent(depth: &Plane) -> f32 {
    // So many values tell the two ends to a few percent of what lies beyond them.
    const ENOUGH: usize = 1 << 18;
    let step = (depth.values.len() / ENOUGH).clamp(1, depth.height);
    let mut some: Vec<f32> =
        (0..depth.height).step_by(step).flat_map(|y| depth.row(y as isize)).copied().collect();
    let last = some.len() - 1;
    let mut quantile =
        |share: f64| *some.select_nth_unstable_by((share * last as f64) as usize, f32::total_cmp).1;
    let low = quantile(0.005);
    quantile(0.995) - low
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
    let half = (depth.width.min(depth.height) > SMALLEST_PX).then(|| depth.halved());
    let at_half_px = half.as_ref().map_or(0.0, |half| 2.0 * softness::width_px(half, range, noise).1);
    let share = fade(at_half_px / edges_px.max(f32::MIN_POSITIVE), MANY[0], MANY[1]);
    let Some(half) = half.filter(|_| share > 0.0) else {
        return at_full_size(depth, light, colors, width_px, map, cancel);
    };
    let wide = at_half_size(depth, &half, light, map, cancel)?;
    if share >= 1.0 {
        return Ok(wide);
    }
    let narrow = at_full_size(depth, light, colors, width_px, map, cancel)?;
    Ok(narrow.mixed(&wide, share))
}

/// Refines depth whose edges are wide: first at half of its size, then what is left of their softness.
fn at_half_size(depth: &Plane, half: &Plane, light: &Plane, map: Map, cancel: &Cancel) -> Result<Refined> {
    let blocks = (map.blocks / 2).max(1);
    let coarse = refined(half, &light.halved(), &[], Map { blocks, ..map }, cancel)?;
    let depth = coarse.depth.resized(depth.width, depth.height);
    let (sharper_px, _) = softness::width_px(&depth, map.range, map.noise);
    let found = at(&depth, light, sharper_px, Map { blocks: 1, ..map }, cancel)?;
    Ok(Refined { width_px: 2.0 * coarse.width_px, ..found })
}

/// Refines depth whose edges are `width_px` wide, and puts it where the picture shows it.
fn at_full_size(
    depth: &Plane,
    light: &Plane,
    colors: &[Plane],
    width_px: f32,
    map: Map,
    cancel: &Cancel,
) -> Result<Refined> {
    // Where the edges are is told by steps, not by all of a ramp.
    let found = at(depth, light, width_px, map, cancel)?;
    let Some(misfit) = registration::misfit(&found.depth, colors, map.range) else { return Ok(found) };
    cancel.check()?;
    let shifted = misfit.shifted(depth);
    let (shifted_px, _) = softness::width_px(&shifted, map.range, map.noise);
    let found = at(&shifted, light, shifted_px, Map { blocks: 1, ..map }, cancel)?;
    Ok(match misfit.shrunk(&found.depth) {
        // What is known of the edges is known of where they were.
        Some(shrunk) => Refined { depth: shrunk, edges: None, width_px },
        None => Refined { width_px, ..found },
    })
}

/// Refines depth whose edges are `width_px` wide.
fn at(depth: &Plane, light: &Plane, width_px: f32, map: Map, cancel: &Cancel) -> Result<Refined> {
    let strength = fade(width_px, SHARP_PX[0], SHARP_PX[1]);
    let sharp = Refined { depth: depth.clone(), edges: None, width_px };
    if strength <= 0.0 {
        return Ok(sharp);
    }
    let Steps { depth: steps, edges } =
        lamps::steps_and_lamps(depth, light, width_px, map.range, map.blocks, cancel)?;
    // Of another blur than that of squares, too little is known.
    let depth = match map.blocks {
        1 => steps,
        side => heights::explained(depth, &steps, side, width_px, map.range),
    };
    cancel.check()?;
    let found = Refined { depth, edges: Some(edges), width_px };
    Ok(if strength < 1.0 { sharp.mixed(&found, strength) } else { found })
}

impl Refined {
    /// This, and another as far as it counts.
    fn mixed(self, other: &Refined, share: f32) -> Refined {
        let mix = |from: &Plane, to: &Plane| from.with(to, |from, to| from + share * (to - from));
        let edges = match (self.edges, &other.edges) {
            (Some(own), Some(other)) => Some(Edges {
                coverage: mix(&own.coverage, &other.coverage),
                trust: mix(&own.trust, &other.trust),
            }),
            (Some(own), None) => Some(own.trusted(1.0 - share)),
            (None, Some(other)) => Some(other.trusted(share)),
            (None, None) => None,
        };
        let width_px = self.width_px + share * (other.width_px - self.width_px);
        Refined { depth: mix(&self.depth, &other.depth), edges, width_px }
    }
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
