//! How a weighted sum of the rendered picture changes with the shift of each cell.
//!
//! What one lens sample sees is a picture of its own, `V(p)`. A cell of shift `t` is drawn in it where the lens point `l`
//! moves it, `l t` away: a square of one pixel, of which a pixel shows the part that it shares. So when the cell moves,
//! light changes only at its borders with its neighbours, by the difference between both, in the pixel across which the
//! border lies. Where a surface goes on, its cells move together. Where it ends before another, its rim moves alone, and what
//! is behind it stays.
//!
//! A ray meets one cell, so the neighbours are what the rays of the neighbouring pixels meet. The border is on that side of
//! the cell on which the middle of the pixel is.

use super::bands::{Band, WAVE, bands, read};
use super::highlights::{self, Light};
use super::sweep;
use super::window::{Sums, Target, Window};
use crate::cancel::Cancel;
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::group::{Group, Input};
use crate::cpu::lens::segments::{ROWS, Segments};
use crate::cpu::lens::sweep::{Hit, Pixels, visit_tile};
use crate::cpu::lens::tile_color::TileColor;
use crate::error::Result;
use crate::memory::Buffer;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::Settings;
use crate::plan::lens::footprint::{self, Footprint};
use crate::plan::lens::lens_samples::LensSample;
use crate::plan::lens::padding::Padding;
use crate::plan::lens::tiles::{Work, Works};
use crate::scene::colors::Colors;
use crate::scene::depth_spans::{self, Cell};
use crate::scene::grid::TILE;

use crate::simd::Simd;
use rayon::prelude::*;

/// Pixels of a tile.
const PIXELS: usize = TILE.0 * TILE.1;
/// Of a pixel whose ray has met no cell.
const NONE: u32 = u32::MAX;
/// The place of a cell among those of its layer has so many bits, and its layer the others.
const PLACE_BITS: u32 = 30;

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
    let mut sums = Sums::new(Size { channels: size.channels + 1, ..size }, input.scene.layers.len());
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
        let Frame { input, footprint, s_focus, .. } = self.frame;
        let layers = &input.scene.layers;
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
    let layers = frame.input.scene.layers.len();
    // The last plane of each layer is that of shifts.
    let mut window = Window::new(&frame.padded.padding, size.channels + 1, layers, band.rows());
    let (mut segments, mut lights) = (Segments::default(), Vec::new());
    let mut views = Views::new(size.channels);
    let mut given = TileColor::new(size.channels);
    for (number, tile) in (band.first_tile..).zip(band.tiles) {
        frame.cancel.check()?;
        let Work::Sweep { samples, occupied, .. } = &tile.work else { continue };
        read(size, cotangent, tile.origin, &mut given);
        highlights::adjoint(frame, number, tile, &given, &mut lights);
        frame.trace(&mut segments, tile, *samples, occupied);
        views.clear(segments.samples());
        // SAFETY: the segments have just been traced there.
        unsafe {
            visit_tile(
                frame.simd,
                &frame.padded,
                &mut segments,
                tile.origin,
                frame.missed,
                #[inline(always)]
                |pixels, segments, hits| {
                    let met = (segments, hits);
                    sweep::give(tile.origin, &given, pixels, met, &mut window);
                    views.note(&frame.padded.padding, tile.origin, &given, pixels, met);
                },
            );
        }
        for (sample, number) in frame.samples(*samples).iter().zip(0..) {
            frame.simd.run(
                #[inline(always)]
                || views.add_changes(frame, number, sample, tile.origin, &mut window),
            );
        }
    }
    Ok((window, lights))
}

/// What every sample of a tile sees.
struct Views {
    /// The cell that each pixel of each sample meets: its place in the padded frame, and its layer.
    cells: Vec<u32>,
    /// The weight of each pixel in each channel, for one sample.
    weights: Vec<Vec<f32>>,
}

impl Views {
    fn new(channels: usize) -> Views {
        Views { cells: Vec::new(), weights: vec![vec![0.0; PIXELS]; channels] }
    }

    fn clear(&mut self, samples: usize) {
        self.cells.clear();
        self.cells.resize(samples * PIXELS, NONE);
    }

