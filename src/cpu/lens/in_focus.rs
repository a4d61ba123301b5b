//! Tiles in focus, as the pinhole sees them, with the little blur that they have.

use super::group::Group;
use super::tile_color::TileColor;
use crate::mirror::mirrored;
use crate::plan::lens::in_focus::InFocus;
use crate::scene::grid::TILE;
use crate::scene::layer::SceneLayer;

/// Columns and rows of a tile with one pixel more on every side.
const AROUND: (usize, usize) = (TILE.0 + 2, TILE.1 + 2);

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
        self.fill(group, origin);
        let (width, height) = (group.size.width, group.size.height);
        for y in 0..TILE.1.min(height - origin.1) {
            let weights = |x: usize| {
                let pixel = (origin.1 + y) * width + origin.0 + x;
                // Empty space has no depth, and no blur.
                let front = layers.iter().map(|layer| layer.s[pixel]).find(|s| !s.is_nan());
                front.map_or([0.0; 2], |s| in_focus.weights(s))
            };
            let weights: [[f32; 2]; TILE.0] =
                std::array::from_fn(|x| if origin.0 + x < width { weights(x) } else { [0.0; 2] });
            for (plane, out) in self.planes.chunks_exact(AROUND.0 * AROUND.1).zip(&mut out.planes) {
                let row = |y: usize| &plane[y * AROUND.0..][..AROUND.0];
                let (above, own, below) = (row(y), row(y + 1), row(y + 2));
                for (x, [across, down]) in weights.iter().enumerate() {
                    let v = own[x + 1];
                    let beside = (own[x] - v) + (own[x + 2] - v);
                    let over = (above[x + 1] - v) + (below[x + 1] - v);
                    out[y * TILE.0 + x] = v + across * beside + down * over;
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
