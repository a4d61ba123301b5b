//! The adjoint of the sweep: every ray gives the cell that it meets what its pixel takes of it.

use super::window::{Target, Window};
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::segments::{MOST, ROWS, Segments};
use crate::cpu::lens::sweep::{Hit, Pixels, visit_tile};
use crate::cpu::lens::tile_color::TileColor;
use crate::scene::grid::TILE;

/// Gives the cells that the tile at `origin` has met what the tile takes of them.
///
/// # Safety
///
/// The segments were traced in the frame's padded arrays, from the tile at `origin`, and the window is around a band with
/// this tile: every segment then stays inside.
pub unsafe fn adjoint(
    frame: &Frame,
    segments: &mut Segments,
    origin: (usize, usize),
    cotangent: &TileColor,
    window: &mut Window,
) {
    let Frame { simd, padded, missed, .. } = frame;
    // SAFETY: per the function's contract.
    unsafe {
        visit_tile(
            *simd,
            padded,
            segments,
            origin,
            *missed,
            #[inline(always)]
            |pixels, segments, hits| give(origin, cotangent, pixels, (segments, hits), window),
        );
    }
}

/// Gives what some pixels of the tile at `origin` take.
///
/// # Safety
///
/// As for [`adjoint`].
#[inline(always)]
pub unsafe fn give(
    origin: (usize, usize),
    cotangent: &TileColor,
    pixels: &Pixels,
    (segments, hits): (&Segments, &[Hit]),
    window: &mut Window,
) {
    let (stride, layers, cells) = (window.stride(), window.layers(), pixels.cells);
    let (x, y) = pixels.at;
    let base = window.index(origin.0 + x, origin.1 + y);
    for (c, given) in cotangent.planes.iter().enumerate() {
        let mut share = [[0.0f32; MOST]; ROWS];
        for row in 0..ROWS {
            for lane in 0..cells {
                let v = given[(y + row) * TILE.0 + x + lane];
                let met = pixels.met(row, lane);
                if met > 0.0 {
                    share[row][lane] = v / met;
                } else {
                    // The pixel keeps the colour of its own cell.
                    window.planes(Target::Swept(0))[c][base + row * stride + lane] += v;
                }
            }
        }
        let planes: Vec<*mut f32> =
            (0..layers).map(|layer| window.planes(Target::Swept(layer))[c].as_mut_ptr()).collect();
        // SAFETY: per the function's contract.
        unsafe {
            for segment in &segments.met {
                let into =
                    planes[segment.layer as usize].add(base.wrapping_add_signed(segment.offset as isize));
                for row in 0..ROWS {
                    let into = into.add(row * stride);
                    for lane in 0..cells {
                        *into.add(lane) += share[row][lane];
                    }
                }
            }
            for hit in hits {
                let into = planes[hit.layer as usize].add(base.wrapping_add_signed(hit.offset as isize));
                for row in 0..ROWS {
                    let into = into.add(row * stride);
                    for lane in 0..cells {
                        let is_hit = hit.cells[row] >> lane & 1 != 0;
                        *into.add(lane) += if is_hit { share[row][lane] } else { 0.0 };
                    }
                }
            }
        }
    }
}
