//! How a weighted sum of the rendered picture changes with the shift of each cell.

use super::job::Job;
use super::window::{Sums, Target};
use crate::cpu::lens::frame::Frame;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::footprint::{self, Footprint};
use crate::scene::colors::Colors;
use crate::scene::depth_spans::{self, Cell};
use rayon::prelude::*;

/// The derivatives by the shifts of all cells, a plane for each layer: those that tiles have summed up, as cells are sharpened
/// by their shift, and as highlights are drawn. `swept` has what each layer's cells do by their colours once sharpened by
/// `footprint`, and `by_highlight` is how the sum changes with the shift of each highlight.
pub fn of_cells(
    job: &Job,
    sums: &mut Sums,
    swept: &[Buffer<f32>],
    footprint: &Footprint,
    by_highlight: &[f32],
) -> Vec<Buffer<f32>> {
    let &Job { frame, size, group, .. } = job;
    let of_layers = frame.scene.layers.iter().zip(swept).enumerate();
    let by_shift = of_layers.map(|(i, (layer, by_color))| {
        let drawn = Sharpened { frame, size, layer: i, colors: group.swept(), footprint, by_color };
        let mut by_shift = sums.take(Target::Shifts(i));
        by_shift.par_iter_mut().enumerate().filter(|(index, _)| !layer.s[*index].is_nan()).for_each(
            |(index, sum)| {
                *sum += drawn.by_shift(index);
            },
        );
        for (h, change) in frame.highlights.all.iter().zip(by_highlight).filter(|(h, _)| h.layer == i) {
            by_shift[h.y as usize * size.width + h.x as usize] += change;
        }
        by_shift
    });
    by_shift.collect()
}

/// The cells of a layer, which are sharpened by their shift: a cell that is drawn between two pixels is blurred, the more
/// the farther it is from both, and that is undone.
struct Sharpened<'a> {
    frame: &'a Frame<'a>,
    size: Size,
    layer: usize,
    /// The colours of all layers.
    colors: &'a [Colors],
    footprint: &'a Footprint,
    /// The derivative by the colour of each cell as it is drawn.
    by_color: &'a [f32],
}

impl Sharpened<'_> {
    /// The derivative by the shift of a cell, as far as it is sharpened more or less.
    fn by_shift(&self, index: usize) -> f32 {
        // The table of sharpening is linear between eighths of a pixel.
        const STEP_PX: f32 = 1.0 / 8.0;
        let (Frame { scene, s_focus, .. }, footprint) = (self.frame, self.footprint);
        let layers = &scene.layers;
        let n = self.size.pixels();
        if (0..self.size.channels).all(|c| self.by_color[c * n + index] == 0.0) {
            return 0.0;
        }
        let t = (f64::from(layers[self.layer].s[index]) - s_focus) as f32;
        // It depends on the magnitude of the shift alone, with a kink at 0.
        let ends = [t.abs() + STEP_PX, (t.abs() - STEP_PX).max(0.0)];
        let mut kappa = [0.0; 2];
        footprint.sharpening(&ends, 0.0, &mut kappa);
        if kappa[0] == kappa[1] || t == 0.0 {
            return 0.0;
        }
        let per_px = t.signum() / (ends[0] - ends[1]);
        let own = self.colors[self.layer].at(index);
        let mut sum = 0.0;
        for q in depth_spans::neighbours(layers, self.size, Cell { layer: self.layer, index }) {
            let other = self.colors[q.layer].at(q.index);
            for c in 0..self.size.channels {
                let [more, less] = kappa.map(|kappa| footprint::flow(kappa, own[c], other[c]));
                sum -= self.by_color[c * n + index] * (more - less) * per_px;
            }
        }
        sum
    }
}
