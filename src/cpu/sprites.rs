//! Carries out [`plan::sprites`](crate::plan::sprites).

use super::border::mirrored;
use super::enlarge::Enlarge;
use super::rows::{render_rows, with_channels};
use super::simd::Simd;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::sprites::{LANES, Settings, Sprite, step};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Rows of the targets that one worker fills at a time.
const BAND: usize = 16;

/// The picture, interleaved.
pub fn render(
    layer: &Layer,
    size: Size,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
    out: &mut [f32],
) -> Result<()> {
    let coc = |d: f32| settings.cut(-optics.shift_px(f64::from(d)));
    let list = List::new(layer, size, settings, coc, cancel)?;
    with_channels!(size.channels, C => {
        let targets = accumulate::<C>(&list, layer, size, simd, cancel)?;
        let scratch = || Scratch::new::<C>(targets.width);
        // What is not in front first, for it also shows past the edges of what is.
        render_rows(out, size, cancel, scratch, |scratch, y, out| {
            if list.any_behind() {
                scratch.enlarge(simd, y, &targets, Depth::Behind);
            }
            let from = y * size.width;
            let disparity = &layer.disparity[from..][..size.width];
            for (x, (pixel, &d)) in out.chunks_exact_mut(C).zip(disparity).enumerate() {
                let sharp = std::array::from_fn(|c| layer.color[c * size.pixels() + from + x]);
                let coc = coc(d);
                let drawn = if coc > 0.0 { settings.drawn(coc) } else { 0.0 };
                pixel.copy_from_slice(&behind(sharp, drawn, || scratch.light::<C>(x)));
            }
        })?;
        if list.any_in_front() {
            let drawn = |i: usize| {
                let coc = coc(layer.disparity[i]);
                if coc < 0.0 { (settings.drawn(coc), -coc) } else { (0.0, 0.0) }
            };
            let surroundings = Surroundings::<C>::new(out, size, |i| 1.0 - drawn(i).0);
            let rows = out.par_chunks_mut(size.width * C).enumerate();
            rows.try_for_each_init(scratch, |scratch, (y, row)| {
                cancel.check()?;
                scratch.enlarge(simd, y, &targets, Depth::InFront);
                for (x, pixel) in row.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                    let light = scratch.light::<C>(x);
                    if light.coverage > 0.0 {
                        let (drawn, radius) = drawn(y * size.width + x);
                        *pixel = in_front(*pixel, drawn, light, || surroundings.around(x, y, radius));
                    }
                }
                Ok(())
            })?;
        }
        Ok(())
    })
}

/// Light over a pixel: colour times coverage, and coverage.
#[derive(Debug, Clone, Copy)]
struct Light<const C: usize> {
    color: [f32; C],
    coverage: f32,
}

impl<const C: usize> Light<C> {
    const NONE: Self = Light { color: [0.0; C], coverage: 0.0 };
}

/// The layers that sprites are drawn into, in the order of their planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Depth {
    InFront,
    Behind,
}

/// A pixel of which the part `drawn` lies behind, where it shows the mean of the light from there.
#[inline(always)]
fn behind<const C: usize>(sharp: [f32; C], drawn: f32, light: impl Fn() -> Light<C>) -> [f32; C] {
    if drawn == 0.0 {
        return sharp;
    }
    let light = light();
    if light.coverage == 0.0 {
        return sharp;
    }
    std::array::from_fn(|c| sharp[c] + drawn * (light.color[c] / light.coverage - sharp[c]))
}

/// The light in front over a pixel, of which the part `drawn` lies there itself: that is as opaque as it is there, and
/// lets past what is `seen` around it.
#[inline(always)]
fn in_front<const C: usize>(
    rest: [f32; C],
    drawn: f32,
    light: Light<C>,
    seen: impl Fn() -> Light<C>,
) -> [f32; C] {
    // Sprites of several depths cover a pixel once.
    let excess = if light.coverage > 1.0 { light.coverage } else { 1.0 };
    let shown = 1.0 - light.coverage / excess;
    let over = std::array::from_fn(|c| light.color[c] / excess + shown * rest[c]);
    if drawn == 0.0 {
        return over;
    }
    let seen = seen();
    let total = light.coverage + seen.coverage;
    std::array::from_fn(|c| over[c] + drawn * ((light.color[c] + seen.color[c]) / total - over[c]))
}

