//! The light of highlights in channels that a picture carries: of each cell the part that the picture has found.

use super::highlights::{Highlight, Highlights};
use crate::scene::colors::CellColor;
use crate::scene::layered::LayeredScene;

/// The highlights of one group of channels.
pub struct CarriedLight {
    /// For each layer, the values of the cells of highlights without that light.
    pub dimmed: Vec<Vec<CellColor>>,
    /// The same as they are swept, if these are not the dimmed ones.
    pub swept: Option<Vec<Vec<CellColor>>>,
    /// The light of each highlight.
    pub excess: Vec<[f32; 4]>,
}

impl CarriedLight {
    /// The light of group number `g`.
    pub fn new(scene: &LayeredScene, highlights: &Highlights, g: usize) -> CarriedLight {
        let color = |h: &Highlight| {
            let index = h.y as usize * scene.size.width + h.x as usize;
            (index, scene.layers[h.layer].carried[g].at(index))
        };
        let scaled = |part: &dyn Fn(&Highlight) -> f32| {
            let mut cells = vec![Vec::new(); scene.layers.len()];
            for h in &highlights.all {
                let ((index, color), part) = (color(h), part(h));
                cells[h.layer].push(CellColor { index, color: color.map(|v| part * v) });
            }
            cells
        };
        let excess = |h: &Highlight| color(h).1.map(|v| h.area * h.outshining * v);
        CarriedLight {
            dimmed: scaled(&|h| 1.0 - h.outshining),
            swept: highlights.swept.is_some().then(|| scaled(&|h| 1.0 - h.drawn * h.outshining)),
            excess: highlights.all.iter().map(excess).collect(),
        }
    }
}
