//! The adjoint of exact discs: every pixel gives its own disc what it takes of it.

use super::window::{Region, Target, Window};
use crate::aperture::Kernel;
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::tile_color::TileColor;
use crate::picture::Size;
use crate::plan::lens::disc::{APART, Surface, extent, position, share};
use crate::plan::lens::tiles::Tile;
use crate::scene::grid::TILE;

/// What a tile takes of the first layer.
pub fn adjoint(frame: &Frame, size: Size, tile: &Tile, cotangent: &TileColor) -> Window {
    let origin = tile.origin;
    // A disc covers a part of the pixels around it, and is between two of which one is larger by a quarter of a pixel.
    let region = Region::new(&frame.padded.padding, origin, tile.reach_px.ceil() as usize + 2);
    let mut window = Window::new(Target::Level, region, size.channels);
    let s = &frame.scene.layers[0].s;
    let (across, down) = extent(size, origin);
    match Surface::new(s, size, frame.s_focus, origin) {
        Surface::Level(s) => {
            let kernel = frame.kernels.level(s);
            for (c, given) in cotangent.planes.iter().enumerate() {
                for y in 0..down {
                    let at = region.index(0, y);
                    give(kernel, &given[y * TILE.0..][..across], c, at, &mut window);
                }
            }
        }
        Surface::Tilted(steps) => {
            let mut part = [0.0f32; TILE.0];
            for y in 0..down {
                let s = &s[(origin.1 + y) * size.width + origin.0..][..across];
                let mut positions = [0.0f64; TILE.0];
                positions.iter_mut().zip(s).for_each(|(p, &s)| *p = position(s, frame.s_focus));
                let at = region.index(0, y);
                for step in steps.clone() {
                    let shares = positions.map(|p| share(p, step));
                    if shares[..across].iter().all(|share| *share == 0.0) {
                        continue;
                    }
                    let kernel = frame.kernels.get(step * APART);
                    for (c, given) in cotangent.planes.iter().enumerate() {
                        let row = part.iter_mut().zip(&given[y * TILE.0..]).zip(&shares);
                        row.for_each(|((part, given), share)| *part = given * share);
                        give(kernel, &part[..across], c, at, &mut window);
                    }
                }
            }
        }
    }
    window
}

/// Gives each of the pixels from `at` on its value times its kernel.
fn give(kernel: &Kernel, values: &[f32], channel: usize, at: usize, window: &mut Window) {
    let stride = window.region.stride as isize;
    let plane = window.planes.plane_mut(channel);
    let place = |dx: i32, dy: i32| (at as isize + dy as isize * stride + dx as isize) as usize;
    let mut before = [0.0f32; TILE.0 + 1];
    for (i, v) in values.iter().enumerate() {
        before[i + 1] = before[i] + v;
    }
    let n = values.len();
    for row in &kernel.rows {
        // A pixel under the run gets the values of as many pixels as the run is long, as far as there are any.
        let run = (row.run.1 - row.run.0).max(0) as usize;
        if run > 0 {
            let into = &mut plane[place(row.run.0, row.dy)..][..n + run - 1];
            for (i, out) in into.iter_mut().enumerate() {
                let (first, end) = ((i + 1).saturating_sub(run), (i + 1).min(n));
                *out += kernel.run_weight * (before[end] - before[first]);
            }
        }
        for &(dx, weight) in &row.partial {
            let into = &mut plane[place(dx, row.dy)..][..n];
            into.iter_mut().zip(values).for_each(|(out, v)| *out += weight * v);
        }
    }
}
