//! The adjoint of tiles in focus, in which neighbouring pixels exchange some light.

use super::window::{Region, Target, Window};
use crate::cpu::lens::tile_color::TileColor;
use crate::picture::Size;
use crate::plan::lens::in_focus::InFocus;
use crate::plan::lens::padding::Padding;
use crate::scene::grid::TILE;
use crate::scene::layer::SceneLayer;

/// What a tile of a picture of one layer takes of its pixels and those around it.
pub fn adjoint(
    layers: &[SceneLayer],
    size: Size,
    padding: &Padding,
    in_focus: &InFocus,
    origin: (usize, usize),
    cotangent: &TileColor,
) -> Window {
    let region = Region::new(padding, origin, 1);
    let mut window = Window::new(Target::Given, region, size.channels);
    let stride = region.stride;
    let (across, down) = (TILE.0.min(size.width - origin.0), TILE.1.min(size.height - origin.1));
    for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
        let pixel = (origin.1 + y) * size.width + origin.0 + x;
        let front = layers.iter().map(|layer| layer.s[pixel]).find(|s| !s.is_nan());
        let [beside, over] = front.map_or([0.0; 2], |s| in_focus.weights(s));
        let at = region.index(x, y);
        for (c, given) in cotangent.planes.iter().enumerate() {
            let plane = window.planes.plane_mut(c);
            let v = given[y * TILE.0 + x];
            plane[at] += v - 2.0 * (beside + over) * v;
            for (q, weight) in [(at - 1, beside), (at + 1, beside), (at - stride, over), (at + stride, over)]
            {
                plane[q] += weight * v;
            }
        }
    }
    window
}