    /// Notes what the samples of some pixels of the tile at `origin` see, and the weights of these pixels.
    #[inline(always)]
    fn note(
        &mut self,
        padding: &Padding,
        origin: (usize, usize),
        cotangent: &TileColor,
        pixels: &Pixels,
        (segments, hits): (&Segments, &[Hit]),
    ) {
        let ((x, y), count) = (pixels.at, pixels.cells);
        let base = padding.index(origin.0 + x, origin.1 + y);
        for row in 0..ROWS {
            let first = (y + row) * TILE.0 + x;
            for lane in 0..count {
                let met = pixels.met(row, lane);
                let share = if met > 0.0 { 1.0 / met } else { 0.0 };
                for (weights, given) in self.weights.iter_mut().zip(&cotangent.planes) {
                    weights[first + lane] = share * given[first + lane];
                }
            }
        }
        let mut note = |number: u32, layer: u32, offset: i32, cells: [u32; ROWS]| {
            let view = &mut self.cells[segments.sample_of(number) * PIXELS..][..PIXELS];
            let start = base.wrapping_add_signed(offset as isize) as u32 | layer << PLACE_BITS;
            for row in 0..ROWS {
                let into = &mut view[(y + row) * TILE.0 + x..][..count];
                let start = start + (row * padding.stride) as u32;
                for (lane, into) in into.iter_mut().enumerate() {
                    *into = if cells[row] >> lane & 1 != 0 { start + lane as u32 } else { *into };
                }
            }
        };
        for segment in &segments.met {
            note(segment.number, segment.layer, segment.offset, [u32::MAX; ROWS]);
        }
        for hit in hits {
            note(hit.number, hit.layer, hit.offset, hit.cells);
        }
    }

    /// Adds how the sum changes with the shifts of what one sample sees.
    #[inline(always)]
    fn add_changes(
        &self,
        frame: &Frame,
        number: usize,
        sample: &LensSample,
        origin: (usize, usize),
        window: &mut Window,
    ) {
        let view = &self.cells[number * PIXELS..][..PIXELS];
        let origin = frame.padded.padding.index(origin.0, origin.1);
        let pair = Pairs { frame, sample, weights: &self.weights, origin };
        for y in 0..TILE.1 {
            let row = &view[y * TILE.0..][..TILE.0];
            pair.add(row, y * TILE.0, 1, 0, TILE.0 - 1, &row[1..], window);
            if y + 1 < TILE.1 {
                let below = &view[(y + 1) * TILE.0..][..TILE.0];
                pair.add(row, y * TILE.0, TILE.0, 1, TILE.0, below, window);
            }
        }
    }
}

/// Pairs of neighbouring pixels in the picture of one sample.
struct Pairs<'a> {
    frame: &'a Frame<'a>,
    sample: &'a LensSample,
    weights: &'a [Vec<f32>],
    /// The place of the tile's first pixel in the padded frame.
    origin: usize,
}

