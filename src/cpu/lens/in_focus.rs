//! Tiles in focus, as the pinhole sees them, with the little blur that they have.

use super::group::Group;
use super::tile_color::TileColor;
use crate::mirror::mirrored;
use crate::plan::lens::in_focus::InFocus;
use crate::scene::grid::TILE;
use crate::scene::layer::SceneLayer;

/// Columns and rows of a tile with one pixel more on every side.
const AROUND: (usize, usize) = (TILE.0 + 2, TILE.1 + 2);

/// The first layer that has a cell at a pixel: the one that decides how the pixel is blurred.
pub fn first_of(layers: &[SceneLayer], pixel: usize) -> Option<usize> {
    layers.iter().position(|layer| !layer.s[pixel].is_nan())
}

/// The pinhole's picture of a tile and the pixels around it.
#[derive(Default)]
pub struct Composite {
    /// Planes of [`AROUND`] pixels.
    planes: Vec<f32>,
}

impl Composite {
    /// Renders the channels of a group in the tile at `origin`.
    pub fn tile(
        &mut self,
        group: &Group,
        layers: &[SceneLayer],
        in_focus: &InFocus,
        origin: (usize, usize),
        out: &mut TileColor,
    ) {
        self.exchange(group, layers, |s| in_focus.weights(s), 1.0, origin, out);
    }

    /// By how much the channels of a group rise in each pixel of that tile with the shift that it has.
    pub fn slopes(
        &mut self,
        group: &Group,
        layers: &[SceneLayer],
        in_focus: &InFocus,
        origin: (usize, usize),
        out: &mut TileColor,
    ) {
        self.exchange(group, layers, |s| in_focus.slopes(s), 0.0, origin, out);
    }

    /// Sums up `own` times the pinhole's picture of a tile and what pixels exchange by the weights of their shifts.
    fn exchange(
        &mut self,
        group: &Group,
        layers: &[SceneLayer],
        weights_of: impl Fn(f32) -> [f32; 2],
        own: f32,
        origin: (usize, usize),
        out: &mut TileColor,
    ) {
        self.fill(group, origin);
        let (width, height) = (group.size.width, group.size.height);
        for y in 0..TILE.1.min(height - origin.1) {
            let weights = |x: usize| {
                let pixel = (origin.1 + y) * width + origin.0 + x;
                // Empty space has no depth, and no blur.
                first_of(layers, pixel).map_or([0.0; 2], |layer| weights_of(layers[layer].s[pixel]))
            };
            let weights: [[f32; 2]; TILE.0] =
                std::array::from_fn(|x| if origin.0 + x < width { weights(x) } else { [0.0; 2] });
            for (plane, out) in self.planes.chunks_exact(AROUND.0 * AROUND.1).zip(&mut out.planes) {
                let row = |y: usize| &plane[y * AROUND.0..][..AROUND.0];
                let (above, here, below) = (row(y), row(y + 1), row(y + 2));
                for (x, [across, down]) in weights.iter().enumerate() {
                    let v = here[x + 1];
                    let beside = (here[x] - v) + (here[x + 2] - v);
                    let over = (above[x + 1] - v) + (below[x + 1] - v);
                    out[y * TILE.0 + x] = own * v + across * beside + down * over;
                }
            }
        }
    }

    /// Composites the layers in the tile at `origin` and around it.
    fn fill(&mut self, group: &Group, origin: (usize, usize)) {
        let size = group.size;
        let n = size.pixels();
        self.planes.resize(size.channels * AROUND.0 * AROUND.1, 0.0);
        let around = |first: usize, i: usize, extent: usize| mirrored((first + i) as i64 - 1, extent).0;
        let columns: [usize; AROUND.0] = std::array::from_fn(|x| around(origin.0, x, size.width));
        for j in 0..AROUND.1 {
            let start = around(origin.1, j, size.height) * size.width;
            let mut left = [1.0f32; AROUND.0];
            for (i, planes) in group.planes.iter().enumerate() {
                let row = |c: usize| &planes[c * n + start..][..size.width];
                for c in 0..size.channels {
                    let out = &mut self.planes[(c * AROUND.1 + j) * AROUND.0..][..AROUND.0];
                    let seen = out.iter_mut().zip(&columns).zip(&left);
                    if i == 0 {
                        seen.for_each(|((out, &x), _)| *out = row(c)[x]);
                    } else {
                        seen.for_each(|((out, &x), left)| *out += left * row(c)[x]);
                    }
                }
                if let Some(coverage) = group.coverage.get(i) {
                    let alpha = &coverage[start..][..size.width];
                    left.iter_mut().zip(&columns).for_each(|(left, &x)| *left *= 1.0 - alpha[x]);
                }
            }
        }
    }
}
