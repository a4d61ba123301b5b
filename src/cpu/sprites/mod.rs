//! Carries out [`plan::sprites`](crate::plan::sprites).

mod list;
mod surroundings;
mod targets;

use super::enlarge::Enlarge;
use super::rows::{render_rows, with_channels};
use super::simd::Simd;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::sprites::Settings;
use list::{List, Point};
use surroundings::Surroundings;
use targets::{Depth, Targets};

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
    let list = List::new(layer, size, optics, settings, cancel)?;
    with_channels!(size.channels, C => {
        let targets = Targets::new::<C>(&list, layer, size, simd, cancel)?;
        let scratch = || Scratch::<C>::new(simd, &targets, size.width);
        // What is not in front first, for it also shows past the edges of what is.
        render_rows(out, size, cancel, scratch, |scratch, y, out| {
            let row = |plane: usize| &layer.color[plane * size.pixels() + y * size.width..][..size.width];
            simd.run(
                #[inline(always)]
                || interleave::<C>(std::array::from_fn(row), out),
            );
            scratch.show_behind(y, &list.rows[y], out);
        })?;
        if list.any_in_front() {
            let surroundings = Surroundings::<C>::new(out, size, &list, simd, cancel)?;
            render_rows(out, size, cancel, scratch, |scratch, y, out| {
                scratch.lay_in_front(y, &list.rows[y], &surroundings, out);
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

    /// Part of the light of pixel `at`.
    #[inline(always)]
    fn of(layer: &Layer, size: Size, at: usize, part: f32) -> Self {
        let mut light = Light { color: [0.0; C], coverage: part };
        for c in 0..C {
            light.color[c] = part * layer.color[c * size.pixels() + at];
        }
        light
    }
}

/// What a pixel in focus becomes of which the part `drawn` lies behind, where it shows the mean of the light from there.
#[inline(always)]
fn behind<const C: usize>(sharp: [f32; C], drawn: f32, light: Light<C>) -> [f32; C] {
    if light.coverage == 0.0 {
        return sharp;
    }
    std::array::from_fn(|c| sharp[c] + drawn * (light.color[c] / light.coverage - sharp[c]))
}

/// How often the light in front covers a pixel, at least once: sprites of several depths count as one.
#[inline(always)]
fn excess(coverage: f32) -> f32 {
    if coverage > 1.0 { coverage } else { 1.0 }
}

/// What a pixel under the light in front becomes of which the part `drawn` lies there itself: that is as opaque as it
/// is there, and lets past what is `seen` around it.
#[inline(always)]
fn in_front<const C: usize>(over: [f32; C], drawn: f32, light: Light<C>, seen: Light<C>) -> [f32; C] {
    let total = light.coverage + seen.coverage;
    std::array::from_fn(|c| over[c] + drawn * ((light.color[c] + seen.color[c]) / total - over[c]))
}

/// Rows of one layer at full size.
struct Scratch<'a, const C: usize> {
    simd: Simd,
    targets: &'a Targets,
    enlarge: Enlarge,
    /// Colours times coverage, and coverage.
    light: Vec<Vec<f32>>,
    /// What is laid over the rest of the picture: colours, and how much of the rest is shown.
    laid: Vec<Vec<f32>>,
}

impl<'a, const C: usize> Scratch<'a, C> {
    fn new(simd: Simd, targets: &'a Targets, width: usize) -> Self {
        let enlarge = Enlarge::new(2, targets.width);
        let light = vec![enlarge.new_row(); C + 1];
        Scratch { simd, targets, enlarge, light, laid: vec![vec![0.0; width]; C + 1] }
    }

    /// Puts the light of those points of row `y` that lie behind into their pixels.
    fn show_behind(&mut self, y: usize, points: &[Point], out: &mut [f32]) {
        let mut points = points.iter().filter(|point| !point.is_in_front()).peekable();
        if points.peek().is_none() {
            return;
        }
        self.enlarge(y, Depth::Behind);
        let pixels = out.as_chunks_mut::<C>().0;
        for point in points {
            let x = point.column as usize;
            pixels[x] = behind(pixels[x], point.drawn, self.light(x));
        }
    }

    /// Lays the light in front over row `y`.
    fn lay_in_front(&mut self, y: usize, points: &[Point], surroundings: &Surroundings<C>, out: &mut [f32]) {
        let Scratch { targets, .. } = self;
        let rows = self.enlarge.rows(y, targets.height);
        if rows.iter().all(|&row| targets.row(Depth::InFront, C, row).iter().all(|v| *v == 0.0)) {
            return;
        }
        self.enlarge(y, Depth::InFront);
        let first = self.enlarge.first();
        self.simd.run(
            #[inline(always)]
            || {
                let (laid, shown) = self.laid.split_at_mut(C);
                let coverage = &self.light[C][first..];
                for (shown, &coverage) in shown[0].iter_mut().zip(coverage) {
                    *shown = 1.0 - coverage / excess(coverage);
                }
                for (laid, light) in laid.iter_mut().zip(&self.light) {
                    for ((laid, light), &coverage) in laid.iter_mut().zip(&light[first..]).zip(coverage) {
                        *laid = light / excess(coverage);
                    }
                }
                lay::<C>(std::array::from_fn(|c| &laid[c][..]), &shown[0], out);
            },
        );
        let pixels = out.as_chunks_mut::<C>().0;
        for point in points.iter().filter(|point| point.is_in_front()) {
            let x = point.column as usize;
            let light = self.light(x);
            if light.coverage > 0.0 {
                let seen = surroundings.around(x, y, -point.coc_px);
                pixels[x] = in_front(pixels[x], point.drawn, light, seen);
            }
        }
    }

    /// Interpolates a layer at the pixels of the picture's row `y`.
    fn enlarge(&mut self, y: usize, depth: Depth) {
        let rows = self.enlarge.rows(y, self.targets.height);
        for (plane, out) in self.light.iter_mut().enumerate() {
            self.enlarge.row(self.simd, y, rows.map(|row| self.targets.row(depth, plane, row)), out);
        }
    }

    /// The light at column `x`.
    #[inline(always)]
    fn light(&self, x: usize) -> Light<C> {
        let at = self.enlarge.first() + x;
        Light { color: std::array::from_fn(|c| self.light[c][at]), coverage: self.light[C][at] }
    }
}

/// Puts a row of planes into an interleaved row.
#[inline(always)]
fn interleave<const C: usize>(planes: [&[f32]; C], out: &mut [f32]) {
    for c in 0..C {
        for (pixel, v) in out.as_chunks_mut::<C>().0.iter_mut().zip(planes[c]) {
            pixel[c] = *v;
        }
    }
}

/// Lays colours over an interleaved row, of which some is still `shown`.
#[inline(always)]
fn lay<const C: usize>(laid: [&[f32]; C], shown: &[f32], out: &mut [f32]) {
    for c in 0..C {
        for ((pixel, laid), shown) in out.as_chunks_mut::<C>().0.iter_mut().zip(laid[c]).zip(shown) {
            pixel[c] = laid + shown * pixel[c];
        }
    }
}
