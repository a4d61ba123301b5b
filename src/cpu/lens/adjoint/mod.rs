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
mod job;
mod met;
mod own_shifts;
mod pairs;
mod plane_set;
mod scratch;
mod sharpening;
mod shifts;
mod through;
mod views;
mod waves;
mod window;

use super::frame::Frame;
use super::group::{Group, Input};
use super::widen::Widening;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::optics::Optics;
use crate::picture::Size;
use crate::plan::lens::Settings;
use crate::plan::lens::disc::{Surface, beside};
use crate::plan::lens::footprint::{Footprint, Sharpening};
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::padding::Margin;
use crate::plan::lens::tiles::Tile;
use crate::scene::origins::{Form, MixedOrigin, Origins};
use crate::simd::Simd;
use highlights::Light;
pub use job::Asked;
use job::Job;
use rayon::prelude::*;
use scratch::Scratch;
use std::collections::BTreeSet;
use waves::in_waves;
use window::{Sums, Target};

/// The derivatives, as far as they were asked for.
#[derive(Default)]
pub struct Derivatives {
    /// By the picture: planes of its size for each of its layers.
    pub colors: Option<Buffer<f32>>,
    /// By the shifts of the cells of each layer.
    pub shifts: Option<Vec<Buffer<f32>>>,
}

/// The adjoint of [`render`](super::render): `cotangent` has planes of the picture's size. `origins` are those of the scene.
/// Derivatives by shifts are for pictures of one layer, and for lenses that show all of the opening everywhere.
pub fn adjoint(
    input: &Input,
    origins: &Origins,
    optics: &Optics,
    settings: &Settings,
    (simd, cancel): (Simd, &Cancel),
    cotangent: &[f32],
    asked: Asked,
) -> Result<Derivatives> {
    let size = input.picture.size;
    let settings = settings.at_full_resolution();
    let mut frame = Frame::new(input, optics, &settings, Margin::Reach, simd, cancel)?;
    let group = Group::of_picture(input, &frame.highlights);
    // Widening takes away texture, which moves; the noise of few samples has no mean.
    let mut narrow = Footprint::new(frame.padded.reach_px, |_| 1, |_, _| 0.0, None);
    if asked.shifts() && frame.is_swept() {
        let own = std::mem::replace(&mut frame.footprint, narrow);
        frame.set_colors(std::slice::from_ref(&group), None);
        narrow = std::mem::replace(&mut frame.footprint, own);
        cancel.check()?;
    }
    let job = Job {
        frame: &frame,
        size,
        asked,
        cotangent,
        group: &group,
        discs: frame.gather(&group),
        beside: beside_level(&frame, &settings, asked)?,
    };
    let layers = input.scene.layers.len();
    let colors = [Target::Given, Target::Level].into_iter().filter(|_| asked.colors());
    let shifts = (0..layers).map(Target::Shifts).filter(|_| asked.shifts());
    let mut sums = Sums::new(size, colors.chain((0..layers).map(Target::Swept)).chain(shifts));
    let mut light = vec![[0.0f32; 4]; frame.highlights.all.len()];
    let mut by_highlight = vec![0.0f32; light.len()];
    let scratch = || Scratch::new(&job);
    let of_tile = |scratch: &mut Scratch, tile: (usize, &Tile)| scratch.tile(&job, tile);
    in_waves(&frame, scratch, of_tile, &mut sums, |Light { number, light: more, by_shift }| {
        light[number].iter_mut().zip(more).for_each(|(sum, v)| *sum += v);
        let changes = by_shift.iter().zip(group.excess[number]);
        by_highlight[number] += changes.map(|(by_shift, excess)| by_shift * excess).sum::<f32>();
    })?;
    let swept: Vec<Buffer<f32>> = (0..layers).map(|layer| sums.take(Target::Swept(layer))).collect();
    let mut found = Derivatives::default();
    if asked.shifts() {
        found.shifts = Some(shifts::of_cells(&job, &mut sums, &swept, &narrow, &by_highlight));
        cancel.check()?;
    }
    if asked.colors() {
        let level = sums.take(Target::Level);
        // No ray is followed any more, and what comes now takes as much memory.
        frame.padded.layers.clear();
        let swept = of_drawn(input, &frame, size, swept)?;
        let cells = of_cells(&frame, size, swept, &level, &light);
        found.colors = Some(of_pixels(size, &sums.take(Target::Given), &cells, origins, &group.coverage));
    }
    Ok(found)
}

/// The discs beside those of surfaces of one depth, which tell how these grow, if derivatives by shifts are asked for.
fn beside_level(frame: &Frame, settings: &Settings, asked: Asked) -> Result<Kernels> {
    let Frame { scene, s_focus, cancel, .. } = frame;
    let discs = frame.tiles.iter().filter(|tile| asked.shifts() && tile.disc_share() > 0.0);
    let surface = |tile: &Tile| Surface::new(&scene.layers[scene.front].s, scene.size, *s_focus, tile.origin);
    let level = discs.filter_map(|tile| surface(tile).level());
    Kernels::new(&settings.aperture, *s_focus, BTreeSet::new(), level.flat_map(beside), cancel)
}

