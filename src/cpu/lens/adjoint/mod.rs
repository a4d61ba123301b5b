//! The adjoint of the flagship: what each pixel of a picture contributes to a weighted sum of the rendered one.
//!
//! For fixed depths, the picture through the lens is a linear map of the colours: what they decide themselves (how mixed
//! pixels are taken apart, what is hidden, what is a highlight, how far cells are sharpened) are its weights. Here the
//! map is walked backward, step by step, with the same weights. Every tile adds to the cells that it has met, so it has its
//! own planes to add to; those of the tiles that are done at the same time are added up in their order.

mod around;
mod disc;
mod gather;
mod highlights;
mod in_focus;
mod met;
mod scratch;
mod sharpening;
mod shifts;
mod views;
mod waves;
mod window;

pub use shifts::of_shifts;

use super::frame::Frame;
use super::group::{Group, Input, Sharpening};
use super::widen::Widening;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::Settings;
use crate::plan::lens::padding::Margin;
use crate::plan::lens::tiles::{Tile, Works};
use crate::scene::origins::{Form, Origin, Origins};
use crate::simd::Simd;
use around::Asked;
use highlights::Light;
use rayon::prelude::*;
use scratch::Scratch;
use waves::in_waves;
use window::{Sums, Target};

/// The adjoint of [`render`](super::render) for the colours of a picture of one layer: `cotangent` and the result are
/// planes of its size. `origins` are those of the scene.
pub fn adjoint(
    input: &Input,
    origins: &Origins,
    optics: &Optics,
    settings: &Settings,
    simd: Simd,
    cancel: &Cancel,
    cotangent: &[f32],
) -> Result<Buffer<f32>> {
    let size = input.picture.size;
    let settings = settings.at_full_resolution();
    let frame = Frame::new(input, optics, &settings, (Works::Least, Margin::Reach), simd, cancel)?;
    let guide = Group { sharpening: Sharpening::Guided, ..Group::of_picture(input, &frame.highlights) };
    let layers = input.scene.layers.len();
    let targets = [Target::Given, Target::Level].into_iter().chain((0..layers).map(Target::Swept));
    let mut sums = Sums::new(size, targets);
    let mut light = vec![[0.0f32; 4]; frame.highlights.all.len()];
    let scratch = || Scratch::new(&frame, size, Asked::Colors);
    let of_tile = |scratch: &mut Scratch, tile: (usize, &Tile)| scratch.colors(&frame, size, tile, cotangent);
    in_waves(&frame, scratch, of_tile, &mut sums, |Light { number, light: more, .. }| {
        light[number].iter_mut().zip(more).for_each(|(sum, v)| *sum += v);
    })?;
    let mut planes = sums.into_planes();
    let [given, level] = std::array::from_fn(|_| planes.next().expect("there are planes for each target"));
    let mut swept: Vec<Buffer<f32>> = planes.collect();
    if frame.is_swept() {
        let drawn = frame.widened(&guide);
        swept = sharpening::adjoint(&frame, size, drawn, swept);
        cancel.check()?;
        let layers = input.scene.layers.iter().zip(swept);
        let narrowed =
            layers.map(|(layer, planes)| match Widening::new(&frame.footprint, layer, size, frame.s_focus) {
                Some(widening) => widening.adjoint(planes, simd),
                None => planes,
            });
        swept = narrowed.collect();
    }
    let cells = of_cells(&frame, size, swept, &level, &light);
    Ok(of_pixels(size, given, &cells, origins))
}

/// What each layer's cells contribute, from what they do as they are swept and, of the first layer, as exact discs.
/// Highlights are of less light there, and what they are of more is drawn apart.
fn of_cells(
    frame: &Frame,
    size: Size,
    mut swept: Vec<Buffer<f32>>,
    level: &[f32],
    light: &[[f32; 4]],
) -> Vec<Buffer<f32>> {
    let n = size.pixels();
    for (h, light) in frame.highlights.all.iter().zip(light) {
        let dimmed = 1.0 - h.outshining;
        let drawn = if frame.highlights.swept.is_some() { h.drawn } else { 1.0 };
        let index = h.y as usize * size.width + h.x as usize;
        for (c, light) in light.iter().enumerate().take(size.channels) {
            let own = &mut swept[h.layer][c * n + index];
            let of_level = if h.layer == 0 { (dimmed - 1.0) * level[c * n + index] } else { 0.0 };
            *own = (1.0 - drawn * h.outshining) * *own + of_level + h.area * h.outshining * light;
        }
    }
    swept[0].par_iter_mut().zip(level).for_each(|(sum, v)| *sum += v);
    swept
}

/// What the pixels of a picture contribute: themselves, and as the origins of cells.
fn of_pixels(size: Size, given: Buffer<f32>, cells: &[Buffer<f32>], origins: &Origins) -> Buffer<f32> {
    let n = size.pixels();
    let mut out = given;
    out.par_chunks_mut(n).enumerate().for_each(|(c, out)| {
        let of_layer = |cells: &'_ Buffer<f32>| cells[c * n..][..n].to_vec();
        add_origins(out, cells.iter().map(of_layer), origins, |origin| &origin.color);
    });
    out
}

/// The derivative by the shift of each pixel, from those by the shifts of cells.
pub fn by_pixel(size: Size, cells: Vec<Buffer<f32>>, origins: &Origins) -> Buffer<f32> {
    let mut out = Buffer::full(size.pixels(), 0.0);
    let cells = cells.iter().map(|cells| cells.to_vec());
    add_origins(&mut out, cells, origins, |origin| &origin.depth);
    out
}

/// Adds one plane of each layer to the pixels of which its cells are made.
fn add_origins(
    out: &mut [f32],
    layers: impl Iterator<Item = Vec<f32>>,
    origins: &Origins,
    form: impl Fn(&Origin) -> &Form,
) {
    for ((layer, mut plane), listed) in layers.enumerate().zip([&origins.front, &origins.behind]) {
        for (index, origin) in listed {
            let v = std::mem::take(&mut plane[*index]);
            form(origin).iter().for_each(|&(q, weight)| out[q as usize] += weight * v);
        }
        // A cell without origins is its own pixel; behind the first layer there is none.
        if layer == 0 {
            out.iter_mut().zip(&plane).for_each(|(out, v)| *out += v);
        }
    }
}
