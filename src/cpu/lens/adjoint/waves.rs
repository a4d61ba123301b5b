//! Tiles in waves: those of one are done at the same time, and then added in their order.

use super::highlights::Light;
use super::window::{Sums, Window};
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::tile_color::TileColor;
use crate::error::Result;
use crate::picture::Size;
use crate::plan::lens::tiles::Tile;
use crate::scene::grid::TILE;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// The most tiles of a wave, and the fewest.
const TILES: std::ops::RangeInclusive<usize> = 16..=128;
/// The most cells around all tiles of a wave, if these are not too few.
const CELLS: usize = 1 << 21;

/// Does some work with every tile and its number, and adds what comes of a wave of them in order: so no sum depends on the
/// number of threads. What tiles add to cells goes to `sums`, what they add to a highlight to `add`. Waves bound the memory in
/// which the cells around tiles wait.
pub fn in_waves<S: Send>(
    frame: &Frame,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, (usize, &Tile)) -> Result<(Vec<Window>, Vec<Light>)> + Sync,
    sums: &mut Sums,
    mut add: impl FnMut(Light),
) -> Result<()> {
    let [across, down] = frame.padded.padding.pad;
    let around = (TILE.0 + 2 * across) * (TILE.1 + 2 * down);
    let wave = (CELLS / around).clamp(*TILES.start(), *TILES.end());
    // A scratch is large, so one serves as many tiles as possible.
    let idle = Mutex::new(Vec::new());
    let lock = || idle.lock().unwrap_or_else(PoisonError::into_inner);
    for (number, tiles) in frame.tiles.chunks(wave).enumerate() {
        let of_tile = |(i, tile): (usize, &Tile)| {
            frame.cancel.check()?;
            let at_hand = lock().pop();
            let mut own = at_hand.unwrap_or_else(&scratch);
            let done = work(&mut own, (number * wave + i, tile));
            lock().push(own);
            done
        };
        let done = tiles.par_iter().enumerate().with_max_len(1).map(of_tile);
        let (windows, lights): (Vec<_>, Vec<_>) = done.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        sums.add(&frame.padded.padding, &windows.into_iter().flatten().collect::<Vec<_>>());
        lights.into_iter().flatten().for_each(&mut add);
    }
    Ok(())
}

/// Reads a tile of planes; zero beyond the frame.
pub fn read(size: Size, planes: &[f32], origin: (usize, usize), into: &mut TileColor) {
    let (across, down) = (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1));
    for (plane, into) in planes.chunks_exact(size.pixels()).zip(&mut into.planes) {
        into.fill(0.0);
        for y in 0..down {
            let start = (origin.1 + y) * size.width + origin.0;
            into[y * TILE.0..][..across].copy_from_slice(&plane[start..start + across]);
        }
    }
}

/// What pixels beyond a tile give, as far as their tiles are swept.
pub struct Beyond {
    pub channels: Vec<BeyondChannel>,
}

/// The same in one channel: the column behind the last one, and the row below the last one.
pub struct BeyondChannel {
    pub column: [f32; TILE.1],
    pub row: [f32; TILE.0],
}

impl Beyond {
    /// Reads them from planes; so much of the tiles on the right and below is swept.
    pub fn read(size: Size, planes: &[f32], origin: (usize, usize), [right, below]: [f32; 2]) -> Beyond {
        let (x, y) = (origin.0 + TILE.0, origin.1 + TILE.1);
        let of_channel = |plane: &[f32]| {
            let at = |x: usize, y: usize| {
                let inside = x < size.width && y < size.height;
                if inside { plane[y * size.width + x] } else { 0.0 }
            };
            BeyondChannel {
                column: std::array::from_fn(|i| right * at(x, origin.1 + i)),
                row: std::array::from_fn(|i| below * at(origin.0 + i, y)),
            }
        };
        Beyond { channels: planes.chunks_exact(size.pixels()).map(of_channel).collect() }
    }
}