impl Pairs<'_> {
    /// Adds what the shifts of the cells of `n` pixels, from number `first` of the tile on, and of their neighbours, which
    /// are `apart` pixels further on along an axis, change.
    #[expect(clippy::too_many_arguments, reason = "two rows of pixels, and where they are")]
    #[inline(always)]
    fn add(
        &self,
        own: &[u32],
        first: usize,
        apart: usize,
        axis: usize,
        n: usize,
        next: &[u32],
        window: &mut Window,
    ) {
        let mut start = 0;
        while start < n {
            let (a, b) = (own[start], next[start]);
            let mut end = start + 1;
            if a == NONE || b == NONE || a == b {
                start = end;
                continue;
            }
            // Cells beside each other, as far as pixels beside each other have met such.
            while end < n
                && own[end] == a.wrapping_add((end - start) as u32)
                && next[end] == b.wrapping_add((end - start) as u32)
            {
                end += 1;
            }
            self.add_run((a, b), first + start, apart, axis, end - start, window);
            start = end;
        }
    }

    #[inline(always)]
    fn add_run(
        &self,
        (a, b): (u32, u32),
        pixel: usize,
        apart: usize,
        axis: usize,
        n: usize,
        window: &mut Window,
    ) {
        const PLACE: u32 = (1 << PLACE_BITS) - 1;
        let padded = &self.frame.padded;
        let focus = padded.codes.place(self.frame.s_focus).clamp(0.0, f64::from(u16::MAX)) as u16;
        let place = |cell: u32| ((cell & PLACE) as usize, (cell >> PLACE_BITS) as usize);
        let ((at_a, layer_a), (at_b, layer_b)) = (place(a), place(b));
        let (of_a, of_b) = (&padded.layers[layer_a], &padded.layers[layer_b]);
        let mut dot = [[0.0f32; TILE.0]; 2];
        for (c, weights) in self.weights.iter().enumerate() {
            let (color_a, color_b) = (&of_a.color[c][at_a..][..n], &of_b.color[c][at_b..][..n]);
            let (weights_a, weights_b) = (&weights[pixel..][..n], &weights[pixel + apart..][..n]);
            let [dot_a, dot_b] = &mut dot;
            for i in 0..n {
                let difference = color_b[i] - color_a[i];
                dot_a[i] += weights_a[i] * difference;
                dot_b[i] += weights_b[i] * difference;
            }
        }
        let lens = [self.sample.behind[axis] as f32, self.sample.in_front[axis] as f32];
        let (lo_a, hi_a) = (&of_a.lo[at_a..][..n], &of_a.hi[at_a..][..n]);
        let (lo_b, hi_b) = (&of_b.lo[at_b..][..n], &of_b.hi[at_b..][..n]);
        let step = padded.codes.step() as f32;
        let t_at_0 = (padded.codes.decode(0.0) - self.frame.s_focus) as f32;
        let [away_a, away_b] = [self.away(at_a, pixel, axis), self.away(at_b, pixel + apart, axis)];
        // Beside a tile's first and last pixels there is a neighbour on one side only, which stands for both.
        let last = [TILE.0, TILE.1][axis] - 2;
        // A surface that is seen from the side may show every other cell only, or fewer. It rises by a cell's span from cell to
        // cell.
        let between = (self.cells_apart(at_a, at_b) - 1).max(0) as u32;
        // Pairs of pixels in two tiles are not looked at; the others stand for them.
        let unseen = [TILE.0, TILE.1][axis] as f32 / (last + 1) as f32;
        for i in 0..n {
            let x = if axis == 0 { pixel % TILE.0 + i } else { pixel / TILE.0 };
            let t = |lo: u16, hi: u16| t_at_0 + step * 0.5 * (f32::from(lo) + f32::from(hi));
            let of = |lo: u16| lens[usize::from(lo > focus)];
            let (lens_a, lens_b) = (of(lo_a[i]), of(lo_b[i]));
            // How far the middles of the pixels are beyond those of their cells.
            let beyond_a = lens_a * t(lo_a[i], hi_a[i]) - away_a;
            let beyond_b = lens_b * t(lo_b[i], hi_b[i]) - away_b;
            let span = u32::from((hi_a[i] - lo_a[i]).max(hi_b[i] - lo_b[i]));
            let reach = |hi: u16| u32::from(hi) + between * span + 1;
            let one_surface = u32::from(lo_a[i]) <= reach(hi_b[i]) && u32::from(lo_b[i]) <= reach(hi_a[i]);
            let [of_a, of_b] = if one_surface {
                let a = if beyond_a > 0.0 || x == 0 { dot[0][i] } else { 0.0 };
                let b = if beyond_b < 0.0 || x == last { dot[1][i] } else { 0.0 };
                [a, b]
            } else if hi_a[i] > hi_b[i] {
                [unseen * if beyond_a > 0.0 { dot[0][i] } else { dot[1][i] }, 0.0]
            } else {
                [0.0, unseen * if beyond_b < 0.0 { dot[1][i] } else { dot[0][i] }]
            };
            dot[0][i] = of_a * lens_a;
            dot[1][i] = of_b * lens_b;
        }
        for ((at, layer), changes) in [(at_a, layer_a), (at_b, layer_b)].into_iter().zip(&dot) {
            let first = at - window.first_cell();
            let into = &mut window.planes(Target::Swept(layer))[self.weights.len()][first..][..n];
            into.iter_mut().zip(changes).for_each(|(into, change)| *into += change);
        }
    }

    /// How many columns or rows two cells are apart.
    fn cells_apart(&self, a: usize, b: usize) -> isize {
        let stride = self.frame.padded.padding.stride as isize;
        let apart = b as isize - a as isize;
        let down = (apart + stride / 2).div_euclid(stride);
        (apart - down * stride).abs().max(down.abs())
    }

    /// How many pixels along an axis a cell is from a pixel of the tile.
    fn away(&self, cell: usize, pixel: usize, axis: usize) -> f32 {
        let stride = self.frame.padded.padding.stride as isize;
        let own = self.origin + pixel / TILE.0 * stride as usize + pixel % TILE.0;
        let apart = cell as isize - own as isize;
        let down = (apart + stride / 2).div_euclid(stride);
        [apart - down * stride, down][axis] as f32
    }
}
