//! Lamps that a view sees: their part of the pixels that mix them with other surfaces.
//!
//! A surface without the pixels of its edges has lost a rim. A lamp a few pixels wide has no other pixels and would be lost
//! entirely. So the pixels of lamps are separated, as [`layered`](crate::scene::layered) separates those of a first layer, and
//! the lamp is drawn with its coverage. Coverage falls to 0 at the pixels around, which see past the lamp. Linear
//! interpolation between pixels preserves the sum, so as much light arrives as the view has seen.

use super::depth_map::{DepthMap, SAME_PX};
use super::evidence::Evidence;
use super::motion::ToReference;
use super::view::View;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::scene::front_layer::FrontLayer;
use crate::scene::matting::{MixedPixel, Separated, unmix};
use rayon::prelude::*;

/// A pixel that mixes a lamp with something else.
pub struct LampPixel {
    pub index: usize,
    /// The pixel at whose centre the lamp is seen, this one or one beside it: the lamp's depth and motion are known there.
    pub sample: usize,
    /// How much of the pixel the lamp covers, whatever hides it.
    pub coverage: f32,
    /// How much of that is not hidden by what is nearer.
    pub visible: f32,
    /// The lamp's colour.
    pub color: [f32; 4],
    /// What the reference tells of it.
    pub evidence: Evidence,
}

/// Four neighbouring pixels, at least one of which mixes a lamp with something else.
pub struct LampQuad {
    /// The upper left one.
    pub index: usize,
    /// The least and the greatest disparity of the lamp.
    pub disparities: [f32; 2],
    /// Least and greatest row of the reference on which they lie.
    pub y: [f32; 2],
}

/// The lamps of a view.
pub struct Lamps {
    /// In the order of rows.
    pixels: Vec<LampPixel>,
    /// Those of lamps that the reference does not see, in the order of rows.
    pub quads: Vec<LampQuad>,
}

impl Lamps {
    pub fn new(
        (view, size, lights): (&View, Size, usize),
        (map, connectivity): (&DepthMap, &[u8]),
        (to_reference, k): (&ToReference, f32),
        evidence: impl Fn(usize, usize) -> Evidence + Sync,
        cancel: &Cancel,
    ) -> Result<Lamps> {
        let s = Buffer::of_each(map.disparity, |d| k * d);
        let frame = FrontLayer::new(size, lights, &view.color, &s, connectivity);
        let mixed = unmix(&frame, Separated::lamps(&frame), cancel)?;
        let of_mixed = |m: &MixedPixel| {
            // A surface's own pixel, or the nearest or farthest one around.
            let beside = |nearer: bool| {
                let order = |a: &usize, b: &usize| s[*a].total_cmp(&s[*b]);
                let around = map.around(m.index);
                if nearer { around.max_by(order) } else { around.min_by(order) }
            };
            let sample = |s_lamp: f32, nearer: bool| {
                if s_lamp == s[m.index] { Some(m.index) } else { beside(nearer) }
            };
            let (sample, coverage, visible, color) = if frame.norm2(m.front) > frame.norm2(m.back) {
                (sample(m.s_front, true)?, m.coverage, 1.0, m.front)
            } else {
                (sample(m.s_back, false)?, 1.0, 1.0 - m.coverage, m.back)
            };
            // A surface begins to be a lamp with none of its light.
            let coverage = coverage * m.recipe.strength;
            let evidence = evidence(m.index, sample);
            Some(LampPixel { index: m.index, sample, coverage, visible, color, evidence })
        };
        let pixels = mixed.par_iter().filter_map(of_mixed).collect();
        let mut lamps = Lamps { pixels, quads: Vec::new() };
        lamps.quads = lamps.find_quads(map, to_reference, k);
        Ok(lamps)
    }

    /// The lamp at a pixel.
    pub fn at(&self, index: usize) -> Option<&LampPixel> {
        self.pixels.binary_search_by_key(&index, |pixel| pixel.index).ok().map(|i| &self.pixels[i])
    }

    /// The quads of lamps that are hidden. Where there are several lamps, each has its own.
    fn find_quads(&self, map: &DepthMap, to_reference: &ToReference, k: f32) -> Vec<LampQuad> {
        let hidden = |pixel: &&LampPixel| pixel.evidence == Evidence::Hidden;
        let of_pixel = |pixel: &LampPixel| {
            let (x, y) = (pixel.index % map.width, pixel.index / map.width);
            let first = |v: usize| v.saturating_sub(1);
            let rows = first(y)..(y + 1).min(map.height - 1);
            rows.flat_map(move |y| (first(x)..(x + 1).min(map.width - 1)).map(move |x| y * map.width + x))
        };
        let mut quads: Vec<usize> = self.pixels.iter().filter(hidden).flat_map(of_pixel).collect();
        quads.sort_unstable();
        quads.dedup();
        let of_place = |quad: &usize| {
            let disparity = |pixel: &LampPixel| map.disparity[pixel.sample];
            let mut pixels: Vec<&LampPixel> =
                corners(*quad, map.width).into_iter().filter_map(|index| self.at(index)).collect();
            pixels.sort_by(|a, b| disparity(a).total_cmp(&disparity(b)));
            let lamps = pixels.chunk_by(|a, b| k * (disparity(b) - disparity(a)) <= SAME_PX);
            let lamps = lamps.filter(|lamp| lamp.iter().any(hidden)).map(|lamp| {
                let places =
                    lamp.iter().flat_map(|pixel| corners(*quad, map.width).map(|at| (pixel.sample, at)));
                let rows = places.filter_map(|(sample, at)| to_reference.continued(sample, at));
                let none = [f32::INFINITY, f32::NEG_INFINITY];
                let [first, last] = rows
                    .fold(none, |[first, last], seen| [first.min(seen.y as f32), last.max(seen.y as f32)]);
                LampQuad {
                    index: *quad,
                    disparities: [disparity(lamp[0]), disparity(lamp[lamp.len() - 1])],
                    // Pixels that show nothing but the lamp are as near as its others to within this.
                    y: [first - SAME_PX, last + SAME_PX],
                }
            });
            lamps.collect::<Vec<_>>()
        };
        quads.par_iter().flat_map_iter(of_place).collect()
    }
}

/// The pixels of a quad: above from the left, and below from the left.
pub fn corners(quad: usize, width: usize) -> [usize; 4] {
    [quad, quad + 1, quad + width, quad + width + 1]
}
