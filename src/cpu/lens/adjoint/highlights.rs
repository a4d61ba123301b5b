//! The adjoint of drawing highlights: of the light of each, what arrives.

use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::highlights::{Disc, HighlightPass};
use crate::cpu::lens::shadows::{Hidden, Pixels, Shadows};
use crate::cpu::lens::tile_color::TileColor;
use crate::plan::lens::disc;
use crate::plan::lens::highlights::Cluster;
use crate::plan::lens::tiles::Tile;
use crate::scene::grid::TILE;
use std::ops::Range;

/// What a highlight contributes by its light in each channel, and how that changes with its shift, for all of its light.
pub struct Light {
    pub number: usize,
    pub light: [f32; 4],
    pub by_shift: [f32; 4],
}

/// Sums along the rows of a tile, from which those of runs of pixels are differences.
struct RunningSums {
    /// For each channel and row, one more value than a tile has columns.
    values: Vec<f64>,
}

impl RunningSums {
    const ROW: usize = TILE.0 + 1;

    /// The sums of a tile of which a part of each pixel is seen.
    fn new(cotangent: &TileColor, seen: impl Fn(usize) -> f64) -> RunningSums {
        let mut values = Vec::with_capacity(cotangent.planes.len() * TILE.1 * Self::ROW);
        for plane in &cotangent.planes {
            for y in 0..TILE.1 {
                let mut sum = 0.0;
                values.push(sum);
                for at in y * TILE.0..(y + 1) * TILE.0 {
                    sum += seen(at) * f64::from(plane[at]);
                    values.push(sum);
                }
            }
        }
        RunningSums { values }
    }

    /// Adds the weighted sum of the columns `first .. end` of a row.
    fn add(&self, y: usize, (first, end): (i32, i32), weight: f64, into: &mut [f64; 4]) {
        let [first, end] = [first, end].map(|x| x.clamp(0, TILE.0 as i32) as usize);
        if first < end {
            for (plane, into) in self.values.chunks_exact(TILE.1 * Self::ROW).zip(into) {
                *into += weight * (plane[y * Self::ROW + end] - plane[y * Self::ROW + first]);
            }
        }
    }
}

/// The pixels of a tile that may have light of a cluster.
fn lit(pass: &HighlightPass, cluster: &Cluster, tile: &Tile) -> Option<Pixels> {
    let (mut across, mut down): (Range<i32>, Range<i32>) = (TILE.0 as i32..0, TILE.1 as i32..0);
    for number in cluster.members.clone() {
        for Disc { step, .. } in pass.discs(number, tile) {
            pass.visit_disc(number, step, 1.0, tile.origin, |y, (first, end), _| {
                let [first, end] = [first, end].map(|x| x.clamp(0, TILE.0 as i32));
                if first < end {
                    across = across.start.min(first)..across.end.max(end);
                    down = down.start.min(y as i32)..down.end.max(y as i32 + 1);
                }
            });
        }
    }
    (!across.is_empty()).then_some([across, down])
}

/// What a tile takes of the highlights that reach it.
pub fn adjoint(frame: &Frame, number: usize, tile: &Tile, cotangent: &TileColor) -> Vec<Light> {
    let (pass, highlights) = (frame.highlight_pass(), &frame.highlights);
    let mut found = Vec::new();
    let (mut whole, mut hidden): (Option<RunningSums>, Option<Box<Hidden>>) = (None, None);
    for cluster in highlights.of_tile(number) {
        let partly;
        let sums = if cluster.hidden_in_part {
            let hidden: &mut Hidden = hidden.get_or_insert_with(|| Box::new([0.0; TILE.0 * TILE.1]));
            hidden.fill(0.0);
            let middle = &highlights.all[cluster.middle];
            let shadows = Shadows::new(cluster, middle, tile.origin, &frame.padded);
            let Some(lit) = lit(&pass, cluster, tile) else { continue };
            frame.simd.run(
                #[inline(always)]
                || shadows.cast(&lit, hidden),
            );
            partly = RunningSums::new(cotangent, |at| f64::from((1.0 - hidden[at]).max(0.0)));
            &partly
        } else {
            whole.get_or_insert_with(|| RunningSums::new(cotangent, |_| 1.0))
        };
        for number in cluster.members.clone() {
            let highlight = &highlights.all[number];
            let (mut light, mut by_shift) = ([0.0; 4], [0.0; 4]);
            // The shares of both discs are linear in the position between them.
            let slope = f64::from(highlight.drawn_in(tile)) * disc::position_slope(highlight.t);
            for Disc { step, share } in pass.discs(number, tile) {
                let mut of_disc = [0.0; 4];
                pass.visit_disc(number, step, 1.0, tile.origin, |y, columns, weight| {
                    sums.add(y, columns, weight, &mut of_disc);
                });
                let [first, last] = highlight.steps;
                let toward = match step {
                    _ if first == last => 0.0,
                    _ if step == first => -slope,
                    _ => slope,
                };
                for c in 0..4 {
                    light[c] += f64::from(share) * of_disc[c];
                    by_shift[c] += toward * of_disc[c];
                }
            }
            let [light, by_shift] = [light, by_shift].map(|values| values.map(|v| v as f32));
            found.push(Light { number, light, by_shift });
        }
    }
    found
}
