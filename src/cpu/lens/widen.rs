//! Widening of cells along their own surface, where lens samples are sparse.

use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::footprint::{Footprint, MAX_WEIGHT, NEXT_CELLS, REACHES, together};
use crate::rows::bands;
use crate::scene::colors::Colors;
use crate::scene::edges::CONNECTED_PX;
use crate::scene::layer::SceneLayer;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// The widening of a layer where lens samples are too sparse for [`Footprint::sharpening`] to compensate.
pub struct Widening<'a> {
    s: &'a [f32],
    /// The variance that each cell still wants.
    wanted: Buffer<f32>,
    most: f32,
    size: Size,
}

impl<'a> Widening<'a> {
    /// The widening of a layer; `None` if that is nowhere.
    pub fn new(
        footprint: &Footprint,
        layer: &'a SceneLayer,
        size: Size,
        s_focus: f64,
    ) -> Option<Widening<'a>> {
        if footprint.table().iter().all(|v| *v <= NEXT_CELLS) {
            return None;
        }
        let shift = |s: f32| (f64::from(s) - s_focus) as f32;
        let wanted_at = |s: f32, spread: f32| {
            let variance = footprint.variance(together(shift(s), spread));
            if s.is_nan() { 0.0 } else { (variance - NEXT_CELLS).max(0.0) }
        };
        let mut wanted = Buffer::unset(layer.s.len());
        let rows = wanted.par_chunks_mut(size.width).zip(layer.s.par_chunks(size.width));
        rows.enumerate().for_each_init(
            || vec![0.0; size.width],
            |spread, (y, (wanted, s))| {
                footprint.spread(y, 0, spread);
                let cells = wanted.iter_mut().zip(s).zip(&*spread);
                cells.for_each(|((wanted, &s), &spread)| *wanted = wanted_at(s, spread));
            },
        );
        let most = wanted.par_iter().copied().reduce(|| 0.0, f32::max);
        Some(Widening { s: &layer.s, wanted, most, size })
    }

    /// The passes, in their order.
    fn passes(&self) -> impl DoubleEndedIterator<Item = Pass<'_>> {
        let mut done = 0.0f32;
        let passes = REACHES.map(|reach| {
            // Weights w of neighbours at distance h add the variance 2 w h^2.
            let per_weight = 2.0 * (reach * reach) as f32;
            let pass = Pass { s: self.s, wanted: &self.wanted, done, per_weight, reach, size: self.size };
            done += MAX_WEIGHT * per_weight;
            pass
        });
        passes.into_iter().filter(|pass| self.most > pass.done)
    }

    /// Colours, widened.
    pub fn of(&self, colors: &Colors, simd: Simd) -> Colors {
        let widened = self.passes().fold(colors.to_planes(), |source, pass| pass.of(&source, simd));
        Colors::new(self.size, Arc::new(widened))
    }

    /// The adjoint of widening: each pass is its own, as two cells exchange by one weight.
    pub fn adjoint(&self, planes: Buffer<f32>, simd: Simd) -> Buffer<f32> {
        self.passes().rev().fold(planes, |source, pass| pass.of(&source, simd))
    }
}

/// One widening pass: diffusion to four neighbours at a distance, along each surface.
struct Pass<'a> {
    s: &'a [f32],
    wanted: &'a [f32],
    done: f32,
    per_weight: f32,
    reach: usize,
    size: Size,
}

impl Pass<'_> {
    /// Filters planes.
    fn of(&self, source: &[f32], simd: Simd) -> Buffer<f32> {
        let mut out = Buffer::unset(source.len());
        let rows = bands(out.chunks_mut(self.size.pixels()), self.size.width);
        rows.into_par_iter().enumerate().for_each_init(
            || vec![0.0; self.size.width],
            |weights, (y, mut out)| {
                simd.run(
                    #[inline(always)]
                    || self.row(source, y, weights, &mut out),
                );
            },
        );
        out
    }

    /// Filters one row of all channels.
    #[inline(always)]
    fn row(&self, source: &[f32], y: usize, weights: &mut [f32], out: &mut [&mut [f32]]) {
        let (w, h, d) = (self.size.width, self.size.height, self.reach);
        let start = y * w;
        for (out, source) in out.iter_mut().zip(source.chunks(self.size.pixels())) {
            out.copy_from_slice(&source[start..start + w]);
        }
        let (own, from_right) = (start..start + w - d.min(w), start + d.min(w));
        self.add_flows(source, from_right, own.clone(), weights, start, out);
        self.add_flows(source, own.start, from_right..start + w, weights, start, out);
        if y >= d {
            self.add_flows(source, start - d * w, start..start + w, weights, start, out);
        }
        if y + d < h {
            self.add_flows(source, start + d * w, start..start + w, weights, start, out);
        }
    }

    /// Adds the exchange between the cells starting at `from` and the cells `to`, in a row that starts at `start`.
    #[inline(always)]
    fn add_flows(
        &self,
        source: &[f32],
        from: usize,
        to: Range<usize>,
        weights: &mut [f32],
        start: usize,
        out: &mut [&mut [f32]],
    ) {
        let n = to.len();
        let weights = &mut weights[..n];
        if !self.weigh(from, to.start, weights) {
            return;
        }
        for (out, source) in out.iter_mut().zip(source.chunks(self.size.pixels())) {
            let (theirs, own) = (&source[from..][..n], &source[to.start..][..n]);
            for (i, out) in out[to.start - start..][..n].iter_mut().enumerate() {
                *out += weights[i] * (theirs[i] - own[i]);
            }
        }
    }

    /// Computes the weights of the exchange between the cells starting at `from` and those starting at `to`, and
    /// returns whether any of them is not 0. The weight of two cells is the mean of what both want, so that no energy
    /// is lost. There is no exchange between different surfaces.
    #[inline(always)]
    fn weigh(&self, from: usize, to: usize, weights: &mut [f32]) -> bool {
        let n = weights.len();
        let [s, wanted] = [self.s, self.wanted].map(|plane| (&plane[to..][..n], &plane[from..][..n]));
        let per_weight = 1.0 / self.per_weight;
        let own = |wanted: f32| {
            let weight = (wanted - self.done) * per_weight;
            let weight = if weight > 0.0 { weight } else { 0.0 };
            if weight < MAX_WEIGHT { weight } else { MAX_WEIGHT }
        };
        let apart = CONNECTED_PX * self.reach as f32;
        for i in 0..n {
            let weight = 0.5 * (own(wanted.0[i]) + own(wanted.1[i]));
            weights[i] = if (s.0[i] - s.1[i]).abs() < apart { weight } else { 0.0 };
        }
        weights.iter().fold(false, |any, w| any | (*w > 0.0))
    }
}
