//! How a weighted sum of the rendered picture changes with the shift of each cell.

use super::around::Around;
use super::bands::{Band, WAVE, bands, read};
use super::gather::{self, Gather};
use super::highlights::{self, Light};
use super::views::Views;
use super::window::{Kept, Sums, Window};
use crate::cancel::Cancel;
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::group::{Group, Input};
use crate::cpu::lens::segments::Segments;
use crate::cpu::lens::tile_color::TileColor;
use crate::error::Result;
use crate::memory::Buffer;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::Settings;
use crate::plan::lens::footprint::{self, Footprint};
use crate::plan::lens::tiles::{Work, Works};
use crate::rows::with_channels;
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
    let mut frame = Frame::new(input, optics, settings, Works::Sweeps, simd, cancel)?;
    let group = Group::of_picture(input, &frame.highlights);
    // Widening takes away texture, which moves; the noise of few samples has no mean.
    frame.footprint = Footprint::new(frame.padded.reach_px, |_| 1, |_, _| 0.0, None);
    frame.set_colors(std::slice::from_ref(&group), None);
    cancel.check()?;
    let mut sums =
        Sums::new(Size { channels: size.channels + 1, ..size }, Kept::Swept, input.scene.layers.len());
    let mut by_highlight = vec![0.0f32; frame.highlights.all.len()];
    for wave in bands(&frame).chunks(WAVE) {
        let done = wave.par_iter().map(|band| of_band(&frame, size, band, cotangent));
        for (window, lights) in done.collect::<Result<Vec<_>>>()? {
            cancel.check()?;
            sums.add(&window);
            for Light { number, by_shift, .. } in lights {
                let changes = by_shift.iter().zip(group.excess[number]);
                by_highlight[number] += changes.map(|(by_shift, excess)| by_shift * excess).sum::<f32>();
            }
        }
    }
    let n = size.pixels();
    let of_layers = input.scene.layers.iter().zip(sums.swept).enumerate();
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

/// What the tiles of a band add.
fn of_band(frame: &Frame, size: Size, band: &Band, cotangent: &[f32]) -> Result<(Window, Vec<Light>)> {
    let layers = frame.scene.layers.len();
    // The last plane of each layer is that of shifts.
    let mut window = Window::new(&frame.padded.padding, Kept::Swept, size.channels + 1, layers, band.rows());
    let (mut segments, mut lights) = (Segments::default(), Vec::new());
    let (mut views, mut around) = (Views::new(size.channels), Around::new(size.channels, layers));
    let mut given = TileColor::new(size.channels);
    for (number, tile) in (band.first_tile..).zip(band.tiles) {
        frame.cancel.check()?;
        let Work::Sweep { samples, occupied, .. } = &tile.work else { continue };
        read(size, cotangent, tile.origin, &mut given);
        highlights::adjoint(frame, number, tile, &given, &mut lights);
        frame.trace(&mut segments, tile, *samples, occupied);
        // SAFETY: the segments have just been traced there.
        unsafe { views.look(frame, &mut segments, tile.origin, &given) };
        around.take(frame, tile.origin, views.reach);
        around.find_slopes(frame);
        let samples = frame.samples(*samples);
        with_channels!(size.channels, C => {
            gather::visit(&mut views, &mut around, |gather: &mut Gather<C>, sample, view| {
                gather.add(frame.simd, view, Some(&samples[sample]));
            });
        });
        around.add_to(&mut window);
    }
    Ok((window, lights))
}
