//! The depth of what is small and bright.
//!
//! A lamp of three pixels is nearly gone from a depth map that was blurred by two: what is left has a fifth of its
//! contrast, and no side of any middle. But the picture shows where the lamp is, and a blur keeps sums. So its depth
//! is that which, blurred alike, leaves the least of the map unexplained. It is worth the effort because all of a
//! lamp's light is drawn with the circle of confusion of that depth.

use super::plane::{Plane, Tile, fade};
use super::spread::{Local, Spread};
use super::steps::{Edges, LEAST_CONTRAST, Steps, margin_px, steps};
use crate::cancel::Cancel;
use crate::error::Result;

/// What outshines all around it by this factor begins to be a lamp, and by twice as much is one.
const OUTSHINES: f32 = 3.0;
/// Light below this share of white is no lamp's, however dark it is around.
const FAINTEST: f32 = 0.5;
/// Light that is everywhere, as a share of white: no surroundings are darker.
const AMBIENT: f32 = 0.05;
/// How often steps and lamps are found, each without the other.
const ROUNDS: usize = 3;
/// Around a lamp, what is behind it is not seen in the map.
const HOLE: usize = 2;
/// The standard deviation of the window in which it is looked for, in units of the reach of the blur.
const WINDOW: f32 = 0.7;
/// The share of what is unexplained that lamps have to explain.
const TRUST: [f32; 2] = [0.2, 0.5];
/// What a lamp has to leave in the map, as a share of all depths: more than 8 bits round.
const EVIDENCE: [f32; 2] = [0.005, 0.01];
/// How much wider than the blur the surroundings are in which a lamp's depth is looked for.
const PROBE: f32 = 1.5;

/// Depth with steps and with lamps. `light` is the light of each pixel, 1 for white. Of a map that was enlarged from means
/// over squares, `blocks` are their pixels along a side; otherwise 1.
pub fn steps_and_lamps(
    depth: &Plane,
    light: &Plane,
    width_px: f32,
    range: f32,
    blocks: usize,
    cancel: &Cancel,
) -> Result<Steps> {
    let margin = margin_px(width_px);
    let tiles = Tile::each([depth], margin, |tile| {
        let (low, high) = tile.planes[0].range();
        (high - low > LEAST_CONTRAST * range).then(|| steps(&tile.planes[0], width_px, range))
    });
    let mut found = Steps { depth: depth.clone(), edges: Edges::none(depth) };
    found.depth.write_tiles(margin, tiles.iter().map(|tile| Some(&tile.as_ref()?.depth)));
    let edges = &mut found.edges;
    edges.coverage.write_tiles(margin, tiles.iter().map(|tile| Some(&tile.as_ref()?.edges.coverage)));
    edges.trust.write_tiles(margin, tiles.iter().map(|tile| Some(&tile.as_ref()?.edges.trust)));
    drop(tiles);
    cancel.check()?;

    // All of a blurred lamp, and what is behind it.
    let reach = (0.8 * width_px).ceil() as usize + 2;
    let margin = (2 * margin + reach).next_multiple_of(blocks);
    let spread = match blocks {
        1 => Spread::measured([depth, &found.depth, light], width_px, range, |light| {
            coverage(light, reach).is_some()
        }),
        _ => Some(Spread::Blocks(blocks)),
    };
    let Some(spread) = spread else { return Ok(found) };
    let (low, high) = depth.range();
    let ends = [low, high];
    let tiles =
        Tile::each([depth, &found.depth, light], margin, |Tile { planes: [depth, steps, light], .. }| {
            let lamps = coverage(&light, reach)?;
            let (low, high) = depth.range();
            let seen = high - low > LEAST_CONTRAST * range;
            seen.then(|| {
                with_lamps(&depth, &steps, &lamps, Blur { width_px, spread: &spread, reach }, range, ends)
            })
        });
    found.depth.write_tiles(margin, tiles.iter().map(Option::as_ref));
    cancel.check()?;
    Ok(found)
}

/// The blur of a map.
#[derive(Clone, Copy)]
struct Blur<'a> {
    /// The width of its edges.
    width_px: f32,
    /// What it does to sharp depth.
    spread: &'a Spread,
    /// Where it has ended.
    reach: usize,
}

