//! Highlights, drawn as exact discs of which a part is visible.

use crate::cancel::Cancel;
use crate::cpu::tiles::Tile;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::disc::APART;
use crate::plan::lens::highlights::{
    Highlight, Highlights, OWN_WEIGHT, WINDOW, neighbour_weight, visible_part,
};
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::rows::bands;
use crate::scene::layer::SceneLayer;
use rayon::prelude::*;

/// Rows of the frame that are drawn together.
const BAND: usize = 16;
/// The largest number of channels that hold light.
const MOST_LIGHTS: usize = 3;

/// The light of all highlights at every pixel, as if nothing stood before them.
pub struct Discs {
    size: Size,
    planes: Buffer<f32>,
}

/// The input for drawing highlights.
pub struct Drawing<'a> {
    pub highlights: &'a Highlights,
    pub kernels: &'a Kernels,
    pub clip: Option<&'a PupilClip>,
    pub cancel: &'a Cancel,
}

impl Discs {
    /// Draws all discs into the channels of `size`; `None` if there are none.
    pub fn new(drawing: &Drawing, size: Size) -> Result<Option<Discs>> {
        if drawing.highlights.all.is_empty() {
            return Ok(None);
        }
        let mut planes = Buffer::unset(size.pixels() * size.channels);
        let bands = bands(planes.chunks_mut(size.pixels()), BAND * size.width);
        bands.into_par_iter().enumerate().try_for_each_init(
            Differences::default,
            |differences, (i, mut out)| {
                drawing.cancel.check()?;
                differences.clear(size, out[0].len() / size.width);
                for highlight in &drawing.highlights.all {
                    drawing.add(highlight, (i * BAND) as i32, differences);
                }
                differences.sum_up(&mut out);
                Ok(())
            },
        )?;
        Ok(Some(Discs { size, planes }))
    }

    /// The light of channel `c` in a row of the frame.
    fn row(&self, c: usize, y: usize) -> &[f32] {
        &self.planes[c * self.size.pixels() + y * self.size.width..][..self.size.width]
    }
}

/// How much of the light is visible at every pixel.
pub struct Visibility<'a> {
    /// The frame, with one channel for each channel of light.
    size: Size,
    /// For each pixel the channels of the light that is met, then those of the light that would be met.
    lights: Buffer<f32>,
    /// The shifts of the first layer, and those of the second.
    front: &'a [f32],
    back: Option<&'a [f32]>,
    /// The part of each pixel that the first layer covers.
    coverage: Buffer<f32>,
}

impl<'a> Visibility<'a> {
    /// Nothing is known of any pixel.
    pub fn new(size: Size, layers: &'a [SceneLayer]) -> Visibility<'a> {
        let mut coverage = Buffer::full(size.pixels(), 1.0);
        layers[0].partial.iter().for_each(|(index, plane)| coverage[*index] = plane.area);
        Visibility {
            size,
            lights: Buffer::full(2 * size.channels * size.pixels(), 0.0),
            front: &layers[0].s,
            back: layers.get(1).map(|layer| &**layer.s),
            coverage,
        }
    }

    /// The size of the light that is met as an interleaved picture, and that picture.
    pub fn lights(&mut self) -> (Size, &mut [f32]) {
        (Size { channels: 2 * self.size.channels, ..self.size }, &mut self.lights)
    }

    /// The part of each channel's light that is visible at a pixel. Where the pixel shows two surfaces, it is as much
    /// as beside the edge, on either side.
    fn at(&self, x: usize, y: usize) -> [f32; MOST_LIGHTS] {
        let pixel = y * self.size.width + x;
        let front = self.beside(x, y, self.front[pixel]);
        let covered = self.coverage[pixel];
        match self.back.map(|back| back[pixel]).filter(|s| covered < 1.0 && !s.is_nan()) {
            None => front,
            Some(s) => {
                let back = self.beside(x, y, s);
                std::array::from_fn(|c| back[c] + covered * (front[c] - back[c]))
            }
        }
    }

    /// The visible part around a pixel, as the pixels see it that show only a surface of shift `s`.
    fn beside(&self, x: usize, y: usize, s: f32) -> [f32; MOST_LIGHTS] {
        let Size { width, height, channels } = self.size;
        let around = |v: usize, n: usize| v.saturating_sub(WINDOW)..(v + WINDOW + 1).min(n);
        let (mut met, mut all) = ([0.0; MOST_LIGHTS], [0.0; MOST_LIGHTS]);
        let mut add = |pixel: usize, weight: f32| {
            let light = &self.lights[2 * channels * pixel..][..2 * channels];
            for c in 0..channels {
                met[c] += weight * light[c];
                all[c] += weight * light[channels + c];
            }
        };
        for j in around(y, height) {
            for i in around(x, width).filter(|i| self.coverage[j * width + i] >= 1.0) {
                let pixel = j * width + i;
                let offset = [i as i32 - x as i32, j as i32 - y as i32];
                add(pixel, neighbour_weight(offset, (self.front[pixel] - s).abs()));
            }
        }
        add(y * width + x, OWN_WEIGHT);
        std::array::from_fn(|c| visible_part(met[c], all[c]))
    }
}

/// Adds the light of all highlights to a tile of the picture, or the part of it that is visible.
pub fn add(discs: &Discs, visibility: Option<&Visibility>, out: &mut Tile, channels: usize) {
    for (y, row) in (out.origin.1..).zip(&mut out.rows) {
        let light: [&[f32]; MOST_LIGHTS] =
            std::array::from_fn(|c| if c < discs.size.channels { discs.row(c, y) } else { &[] });
        for (x, pixel) in (out.origin.0..).zip(row.chunks_exact_mut(channels)) {
            let light: [f32; MOST_LIGHTS] = light.map(|row| row.get(x).copied().unwrap_or(0.0));
            if light == [0.0; MOST_LIGHTS] {
                continue;
            }
            let visible = visibility.map_or([1.0; MOST_LIGHTS], |visibility| visibility.at(x, y));
            for (c, out) in pixel.iter_mut().take(discs.size.channels).enumerate() {
                *out += visible[c] * light[c];
            }
        }
    }
}

/// Some rows of the frame as differences between neighbouring pixels, so that a run of pixels is two numbers. Sums of
/// many lights that begin and end elsewhere need `f64`.
#[derive(Default)]
struct Differences {
    channels: usize,
    width: usize,
    rows: usize,
    /// For each channel and row, one more value than there are columns.
    values: Vec<f64>,
}

impl Differences {
    fn clear(&mut self, size: Size, rows: usize) {
        (self.channels, self.width, self.rows) = (size.channels, size.width, rows);
        self.values.clear();
        self.values.resize(self.channels * rows * (self.width + 1), 0.0);
    }

