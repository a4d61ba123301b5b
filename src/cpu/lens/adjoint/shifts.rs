//! How a weighted sum of the rendered picture changes with the shift of each cell.

use super::around::Asked;
use super::highlights::Light;
use super::scratch::Scratch;
use super::waves::in_waves;
use super::window::{Sums, Target};
use crate::cancel::Cancel;
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::group::{Group, Input};
use crate::error::Result;
use crate::memory::Buffer;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::Settings;
use crate::plan::lens::footprint::{self, Footprint};
use crate::plan::lens::padding::Margin;
use crate::plan::lens::tiles::{Tile, Works};
use crate::scene::colors::Colors;
use crate::scene::depth_spans::{self, Cell};
use crate::simd::Simd;
use rayon::prelude::*;

/// The derivative of the sum of the rendered picture, weighted by `cotangent`, by the shift of each cell: a plane for each
/// layer. For pictures of one layer, and lenses that show all of the opening everywhere.
pub fn of_shifts(
    input: &Input,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
    cotangent: &[f32],
) -> Result<Vec<Buffer<f32>>> {
    let size = input.picture.size;
    let mut frame = Frame::new(input, optics, settings, (Works::Sweeps, Margin::Reach), simd, cancel)?;
    let group = Group::of_picture(input, &frame.highlights);
    // Widening takes away texture, which moves; the noise of few samples has no mean.
    frame.footprint = Footprint::new(frame.padded.reach_px, |_| 1, |_, _| 0.0, None);
    frame.set_colors(std::slice::from_ref(&group), None);
    cancel.check()?;
    let layers = input.scene.layers.len();
    // The last plane of each layer is that of shifts.
    let planes = Size { channels: size.channels + 1, ..size };
    let mut sums = Sums::new(planes, (0..layers).map(Target::Swept));
    let mut by_highlight = vec![0.0f32; frame.highlights.all.len()];
    let scratch = || Scratch::new(&frame, size, Asked::ColorsAndShifts);
    let of_tile = |scratch: &mut Scratch, tile: (usize, &Tile)| scratch.shifts(&frame, size, tile, cotangent);
    in_waves(&frame, scratch, of_tile, &mut sums, |Light { number, by_shift, .. }| {
        let changes = by_shift.iter().zip(group.excess[number]);
        by_highlight[number] += changes.map(|(by_shift, excess)| by_shift * excess).sum::<f32>();
    })?;
    let n = size.pixels();
    let of_layers = input.scene.layers.iter().zip(sums.into_planes()).enumerate();
    let by_shift = of_layers.map(|(i, (layer, sums))| {
        let (by_color, by_place) = sums.split_at(size.channels * n);
        let drawn = Sharpened { frame: &frame, size, layer: i, colors: group.swept(), by_color };
        let mut by_shift = Buffer::from(by_place);
        by_shift.par_iter_mut().enumerate().filter(|(index, _)| !layer.s[*index].is_nan()).for_each(
            |(index, sum)| {
                *sum += drawn.by_shift(index);
            },
        );
        for (h, change) in frame.highlights.all.iter().zip(&by_highlight).filter(|(h, _)| h.layer == i) {
            by_shift[h.y as usize * size.width + h.x as usize] += h.drawn * change;
        }
        by_shift
    });
    Ok(by_shift.collect())
}

/// The cells of a layer, which are sharpened by their shift: a cell that is drawn between two pixels is blurred, the more
/// the farther it is from both, and that is undone.
struct Sharpened<'a> {
    frame: &'a Frame<'a>,
    size: Size,
    layer: usize,
    /// The colours of all layers.
    colors: &'a [Colors],
    /// The derivative by the colour of each cell as it is drawn.
    by_color: &'a [f32],
}

impl Sharpened<'_> {
    /// The derivative by the shift of a cell, as far as it is sharpened more or less.
    fn by_shift(&self, index: usize) -> f32 {
        // The table of sharpening is linear between eighths of a pixel.
        const STEP_PX: f32 = 1.0 / 8.0;
        let Frame { scene, footprint, s_focus, .. } = self.frame;
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