/// What the cells of each layer contribute, from what they do as they are drawn: sharpened, and widened.
fn of_drawn(input: &Input, frame: &Frame, size: Size, swept: Vec<Buffer<f32>>) -> Result<Vec<Buffer<f32>>> {
    if !frame.is_swept() {
        return Ok(swept);
    }
    let guide = Group { sharpening: Sharpening::Guided, ..Group::of_picture(input, &frame.highlights) };
    let narrowed = sharpening::adjoint(frame, size, frame.widened(&guide), swept);
    frame.cancel.check()?;
    let layers = frame.scene.layers.iter().zip(narrowed);
    let narrowed =
        layers.map(|(layer, planes)| match Widening::new(&frame.footprint, layer, size, frame.s_focus) {
            Some(widening) => widening.adjoint(planes, frame.simd),
            None => planes,
        });
    Ok(narrowed.collect())
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

/// What the pixels of each layer of a picture contribute: themselves, as what the pinhole sees, and as the origins of cells.
/// `coverage` is that of each of several layers.
fn of_pixels(
    size: Size,
    given: &[f32],
    cells: &[Buffer<f32>],
    origins: &Origins,
    coverage: &[&[f32]],
) -> Buffer<f32> {
    let n = size.pixels();
    let mut out = Buffer::full(coverage.len().max(1) * size.channels * n, 0.0);
    let mut planes: Vec<_> = out.chunks_mut(n).collect();
    let mut channels: Vec<Vec<&mut [f32]>> = (0..size.channels).map(|_| Vec::new()).collect();
    planes.drain(..).enumerate().for_each(|(i, plane)| channels[i % size.channels].push(plane));
    channels.par_iter_mut().zip(given.par_chunks(n)).enumerate().for_each(|(c, (out, given))| {
        let of_layer = |cells: &'_ Buffer<f32>| cells[c * n..][..n].to_vec();
        add_origins(out, cells.iter().map(of_layer), origins, coverage, |origin| &origin.color);
        let mut left = given.to_vec();
        for (i, out) in out.iter_mut().enumerate() {
            out.iter_mut().zip(&left).for_each(|(out, v)| *out += v);
            if let Some(coverage) = coverage.get(i) {
                left.iter_mut().zip(*coverage).for_each(|(left, a)| *left *= 1.0 - a);
            }
        }
    });
    out
}

/// The derivative by the shift of each pixel of a picture of one layer, from those by the shifts of cells.
pub fn by_pixel(size: Size, cells: Vec<Buffer<f32>>, origins: &Origins) -> Buffer<f32> {
    let mut out = Buffer::full(size.pixels(), 0.0);
    let cells = cells.iter().map(|cells| cells.to_vec());
    add_origins(&mut [&mut out], cells, origins, &[], |origin| &origin.depth);
    out
}

/// Adds one plane of the cells of each layer to those of the picture's layers of whose pixels they are made.
fn add_origins(
    out: &mut [&mut [f32]],
    cells: impl Iterator<Item = Vec<f32>>,
    origins: &Origins,
    coverage: &[&[f32]],
    form: impl Fn(&MixedOrigin) -> &Form,
) {
    let (n, pixels) = (out[0].len(), out.iter().map(|plane| plane.len()).sum::<usize>());
    let mut by_mixed = vec![0.0; 2 * origins.mixed.len()];
    for (layer, mut plane) in cells.enumerate() {
        for (index, origin) in origins.layers.get(layer).into_iter().flatten() {
            let v = std::mem::take(&mut plane[*index]);
            for &(number, weight) in origin {
                let number = number as usize;
                let to = match number.checked_sub(pixels) {
                    None => &mut out[number / n][number % n],
                    Some(surface) => &mut by_mixed[surface],
                };
                *to += weight * v;
            }
        }
        // A cell without origins is its own pixel, of whose colour it has that of what it covers.
        let Some(out) = out.get_mut(layer) else { continue };
        match coverage.get(layer) {
            None => out.iter_mut().zip(&plane).for_each(|(out, v)| *out += v),
            Some(coverage) => {
                let cells = out.iter_mut().zip(&plane).zip(*coverage).filter(|(_, a)| **a > 0.0);
                cells.for_each(|((out, v), a)| *out += v / a);
            }
        }
    }
    for (origin, v) in origins.mixed.iter().flatten().zip(by_mixed) {
        form(origin).iter().for_each(|&(q, weight)| out[q as usize / n][q as usize % n] += weight * v);
    }
}
