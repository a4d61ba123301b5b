//! The adjoint of a sweep through layers that let light pass: a ray may see several cells, each in part.

use super::around::Around;
use super::met::Met;
use super::views::Reach;
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::segments::{ROWS, Segments};
use crate::cpu::lens::sweep::visit_tile;
use crate::cpu::lens::sweep_rows::Hits;
use crate::cpu::lens::sweep_tiles::Pixels;
use crate::cpu::lens::tile_color::TileColor;
use crate::plan::lens::tiles::Tile;
use crate::scene::grid::TILE;

/// How far the cells are away that a tile may see, in all layers.
pub fn reach(frame: &Frame, tile: &Tile) -> Reach {
    // A ray starts within its pixel.
    let cells = tile.reach_px.ceil() as usize + 1;
    let layers = frame.padded.layers.len() as u32;
    Reach { cells, layers: u64::MAX.checked_shr(64 - layers).unwrap_or(0) }
}

/// Adds the shares of all cells that a tile meets, each by as much of it as is seen.
///
/// # Safety
///
/// The segments were traced in the frame's padded arrays, from the tile.
pub unsafe fn add(
    frame: &Frame,
    segments: &mut Segments,
    tile: &Tile,
    cotangent: &TileColor,
    around: &mut Around,
) {
    // SAFETY: per the function's contract.
    unsafe {
        visit_tile(
            frame.simd,
            &frame.padded,
            segments,
            tile.origin,
            frame.missed,
            |pixels, segments, hits| {
                add_pixels(frame, pixels, (segments, hits), cotangent, around);
            },
        );
    }
}

/// Adds what some pixels see.
fn add_pixels(
    frame: &Frame,
    pixels: &Pixels,
    (segments, hits): (&Segments, &Hits),
    cotangent: &TileColor,
    around: &mut Around,
) {
    let stride = frame.padded.padding.stride;
    let (x, y) = pixels.at;
    for (row, lane) in (0..ROWS).flat_map(|row| (0..pixels.cells).map(move |lane| (row, lane))) {
        let pixel = (y + row) * TILE.0 + x + lane;
        let mut add = |met: Met, share: f32| {
            let at = around.index(pixel, met);
            let sums = around.layers[met.layer()].sums.as_mut().expect("all layers may be met");
            for (c, given) in cotangent.planes.iter().enumerate() {
                sums.by_color.plane_mut(c)[at] += share * given[pixel];
            }
        };
        let samples = pixels.met(row, lane);
        if samples <= 0.0 {
            // It keeps the colour of its own cell.
            add(Met::OWN, 1.0);
            continue;
        }
        for met in &segments.met {
            add(Met::new(met.layer, met.offset, stride), 1.0 / samples);
        }
        for hit in hits.all.iter().filter(|hit| hit.cells[row] >> lane & 1 != 0) {
            let seen = hits.weights_of(hit).map_or(1.0, |weights| weights[row][lane]);
            add(Met::new(hit.layer, hit.offset, stride), seen / samples);
        }
    }
}
