//! What pixels change with their own shift, which decides how they are blurred: in exact discs, and in focus.

use super::job::Job;
use super::window::{Region, Target, Window};
use crate::cpu::lens::tile_color::TileColor;
use crate::plan::lens::disc::extent;
use crate::scene::grid::TILE;

/// What a tile takes of the shifts of its pixels' own cells, in each layer that has some. `slopes` are by how much the
/// pixels rise with them, and `layer` tells of which layer the cell of a pixel of the frame is.
pub fn adjoint(
    job: &Job,
    origin: (usize, usize),
    layer: impl Fn(usize) -> Option<usize>,
    cotangent: &TileColor,
    slopes: &TileColor,
) -> Vec<Window> {
    let region = Region::new(&job.frame.padded.padding, origin, 0);
    let mut windows: Vec<Window> = Vec::new();
    let (across, down) = extent(job.size, origin);
    for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
        let Some(number) = layer((origin.1 + y) * job.size.width + origin.0 + x) else { continue };
        let target = Target::Shifts(number);
        let at_hand = windows.iter().position(|window| window.target == target);
        let window = at_hand.unwrap_or_else(|| {
            windows.push(Window::new(target, region, 1));
            windows.len() - 1
        });
        let at = y * TILE.0 + x;
        let channels = cotangent.planes.iter().zip(&slopes.planes);
        windows[window].planes.plane_mut(0)[region.index(x, y)] =
            channels.map(|(cotangent, slopes)| cotangent[at] * slopes[at]).sum();
    }
    windows
}
