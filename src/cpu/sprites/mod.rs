//! Carries out [`plan::sprites`](crate::plan::sprites).

mod light;
mod list;
mod stamp;
mod surroundings;
mod target;

use crate::cpu::job::Job;
use crate::error::Result;
use crate::plan::sprites::Settings;
use crate::rows::{interleave, render_rows, with_channels};
use light::Light;
use list::{List, Point};
use surroundings::Surroundings;
use target::{Target, light_at};

/// Renders the picture, interleaved, into `out`.
pub fn render(job: &Job, settings: &Settings, out: &mut [f32]) -> Result<()> {
    let Job { front: layer, size, optics, simd, cancel } = *job;
    let [in_front, behind] = List::both(layer, size, optics, settings, simd, cancel)?;
    with_channels!(size.channels, C => {
        // Everything that is not in front comes first, because it also shows past the edges of what is in front.
        let target = Target::<C>::new(&behind, layer, size, simd, cancel)?;
        render_rows(out, size, cancel, || target.new_row(), |between, y, out| {
            let plane = |c: usize| &layer.color[c * size.pixels() + y * size.width..][..size.width];
            simd.run(
                #[inline(always)]
                || {
                    interleave::<C, [f32]>(std::array::from_fn(plane), out);
                    show_behind(&target, y, &behind.rows[y], between, out);
                },
            );
        })?;
        if in_front.is_empty() {
            return Ok(());
        }
        let target = Target::<C>::new(&in_front, layer, size, simd, cancel)?;
        let surroundings = Surroundings::<C>::new(out, size, &in_front, simd, cancel)?;
        render_rows(out, size, cancel, || target.new_row(), |between, y, out| {
            simd.run(
                #[inline(always)]
                || lay_in_front(&target, y, &in_front.rows[y], &surroundings, between, out),
            );
        })
    })
}

/// Adds the light of the points behind to their pixels in row `y`.
#[inline(always)]
fn show_behind<const C: usize>(
    target: &Target<C>,
    y: usize,
    points: &[Point],
    between: &mut [Light<C>],
    out: &mut [f32],
) {
    if !points.is_empty() && target.between(y, between) {
        let pixels = out.as_chunks_mut::<C>().0;
        for point in points {
            let x = point.column as usize;
            pixels[x] = behind(pixels[x], point.drawn, light_at(between, x));
        }
    }
}

/// Composites the light in front over row `y`.
#[inline(always)]
fn lay_in_front<const C: usize>(
    target: &Target<C>,
    y: usize,
    points: &[Point],
    surroundings: &Surroundings<C>,
    between: &mut [Light<C>],
    out: &mut [f32],
) {
    if !target.between(y, between) {
        return;
    }
    let pixels = out.as_chunks_mut::<C>().0;
    for (x, pixel) in pixels.iter_mut().enumerate() {
        *pixel = over(*pixel, light_at(between, x));
    }
    for point in points {
        let x = point.column as usize;
        let light = light_at(between, x);
        if light.coverage > 0.0 {
            pixels[x] = in_front(pixels[x], point.drawn, light, surroundings.around(x, y, point.radius_px));
        }
    }
}

/// A pixel of which the part `drawn` is behind the focus; it shows the mean of the light behind.
#[inline(always)]
fn behind<const C: usize>(mut sharp: [f32; C], drawn: f32, light: Light<C>) -> [f32; C] {
    if light.coverage > 0.0 {
        for c in 0..C {
            sharp[c] += drawn * (light.color[c] / light.coverage - sharp[c]);
        }
    }
    sharp
}

/// Composites the light in front over the rest of a pixel.
#[inline(always)]
fn over<const C: usize>(mut rest: [f32; C], light: Light<C>) -> [f32; C] {
    // Sprites of several depths cover a pixel only once.
    let excess = if light.coverage > 1.0 { light.coverage } else { 1.0 };
    let shown = 1.0 - light.coverage / excess;
    for c in 0..C {
        rest[c] = light.color[c] / excess + shown * rest[c];
    }
    rest
}

/// A pixel under the light in front, of which the part `drawn` is in front itself. It is as opaque as that light, and
/// the light that passes it is the light `seen` around it.
#[inline(always)]
fn in_front<const C: usize>(mut over: [f32; C], drawn: f32, light: Light<C>, seen: Light<C>) -> [f32; C] {
    let total = light.coverage + seen.coverage;
    for c in 0..C {
        over[c] += drawn * ((light.color[c] + seen.color[c]) / total - over[c]);
    }
    over
}