/// The depth of lamps put into that of steps.
fn with_lamps(depth: &Plane, plain: &Plane, lamps: &Plane, blur: Blur, range: f32, ends: [f32; 2]) -> Plane {
    let Blur { width_px, spread, reach } = blur;
    // A map has one depth a pixel: that of what covers more than half of it.
    let solid = lamps.with(lamps, |share, _| fade(share, 0.35, 0.65));
    let (blurred_lamps, holes) = (spread.of(&solid), lamps.maxima(HOLE));
    let window_px = WINDOW * reach as f32;
    // A wider blur than the map's: what counts is the sum of what is unexplained, wherever exactly the map has put it.
    let probe = match spread {
        Spread::Filter(weights) => solid.blurred(PROBE * deviation_px(weights)),
        Spread::Blocks(_) => blurred_lamps.clone(),
    };
    let local = Local::new(&probe, window_px);
    let own = local.covariance(&blurred_lamps);
    let shares = lamps.blurred(1.0);

    let peaks = blurred_lamps.maxima(HOLE);
    let mut behind = without(plain, &holes);
    // The contrast of each lamp, and the same on its pixels alone.
    let mut known = depth.like(|_, out| out.fill(0.0));
    let mut lit = known.clone();
    for round in 1.. {
        let by_lamps = depth.with(&spread.of(&behind), |depth, explained| depth - explained);
        // What is unexplained is a lamp's contrast times its blurred coverage: least squares, locally, for what the lamps beside
        // it leave.
        let unexplained = by_lamps.with(&spread.of(&lit), |all, explained| all - explained);
        let contrast = local.covariance(&unexplained).with(&own, |shared, own| shared / (own + 1e-6));
        let contrast = contrast.with(&known, |more, known| known + more);
        let trust = local.correlation(&by_lamps);
        let contrast = contrast.with(&trust, |contrast, trust| contrast * fade(trust, TRUST[0], TRUST[1]));
        // What is left of a lamp in the map has to stand out of the map's own rounding.
        let left = contrast.with(&peaks, |contrast, peak| contrast.abs() * peak / range);
        let contrast = contrast.with(&left, |contrast, left| contrast * fade(left, EVIDENCE[0], EVIDENCE[1]));
        // One contrast a lamp.
        let contrast = contrast.with(lamps, |contrast, lamp| contrast * lamp).blurred(1.0);
        let contrast = contrast.with(&shares, |sum, share| sum / share.max(1e-4));
        lit = contrast.with(&solid, |contrast, lamp| contrast * lamp);
        if round == ROUNDS {
            let whole = lamps.with(&contrast, |lamp, contrast| if lamp > 0.5 { contrast } else { 0.0 });
            // No lamp is nearer than all that is near.
            return behind.with(&whole, |behind, contrast| match contrast {
                0.0 => behind,
                _ => (behind + contrast).clamp(ends[0], ends[1]),
            });
        }
        let rest = depth.with(&spread.of(&lit), |depth, lamps| depth - lamps);
        behind = without(&steps(&rest, width_px, range).depth, &holes);
        known = contrast;
    }
    unreachable!("the rounds are counted")
}

/// The standard deviation of a symmetric filter.
fn deviation_px(weights: &[f32]) -> f32 {
    weights.iter().enumerate().map(|(i, weight)| 2.0 * weight * (i * i) as f32).sum::<f32>().sqrt()
}

/// The share of each pixel that lamps cover, if there are any: what stands out from the darkest surroundings that are
/// `2 reach + 1` pixels wide, relative to the most that does so nearby.
fn coverage(light: &Plane, reach: usize) -> Option<Plane> {
    let (darkest, brightest) = light.range();
    if brightest < FAINTEST || brightest < OUTSHINES * darkest {
        return None;
    }
    let around = light.minima(reach).maxima(reach);
    let excess = light.with(&around, |light, around| light - around);
    let (least, most) = (around.range().0, excess.range().1);
    if most < FAINTEST || most < OUTSHINES * (least + AMBIENT) {
        return None;
    }
    let brightest = excess.maxima(reach);
    // The light of a lamp, as noisy as it may be: the mean of what is more than half as bright as the brightest.
    let inner = excess
        .with(&brightest, |excess, brightest| fade(excess / brightest.max(f32::MIN_POSITIVE), 0.4, 0.6));
    let radius_px = 0.5 * reach as f32;
    let level = excess.with(&inner, |excess, inner| excess * inner).blurred(radius_px);
    let level = level.with(&inner.blurred(radius_px), |sum, weight| sum / weight.max(1e-6));
    let coverage = light.like(|y, out| {
        let y = y as isize;
        let rows = excess.row(y).iter().zip(level.row(y)).zip(around.row(y));
        out.iter_mut().zip(rows).for_each(|(out, ((excess, level), around))| {
            let ratio = level / (around + AMBIENT);
            *out = (excess / level.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
                * fade(ratio, OUTSHINES, 2.0 * OUTSHINES)
                * fade(*level, FAINTEST, 2.0 * FAINTEST);
        });
    });
    coverage.values.iter().any(|v| *v > 0.0).then_some(coverage)
}

/// Depth continued over holes from around them.
fn without(depth: &Plane, holes: &Plane) -> Plane {
    let kept = holes.like(|y, out| {
        out.iter_mut().zip(holes.row(y as isize)).for_each(|(out, hole)| *out = fade(-hole, -0.3, -0.1));
    });
    let sums = depth.with(&kept, |depth, kept| depth * kept).blurred(2.0);
    let weights = kept.blurred(2.0);
    let mean = sums.with(&weights, |sum, weight| sum / weight.max(1e-6));
    let filled = mean.with(&kept, |mean, kept| mean * (1.0 - kept));
    depth.with(&kept, |depth, kept| depth * kept).with(&filled, |kept, filled| kept + filled)
}
