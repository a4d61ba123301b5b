//! The adjoint of the sweep: every ray gives the cell that it meets what its pixel takes of it.

use super::window::{Target, Window};
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::lanes::{self, Lanes, Portable};
use crate::cpu::lens::segments::{MOST, ROWS, Segments};
use crate::cpu::lens::sweep::visit_hits;
use crate::cpu::lens::tile_color::TileColor;
use crate::scene::grid::TILE;
use crate::simd::InstructionSet;

/// Gives a whole tile.
///
/// # Safety
///
/// As for [`adjoint`], and the instructions of `L` have been detected.
#[inline(always)]
unsafe fn give_tile<L: Lanes>(
    frame: &Frame,
    segments: &mut Segments,
    origin: (usize, usize),
    cotangent: &TileColor,
    window: &mut Window,
) {
    let (layers, stride) = (frame.padded.layers.len(), window.stride());
    let channels = cotangent.planes.len();
    // SAFETY: per the function's contract.
    unsafe {
        visit_hits::<L>(
            &frame.padded,
            segments,
            origin,
            frame.missed,
            #[inline(always)]
            |pixels, segments, hits, (x, y)| {
                let base = window.index(origin.0 + x, origin.1 + y);
                for c in 0..channels {
                    let given = &cotangent.planes[c];
                    let mut share = [[0.0f32; MOST]; ROWS];
                    for row in 0..ROWS {
                        for lane in 0..L::CELLS {
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
                    let planes: Vec<*mut f32> = (0..layers)
                        .map(|layer| window.planes(Target::Swept(layer))[c].as_mut_ptr())
                        .collect();
                    for segment in &segments.met {
                        let into = planes[segment.layer as usize]
                            .add(base.wrapping_add_signed(segment.offset as isize));
                        for row in 0..ROWS {
                            let into = into.add(row * stride);
                            for lane in 0..L::CELLS {
                                *into.add(lane) += share[row][lane];
                            }
                        }
                    }
                    for hit in hits {
                        let into =
                            planes[hit.layer as usize].add(base.wrapping_add_signed(hit.offset as isize));
                        for row in 0..ROWS {
                            let into = into.add(row * stride);
                            for lane in 0..L::CELLS {
                                let is_hit = hit.cells[row] >> lane & 1 != 0;
                                *into.add(lane) += if is_hit { share[row][lane] } else { 0.0 };
                            }
                        }
                    }
                }
            },
        );
    }
}

macro_rules! instantiate {
    ($($name:ident, $lanes:ty, $($feature:literal)?;)*) => {
        $(
            /// # Safety
            ///
            /// As for [`give_tile`].
            $(#[target_feature(enable = $feature)])?
            unsafe fn $name(
                frame: &Frame,
                segments: &mut Segments,
                origin: (usize, usize),
                cotangent: &TileColor,
                window: &mut Window,
            ) {
                // SAFETY: per the function's contract.
                unsafe { give_tile::<$lanes>(frame, segments, origin, cotangent, window) }
            }
        )*
    };
}

instantiate! {
    portable, Portable, ;
}
#[cfg(target_arch = "x86_64")]
instantiate! {
    avx2, lanes::Avx2, "avx2";
    avx512, lanes::Avx512, "avx512f,avx512bw";
}

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
    let of_tile = match frame.simd.instruction_set() {
        InstructionSet::Portable => portable,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => avx2,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => avx512,
    };
    // SAFETY: the instructions have been detected, otherwise the frame's `Simd` would not exist; the rest is this
    // function's contract.
    unsafe { of_tile(frame, segments, origin, cotangent, window) }
}
