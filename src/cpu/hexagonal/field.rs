//! A tile and its surroundings, read into planes.

use super::lanes::LANES;
use super::reach::{BlockPaths, Reach};
use crate::mirror::{mirrored, read_mirrored};
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::hexagonal::{Margin, Plan};
use crate::simd::Simd;

/// The picture from which tiles are read.
pub struct Source<'a> {
    pub layer: &'a Layer,
    pub size: Size,
    pub optics: &'a Optics,
    /// The limit of the radius of circles of confusion, in pixels.
    pub max_coc_px: f64,
    /// Columns and rows of a tile.
    pub tile: (usize, usize),
}

/// Signed radius of the circle of confusion at a disparity, limited to `most` pixels.
#[inline(always)]
fn coc(optics: &Optics, most: f64, disparity: f32) -> f32 {
    (-optics.shift_px(f64::from(disparity))).clamp(-most, most) as f32
}

/// The planes of light in front of the focus. Colour and coverage are divided by the radius of the circle of
/// confusion, so that the light that a step of a line receives is a multiple of them.
#[derive(Debug, Clone, Copy)]
pub struct Near {
    /// The first colour plane.
    pub color: usize,
    pub coverage: usize,
    /// Radius of the circle of confusion; 0 where there is no light in front.
    pub radius: usize,
}

/// The planes of everything that is not in front: its colour times the visible part of it, and that part.
#[derive(Debug, Clone, Copy)]
pub struct Rest {
    /// The first colour plane.
    pub color: usize,
    pub seen: usize,
}

/// The picture, or a target of the first pass.
#[derive(Debug, Clone, Copy)]
pub struct Planes {
    pub near: Near,
    pub rest: Rest,
}

/// A tile and its surroundings: the picture and the targets of the first pass, in planes of one layout.
pub struct Field {
    /// Columns to the left of the tile, a multiple of [`LANES`], and rows above it.
    pub before: (usize, usize),
    /// Margin around the tile that the second pass reads.
    pub second: Margin,
    pub stride: usize,
    /// Number of values in a plane.
    pub area: usize,
    /// The planes, as the indices of their first values.
    pub picture: Planes,
    pub targets: Vec<Planes>,
    /// Signed circles of confusion of the picture, and their reciprocals behind the focus; 0 elsewhere.
    pub coc: usize,
    pub inverse: usize,
    pub values: Vec<f32>,
    /// A scratch row of the picture.
    row: Vec<f32>,
    paths: BlockPaths,
    pub reach: Reach,
}

impl Field {
    pub fn new(plan: &Plan, frame: &Source) -> Field {
        let (second, both) = plan.margins();
        // Lanes start at multiples of their number, and may extend past the margin.
        let before = (both.left.next_multiple_of(LANES) + LANES, both.above);
        let stride = (before.0 + frame.tile.0 + both.right + LANES).next_multiple_of(LANES);
        let area = stride * (before.1 + frame.tile.1 + both.below);
        let channels = frame.size.channels;
        let mut used = 0;
        let mut take = |planes: usize| {
            used += planes;
            (used - planes) * area
        };
        let mut planes = || Planes {
            near: Near { color: take(channels), coverage: take(1), radius: take(1) },
            rest: Rest { color: take(channels), seen: take(1) },
        };
        let picture = planes();
        let targets = plan.targets.iter().map(|_| planes()).collect();
        let (coc, inverse) = (take(1), take(1));
        Field {
            before,
            second,
            stride,
            area,
            picture,
            targets,
            coc,
            inverse,
            values: vec![0.0; take(0)],
            row: vec![0.0; stride],
            paths: BlockPaths::new(plan),
            reach: Reach::default(),
        }
    }

    /// Reads a tile and its surroundings; the picture is mirrored at the border.
    pub fn read(&mut self, simd: Simd, frame: &Source, origin: (usize, usize)) {
        let (size, area, stride) = (frame.size, self.area, self.stride);
        let left = origin.0 as i64 - self.before.0 as i64;
        for row in 0..area / stride {
            let y = origin.1 as i64 + row as i64 - self.before.1 as i64;
            let from = mirrored(y, size.height).0 * size.width;
            read_mirrored(&frame.layer.disparity[from..][..size.width], left, &mut self.row);
            simd.run(
                #[inline(always)]
                || circles(frame, &self.row, &mut self.values[self.coc + row * stride..][..stride]),
            );
        }
        self.reach = Reach::new(&self.values[self.coc..][..area], stride, &self.paths, simd);
        if self.reach.is_none() {
            return;
        }
        for row in 0..area / stride {
            let y = origin.1 as i64 + row as i64 - self.before.1 as i64;
            let from = mirrored(y, size.height).0 * size.width;
            simd.run(
                #[inline(always)]
                || measure(self, row * stride),
            );
            for c in 0..size.channels {
                let color = &frame.layer.color[c * size.pixels() + from..][..size.width];
                read_mirrored(color, left, &mut self.row);
                simd.run(
                    #[inline(always)]
                    || part_layers(self, row * stride, c),
                );
            }
        }
    }
}

/// Signed circles of confusion of a row.
#[inline(always)]
fn circles(frame: &Source, disparity: &[f32], out: &mut [f32]) {
    // Copies, so that the compiler knows that nothing in the loop changes them.
    let (optics, most) = (*frame.optics, frame.max_coc_px);
    map(disparity, out, |d| coc(&optics, most, d));
}

/// Computes everything that follows from the circles of confusion alone, for the row at index `at` of every plane.
#[inline(always)]
fn measure(field: &mut Field, at: usize) {
    let Planes { near, rest } = field.picture;
    let row = |plane: usize| plane + at..plane + at + field.stride;
    // The planes of circles of confusion are stored last.
    let (planes, coc) = field.values.split_at_mut(field.coc);
    let (coc, inverse) = coc.split_at_mut(field.area);
    let coc = &coc[row(0)];
    map(coc, &mut inverse[row(0)], |coc| if coc > 0.0 { 1.0 / coc } else { 0.0 });
    map(coc, &mut planes[row(near.coverage)], |coc| if coc < 0.0 { -1.0 / coc } else { 0.0 });
    map(coc, &mut planes[row(near.radius)], |coc| if coc < 0.0 { -coc } else { 0.0 });
    map(coc, &mut planes[row(rest.seen)], |coc| if coc < 0.0 { 0.0 } else { 1.0 });
}

/// Separates the colours of a row that are in front from the others.
#[inline(always)]
fn part_layers(field: &mut Field, at: usize, c: usize) {
    let Planes { near, rest } = field.picture;
    let row = |plane: usize| plane + at..plane + at + field.stride;
    let (planes, coc) = field.values.split_at_mut(field.coc);
    let pixels = || field.row.iter().zip(&coc[row(0)]);
    for (out, (color, coc)) in planes[row(near.color + c * field.area)].iter_mut().zip(pixels()) {
        *out = if *coc < 0.0 { -color / coc } else { 0.0 };
    }
    for (out, (color, coc)) in planes[row(rest.color + c * field.area)].iter_mut().zip(pixels()) {
        *out = if *coc < 0.0 { 0.0 } else { *color };
    }
}

/// Fills a row by applying a function to each value of another row.
#[inline(always)]
fn map(values: &[f32], out: &mut [f32], of: impl Fn(f32) -> f32) {
    for (out, v) in out.iter_mut().zip(values) {
        *out = of(*v);
    }
}