/// A pixel to be drawn.
#[derive(Debug, Clone, Copy)]
struct Point {
    column: u32,
    step: i32,
    drawn: f32,
}

/// The pixels to be drawn, row by row in scan order, and what they are drawn as.
struct List {
    rows: Vec<Vec<Point>>,
    /// The lowest step, which is negative if anything is in front, and the sprites of all steps from there.
    lowest: i32,
    sprites: Vec<Option<[Sprite; 4]>>,
    /// Pixels of the picture that the largest sprite reaches.
    reach: usize,
}

impl List {
    fn new(
        layer: &Layer,
        size: Size,
        settings: &Settings,
        coc: impl Fn(f32) -> f32 + Sync,
        cancel: &Cancel,
    ) -> Result<List> {
        let point = |(column, &d): (usize, &f32)| {
            let coc = coc(d);
            let drawn = settings.drawn(coc);
            (drawn > 0.0).then(|| Point { column: column as u32, step: step(coc), drawn })
        };
        let rows: Vec<Vec<Point>> = layer
            .disparity
            .par_chunks(size.width)
            .map(|row| row.iter().enumerate().filter_map(point).collect())
            .collect();
        let steps_of = |row: &Vec<Point>| -> BTreeSet<i32> {
            row.chunk_by(|a, b| a.step == b.step).map(|run| run[0].step).collect()
        };
        let steps = rows.par_iter().map(steps_of).reduce(BTreeSet::new, |a, b| &a | &b);
        let (lowest, highest) = (steps.first().copied().unwrap_or(0), steps.last().copied().unwrap_or(0));
        let sprites: Vec<Option<[Sprite; 4]>> = (lowest..=highest)
            .into_par_iter()
            .map(|step| {
                cancel.check()?;
                Ok(steps.contains(&step).then(|| settings.sprites(step)))
            })
            .collect::<Result<_>>()?;
        let reach_of = |s: &Sprite| {
            let (right, bottom) = (s.left + s.across as i32, s.top + s.down() as i32);
            2 * (1 - s.left).max(1 - s.top).max(right).max(bottom)
        };
        let reach = sprites.iter().flatten().flatten().map(reach_of).max().unwrap_or(0) as usize;
        Ok(List { rows, lowest, sprites, reach })
    }

    fn any_in_front(&self) -> bool {
        self.lowest < 0
    }

    fn any_behind(&self) -> bool {
        self.lowest + self.sprites.len() as i32 > 1
    }

    /// The sprite of a point that lies at `(x, y)`, or is mirrored there.
    fn sprite(&self, point: &Point, (x, y): (i64, i64)) -> &Sprite {
        let sprites = self.sprites[(point.step - self.lowest) as usize].as_ref();
        &sprites.expect("made for every step on the list")[(2 * (y & 1) + (x & 1)) as usize]
    }
}

/// The layers in front and behind at half the size.
struct Targets {
    /// Columns, and rows.
    width: usize,
    height: usize,
    /// Row by row: of the layer in front the planes of colour times coverage and that of coverage, then of the layer
    /// behind.
    values: Vec<f32>,
}

/// Planes of both layers.
const fn planes(channels: usize) -> usize {
    2 * (channels + 1)
}

