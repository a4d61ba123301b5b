//! Where the points that a view sees are when the reference is taken, things that move included.

use super::camera::{Seen, Warp};
use super::depth_map::{DepthMap, SAME_PX};
use crate::memory::Buffer;
use crate::scene::edges::{self, DOWN, EDGE, RIGHT};
use rayon::prelude::*;

/// From the pixels of a view to the picture of the reference.
pub struct ToReference<'a> {
    depth: DepthMap<'a>,
    /// For what stands still.
    warp: Warp,
    /// How far the point at each pixel has moved across the picture of the reference besides, to the right and down. `None`
    /// if nothing is known to have moved.
    motion: Option<[Buffer<f32>; 2]>,
}

impl ToReference<'_> {
    /// `flow` is where the points of the view's pixels are in the picture of the reference, relative to the pixels: 0 or NaN
    /// in both components where nothing is known, and what is seen stands still.
    pub fn new<'a>(depth: DepthMap<'a>, warp: Warp, flow: Option<&[Buffer<f32>; 2]>) -> ToReference<'a> {
        let at_rest = ToReference { depth, warp, motion: None };
        let Some([right, down]) = flow else { return at_rest };
        let known =
            |i: usize| (right[i] != 0.0 || down[i] != 0.0) && !(right[i].is_nan() || down[i].is_nan());
        if !(0..right.len()).into_par_iter().any(known) {
            return at_rest;
        }
        let mut motion = [Buffer::unset(right.len()), Buffer::unset(right.len())];
        let [across, along] = &mut motion;
        across.par_iter_mut().zip(along.par_iter_mut()).enumerate().for_each(|(i, (across, along))| {
            let (x, y) = depth.place(i);
            let still = if known(i) { at_rest.at(i) } else { None };
            let moved = still.map(|still| {
                [x + f64::from(right[i]) - still.x, y + f64::from(down[i]) - still.y].map(|v| v as f32)
            });
            [*across, *along] = moved.unwrap_or_default();
        });
        ToReference { motion: Some(motion), ..at_rest }
    }

    /// Whether anything is known to have moved.
    pub fn carries(&self) -> bool {
        self.motion.is_some()
    }

    /// Where the reference sees the point at a pixel, unless that is not in front of it. What moves is taken to keep its
    /// distance: a picture's motion says nothing of it.
    #[inline(always)]
    pub fn at(&self, index: usize) -> Option<Seen> {
        self.continued(index, index)
    }

    /// Where the reference sees the surface at pixel `sample`, continued at its distance to another pixel.
    #[inline(always)]
    pub fn continued(&self, sample: usize, index: usize) -> Option<Seen> {
        let (x, y) = self.depth.place(index);
        let seen = self.warp.at(x, y, f64::from(self.depth.disparity[sample]))?;
        Some(self.motion.as_ref().map_or(seen, |[across, along]| Seen {
            x: seen.x + f64::from(across[sample]),
            y: seen.y + f64::from(along[sample]),
            ..seen
        }))
    }

    /// Whether the point at a pixel was elsewhere when the view was taken.
    #[inline(always)]
    pub fn has_moved(&self, index: usize) -> bool {
        let far = |[across, along]: &[Buffer<f32>; 2]| across[index].hypot(along[index]) > SAME_PX;
        self.motion.as_ref().is_some_and(far)
    }

    /// Which neighbouring pixels are on one surface and move alike, where there are `k` pixels of parallax to a unit of
    /// disparity: see [`edges::connectivity`].
    pub fn connectivity(&self, k: f32) -> Vec<u8> {
        let DepthMap { width, height, disparity } = self.depth;
        let mut connectivity = edges::connectivity(&Buffer::of_each(disparity, |d| k * d), width, height);
        for plane in self.motion.iter().flatten() {
            let alike = edges::connectivity(plane, width, height);
            connectivity.par_iter_mut().zip(alike).for_each(|(bits, alike)| {
                *bits = (*bits & alike & (RIGHT | DOWN)) | ((*bits | alike) & EDGE);
            });
        }
        connectivity
    }
}
