//! Where the colours and the depths of cells come from: each is a weighted sum of those of pixels.
//!
//! The picture's own colours decide the weights, as they do for channels that it carries. This is the same linear map,
//! written down as its weights, so that it can be turned round. The depth of a surface is that of the pixel itself, or of the
//! pixels around it at which the surface is nearest or farthest.

use super::carried::pure_ends;
use super::front_layer::FrontLayer;
use super::matting::{MixedPixel, around, two_surfaces};
use super::recipe::{Cargo, Source};
use crate::picture::Weighting;
use rayon::prelude::*;

/// Pixels with their weights; in the picture's layers, pixel `i` of layer `l` of `n` pixels is number `l n + i`.
pub type Form = Vec<(u32, f32)>;

/// Where the colour and the depth of a surface of a mixed pixel come from.
pub struct MixedOrigin {
    pub color: Form,
    pub depth: Form,
}

/// Pixels and surfaces of mixed pixels, with their weights. Behind the numbers of all pixels of the picture's layers are those of
/// the two surfaces of each mixed pixel. A hidden cell is made of what is behind mixed pixels around it, and each of these of many
/// pixels: written down for each cell they would be most of what a scene takes.
pub type Origin = Vec<(u32, f32)>;

/// The cells of each layer of a scene that are not made of their own pixel alone, in the same layer of the picture. Behind the
/// layers of the picture, these are all cells.
#[derive(Default)]
pub struct Origins {
    pub layers: Vec<Vec<(usize, Origin)>>,
    /// Both surfaces of every mixed pixel.
    pub mixed: Vec<[MixedOrigin; 2]>,
}

/// The number of a surface of a mixed pixel: the one in front, or the one behind.
pub fn number_of_mixed(pixels: usize, mixed: usize, surface: usize) -> u32 {
    (pixels + 2 * mixed + surface) as u32
}

/// The origins of both surfaces of every mixed pixel, for light.
pub fn of_mixed(frame: &FrontLayer, mixed: &[MixedPixel]) -> Vec<[MixedOrigin; 2]> {
    // Every channel goes the same way, so channels that are 1 for one of the three sources have its weight.
    const OWN: [f32; 4] = [1.0, 0.0, 0.0, 0.0];
    const PURE: [[f32; 4]; 2] = [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let of_pixel = |m: &MixedPixel| {
        let pure = pure_ends(frame, m).map(|shares| -> Form {
            shares.iter().map(|share| (share.pixel as u32, share.weight)).collect()
        });
        let colors = m.recipe.apply(m.coverage, Weighting::Light, OWN, PURE).map(|[own, front, back, _]| {
            let mut form = vec![(m.index as u32, own)];
            for (pixels, weight) in pure.iter().zip([front, back]).filter(|(_, weight)| *weight != 0.0) {
                add_form(&mut form, weight, pixels);
            }
            form
        });
        let [[front, back], [front_depth, back_depth]] = [colors, of_shifts(frame, m)];
        [MixedOrigin { color: front, depth: front_depth }, MixedOrigin { color: back, depth: back_depth }]
    };
    mixed.par_iter().map(of_pixel).collect()
}

/// Which pixels the shifts of both surfaces of a mixed pixel are those of.
fn of_shifts(frame: &FrontLayer, m: &MixedPixel) -> [Form; 2] {
    let (x, y) = (m.index % frame.size.width, m.index / frame.size.width);
    let strength = m.recipe.strength;
    two_surfaces(frame, x, y).map(|surface| {
        if surface.s == frame.s[m.index] {
            return vec![(m.index as u32, 1.0)];
        }
        // The extreme of some equal shifts rises, on average over small changes of these, as their mean does.
        let extreme = around(frame, x, y).filter(|(_, _, s)| *s == surface.s);
        let pixels: Vec<usize> = extreme.filter_map(|(dx, dy, _)| frame.offset(x, y, dx, dy)).collect();
        let share = strength / pixels.len() as f32;
        let own = (strength < 1.0).then_some((m.index as u32, 1.0 - strength));
        own.into_iter().chain(pixels.iter().map(|&q| (q as u32, share))).collect()
    })
}

fn add_form(sum: &mut Form, weight: f32, form: &Form) {
    sum.extend(form.iter().map(|&(q, w)| (q, weight * w)));
}

/// Rays that bring along where they come from.
#[derive(Clone, Copy)]
pub struct Traced<P> {
    /// The number of pixels of all layers of the picture.
    pub pixels: usize,
    /// The pixel of the picture's layers that shows what a pixel shows, and its weight; nothing if there is none.
    pub of_pixel: P,
}

impl<P: Fn(usize) -> Option<(u32, f32)> + Sync> Cargo for Traced<P> {
    type Load = Origin;

    fn nothing(&self) -> Origin {
        Origin::new()
    }

    fn add(&self, sum: &mut Origin, weight: f32, light: f32, source: Source) {
        let weight = weight * light;
        match source {
            Source::Pixel(q) => sum.extend((self.of_pixel)(q).map(|(q, own)| (q, weight * own))),
            Source::Behind(i) => sum.push((number_of_mixed(self.pixels, i, 1), weight)),
        }
    }

    fn add_load(sum: &mut Origin, weight: f32, load: &Origin) {
        // There is one of these for each hidden cell.
        sum.reserve_exact(load.len());
        add_form(sum, weight, load);
    }
}