/// Draws the whole list, and its mirror image beyond the border.
fn accumulate<const C: usize>(
    list: &List,
    layer: &Layer,
    size: Size,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Targets> {
    let (width, height) = (size.width.div_ceil(2), size.height.div_ceil(2));
    let length = planes(C) * width;
    let mut values = vec![0.0f32; height * length];
    let (reach, period) = (list.reach as i64, 2 * size.width as i64);
    let periods = reach / period + 1;
    values.par_chunks_mut(BAND * length).enumerate().try_for_each_init(
        || Band::new::<C>(width, list.reach),
        |band, (i, out)| {
            cancel.check()?;
            band.begin(i * BAND, out.len() / length);
            let (first, end) = (2 * band.first as i64, 2 * (band.first + band.rows) as i64);
            for y in first - reach..end + reach {
                cancel.check()?;
                let row = mirrored(y, size.height).0;
                for point in &list.rows[row] {
                    let at = row * size.width + point.column as usize;
                    let color: [f32; C] =
                        std::array::from_fn(|c| point.drawn * layer.color[c * size.pixels() + at]);
                    let light = Light { color, coverage: point.drawn };
                    let depth = if point.step < 0 { Depth::InFront } else { Depth::Behind };
                    let column = i64::from(point.column);
                    let images =
                        (-periods..=periods).flat_map(|k| [column, -1 - column].map(|x| x + k * period));
                    for x in images.filter(|x| (-reach..size.width as i64 + reach).contains(x)) {
                        simd.run(
                            #[inline(always)]
                            || draw(band, depth, list.sprite(point, (x, y)), (x >> 1, y >> 1), &light),
                        );
                    }
                }
            }
            band.store(out, width);
            Ok(())
        },
    )?;
    Ok(Targets { width, height, values })
}

/// Some rows of the targets, with columns on either side for what hangs over.
struct Band {
    /// The first row in the targets, and the number of rows.
    first: usize,
    rows: usize,
    margin: usize,
    stride: usize,
    /// Planes of both layers.
    planes: Vec<Vec<f32>>,
}

impl Band {
    fn new<const C: usize>(width: usize, reach: usize) -> Band {
        // A sprite drawn outside begins and ends within its reach.
        let margin = reach + LANES;
        let stride = width + 2 * margin;
        Band { first: 0, rows: 0, margin, stride, planes: vec![vec![0.0; BAND * stride]; planes(C)] }
    }

    fn begin(&mut self, first: usize, rows: usize) {
        (self.first, self.rows) = (first, rows);
        self.planes.iter_mut().for_each(|plane| plane.fill(0.0));
    }

    /// Puts the rows into the targets.
    fn store(&self, out: &mut [f32], width: usize) {
        let planes = self.planes.len();
        for (i, out) in out.chunks_exact_mut(width).enumerate() {
            let (y, plane) = (i / planes, i % planes);
            out.copy_from_slice(&self.planes[plane][y * self.stride + self.margin..][..width]);
        }
    }
}

/// Adds a sprite at pixel `(x, y)` of the targets.
#[inline(always)]
fn draw<const C: usize>(band: &mut Band, depth: Depth, sprite: &Sprite, at: (i64, i64), light: &Light<C>) {
    let top = at.1 + i64::from(sprite.top) - band.first as i64;
    let left = (at.0 + i64::from(sprite.left) + band.margin as i64) as usize;
    let first = (-top).max(0);
    for row in first..(sprite.down() as i64).min(band.rows as i64 - top) {
        let weights = &sprite.weights[row as usize * sprite.across..][..sprite.across];
        let to = (top + row) as usize * band.stride + left;
        let planes = &mut band.planes[depth as usize * (C + 1)..];
        for c in 0..=C {
            let value = if c < C { light.color[c] } else { light.coverage };
            let sums = &mut planes[c][to..][..sprite.across];
            let (sums, weights) = (sums.as_chunks_mut::<LANES>().0, weights.as_chunks::<LANES>().0);
            for (sums, weights) in sums.iter_mut().zip(weights) {
                for i in 0..LANES {
                    sums[i] += value * weights[i];
                }
            }
        }
    }
}

/// A row of one layer at full size.
struct Scratch {
    enlarge: Enlarge,
    planes: Vec<Vec<f32>>,
}

impl Scratch {
    fn new<const C: usize>(width: usize) -> Scratch {
        let enlarge = Enlarge::new(2, width);
        let planes = vec![enlarge.new_row(); C + 1];
        Scratch { enlarge, planes }
    }

    /// Interpolates a layer at the pixels of the picture's row `y`.
    fn enlarge(&mut self, simd: Simd, y: usize, targets: &Targets, depth: Depth) {
        let rows = self.enlarge.rows(y, targets.height);
        let of_layer = self.planes.len();
        for (plane, out) in self.planes.iter_mut().enumerate() {
            let rows = rows.map(|row| {
                let plane = (2 * row + depth as usize) * of_layer + plane;
                &targets.values[plane * targets.width..][..targets.width]
            });
            self.enlarge.row(simd, y, rows, out);
        }
    }

    /// The light at column `x`.
    #[inline(always)]
    fn light<const C: usize>(&self, x: usize) -> Light<C> {
        let at = self.enlarge.first() + x;
        Light { color: std::array::from_fn(|c| self.planes[c][at]), coverage: self.planes[C][at] }
    }
}

/// What is not in front, as sums over rectangles from the first pixel on: colours, and pixels.
struct Surroundings<const C: usize> {
    size: Size,
    /// Corners of pixels, one more than there are pixels along each axis. `f64`, so that a bright pixel does not
    /// drown what lies behind it.
    sums: Vec<([f64; C], f64)>,
}

impl<const C: usize> Surroundings<C> {
    /// Sums of an interleaved picture, of whose pixel `i` the part `rest(i)` counts.
    fn new(picture: &[f32], size: Size, rest: impl Fn(usize) -> f32 + Sync) -> Self {
        let across = size.width + 1;
        let mut sums = vec![([0.0f64; C], 0.0f64); across * (size.height + 1)];
        // Along the rows, then down the columns.
        sums[across..].par_chunks_mut(across).enumerate().for_each(|(y, sums)| {
            let mut sum = ([0.0; C], 0.0);
            for (x, out) in sums[1..].iter_mut().enumerate() {
                let i = y * size.width + x;
                let rest = f64::from(rest(i));
                for c in 0..C {
                    sum.0[c] += rest * f64::from(picture[i * C + c]);
                }
                sum.1 += rest;
                *out = sum;
            }
        });
        for y in 1..size.height {
            let (above, row) = sums[y * across..].split_at_mut(across);
            for (sum, above) in row.iter_mut().zip(&*above) {
                for c in 0..C {
                    sum.0[c] += above.0[c];
                }
                sum.1 += above.1;
            }
        }
        Surroundings { size, sums }
    }

    /// The mean over the square around pixel `(x, y)` that is as large as a disc: what is seen, and how much of it.
    fn around(&self, x: usize, y: usize, radius: f32) -> Light<C> {
        let half = f64::from(radius) * std::f64::consts::PI.sqrt() / 2.0;
        let ends = |at: usize, n: usize| {
            let centre = at as f64 + 0.5;
            [(centre - half).max(0.0), (centre + half).min(n as f64)]
        };
        let (xs, ys) = (ends(x, self.size.width), ends(y, self.size.height));
        let area = (xs[1] - xs[0]) * (ys[1] - ys[0]);
        let mut light = Light::NONE;
        let mut sum = ([0.0; C], 0.0);
        for (sign, x, y) in
            [(1.0, xs[1], ys[1]), (-1.0, xs[0], ys[1]), (-1.0, xs[1], ys[0]), (1.0, xs[0], ys[0])]
        {
            self.add_up_to(x, y, sign / area, &mut sum);
        }
        // Differences of sums leave a rounding error where nothing is seen.
        if sum.1 > 1e-9 {
            light.coverage = sum.1 as f32;
            light.color = sum.0.map(|v| v as f32);
        }
        light
    }

    /// Adds the sum up to a point between the corners of pixels.
    fn add_up_to(&self, x: f64, y: f64, weight: f64, sum: &mut ([f64; C], f64)) {
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        for (down, wy) in [(0, 1.0 - fy), (1, fy)] {
            for (right, wx) in [(0, 1.0 - fx), (1, fx)] {
                let w = weight * wx * wy;
                // At the last corner there is no next one, and its weight is 0.
                let corner = (row + down).min(self.size.height) * (self.size.width + 1)
                    + (column + right).min(self.size.width);
                for c in 0..C {
                    sum.0[c] += w * self.sums[corner].0[c];
                }
                sum.1 += w * self.sums[corner].1;
            }
        }
    }
}
