//! Highlights: cells so bright that single lens samples would show as dots in their discs.
//!
//! The excess of such a cell over its surroundings is taken out of the layers and drawn as the exact, area-weighted
//! opening. Each pixel of the disc traces its own ray to find how much of the highlight nearer surfaces hide.

use super::padding::{self, Padding};
use super::tiles::{IN_FOCUS_PX, Tile};
use crate::scene::colors::CellColor;
use crate::scene::grid::TILE;
use crate::scene::highlights::Bright;
use crate::scene::layer::SceneLayer;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;

/// The excess of one cell's light over its surroundings, and its disc.
pub struct Highlight {
    /// Position in the padded frame.
    pub x: i32,
    pub y: i32,
    /// Shift in pixels.
    pub t: f64,
    /// The excess of light over the surroundings.
    pub excess: [f32; 4],
    /// Whether a nearer surface may hide part of the disc.
    pub hidden_in_part: bool,
}

/// The highlights of a scene under one focus and, for each layer, the colours of their cells without the excess. Each
/// highlight is assumed to be partly hidden until the search has shown otherwise.
pub fn extract(
    scene: &LayeredScene,
    padding: &Padding,
    s_focus: f64,
    simd: Simd,
) -> (Vec<Highlight>, Vec<Vec<CellColor>>) {
    let mut highlights = Vec::new();
    let of_layer = |(layer, bright): (&SceneLayer, &Vec<Bright>)| {
        let mut dimmed = Vec::with_capacity(bright.len());
        for &Bright { index, dim, excess } in bright {
            let t = f64::from(layer.s[index]) - s_focus;
            // An empty cell has a shift of NaN, for which the comparison is false.
            if t.abs() > IN_FOCUS_PX {
                dimmed.push(CellColor { index, color: dim });
                highlights.extend(images(padding, index, t).map(|(x, y)| Highlight {
                    x,
                    y,
                    t,
                    excess,
                    hidden_in_part: true,
                }));
            }
        }
        dimmed
    };
    let all_dimmed = scene.layers.iter().zip(&*scene.bright(simd)).map(of_layer).collect();
    (highlights, all_dimmed)
}

/// A pixel and those of its mirror images whose discs reach into the frame, in padded coordinates.
fn images(padding: &Padding, index: usize, t: f64) -> impl Iterator<Item = (i32, i32)> {
    let padding = *padding;
    let reach = t.abs().ceil() as usize + 1;
    let along = move |i: usize, n: usize| {
        padding::images(i, n, reach - 1, n + 2 * reach - 1)
            .map(move |(at, _)| (at + padding.pad + 1 - reach) as i32)
    };
    let (x, y) = (index % padding.width, index / padding.width);
    along(y, padding.height).flat_map(move |y| along(x, padding.width).map(move |x| (x, y)))
}

/// The highlights of a frame, sorted by the tiles that their discs reach.
pub struct Highlights {
    pub all: Vec<Highlight>,
    /// For each tile, the highlights that reach it, in order.
    pub by_tile: Vec<Vec<u32>>,
}

impl Highlights {
    /// Sorts highlights into tiles.
    pub fn new(all: Vec<Highlight>, padding: &Padding, tiles: &[Tile]) -> Highlights {
        let (across, pad) = (padding.width.div_ceil(TILE.0), padding.pad as i32);
        let mut by_tile = vec![Vec::new(); tiles.len()];
        let down = tiles.len() / across;
        for (i, h) in all.iter().enumerate() {
            let reach = h.t.abs().ceil() as i32 + 1;
            let range = |v: i32, side: usize, n: usize| {
                let first = (v - pad - reach).max(0) as usize / side;
                let end = ((v - pad + reach).max(-1) + side as i32) as usize / side;
                first..end.min(n)
            };
            for ty in range(h.y, TILE.1, down) {
                for tx in range(h.x, TILE.0, across) {
                    by_tile[ty * across + tx].push(i as u32);
                }
            }
        }
        Highlights { all, by_tile }
    }

    /// The shifts for which discs are needed.
    pub fn shifts(&self) -> impl Iterator<Item = f64> + '_ {
        self.all.iter().map(|h| h.t)
    }
}