    /// Adds light to the columns `first .. end` of a row.
    fn add(&mut self, y: usize, (first, end): (i32, i32), weight: f64, light: &[f32; 4]) {
        let inside = |x: i32| x.clamp(0, self.width as i32) as usize;
        let (first, end) = (inside(first), inside(end));
        if first < end {
            for c in 0..self.channels {
                let row = (c * self.rows + y) * (self.width + 1);
                let added = weight * f64::from(light[c]);
                self.values[row + first] += added;
                self.values[row + end] -= added;
            }
        }
    }

    fn sum_up(&self, out: &mut [&mut [f32]]) {
        let rows = out.iter_mut().flat_map(|plane| plane.chunks_mut(self.width));
        for (row, differences) in rows.zip(self.values.chunks(self.width + 1)) {
            let mut sum = 0.0;
            for (out, difference) in row.iter_mut().zip(differences) {
                sum += difference;
                *out = sum as f32;
            }
        }
    }
}

impl Drawing<'_> {
    /// Adds the rows of a highlight's disc from row `first_y` of the frame on.
    fn add(&self, highlight: &Highlight, first_y: i32, differences: &mut Differences) {
        let reach = highlight.reach();
        let rows = first_y..first_y + differences.rows as i32;
        if highlight.y + reach < rows.start || highlight.y - reach >= rows.end {
            return;
        }
        for (step, share) in highlight.discs() {
            let kernel = self.kernels.get(step * APART);
            // A pixel p sees the highlight q at the offset q - p of the kernel. Rows are in the order of dy.
            let first = kernel.rows.partition_point(|row| highlight.y - row.dy >= rows.end);
            for row in kernel.rows[first..].iter().take_while(|row| highlight.y - row.dy >= rows.start) {
                let y = highlight.y - row.dy;
                let mut add = |columns: (i32, i32), weight: f32| {
                    let weight = f64::from(share) * f64::from(weight);
                    let place = (y - rows.start) as usize;
                    match self.clip {
                        None => differences.add(place, columns, weight, &highlight.excess),
                        Some(clip) => {
                            for x in columns.0..columns.1 {
                                let l = [highlight.x - x, row.dy].map(|d| f64::from(d) / highlight.t);
                                let seen = clip.share([f64::from(x), f64::from(y)], l, highlight.t);
                                differences.add(place, (x, x + 1), weight * seen, &highlight.excess);
                            }
                        }
                    }
                };
                add((highlight.x - row.run.1 + 1, highlight.x - row.run.0 + 1), kernel.run_weight);
                for &(dx, weight) in &row.partial {
                    add((highlight.x - dx, highlight.x - dx + 1), weight);
                }
            }
        }
    }
}
