//! One layer of the scene with a mirrored margin: the depths and half-planes of its cells.

use crate::memory::Buffer;
use crate::plan::lens::padding::Padding;
use crate::scene::depth_bounds::DepthBounds;
use crate::scene::depth_spans::DepthSpans;
use crate::scene::grid::BLOCK;
use crate::scene::half_plane::area_below;
use crate::scene::layer::{Role, SceneLayer};
use rayon::prelude::*;
use std::ops::Range;

/// Half-planes of the cells that cover their pixel partly, as padded planes.
pub struct PartialPlanes {
    /// One bit per cell, in rows of `stride / 8` bytes.
    pub bits: Vec<u8>,
    /// Defined only where there is a half-plane; all planes are empty if there are none.
    pub normal_x: Buffer<f32>,
    pub normal_y: Buffer<f32>,
    pub cut: Buffer<f32>,
    pub opacity: Buffer<f32>,
    /// Whether some light passes through any of them.
    pub translucent: bool,
}

impl PartialPlanes {
    fn new(layer: &SceneLayer, padding: &Padding, present: &Present) -> PartialPlanes {
        let (stride, width) = (padding.stride, padding.width);
        let cells = stride * padding.rows;
        // The sweep reads eight bytes at a time.
        let bits = vec![0; cells / 8 + 8];
        let [normal_x, normal_y, cut, opacity] =
            std::array::from_fn(|_| Buffer::unset(if layer.partial.is_empty() { 0 } else { cells }));
        let translucent = layer.partial.par_iter().any(|(_, plane)| plane.opacity < 1.0);
        let mut planes = PartialPlanes { bits, normal_x, normal_y, cut, opacity, translucent };
        let rows = (planes.normal_x.par_chunks_mut(stride), planes.normal_y.par_chunks_mut(stride));
        let rows = rows.into_par_iter().zip(planes.cut.par_chunks_mut(stride));
        let rows = rows.zip(planes.opacity.par_chunks_mut(stride));
        let rows = rows.zip(planes.bits.par_chunks_mut(stride / 8)).enumerate();
        rows.for_each(|(py, ((((normal_x, normal_y), cut), opacity), bits))| {
            let (y, flip_y) = padding.row(py);
            for (index, plane) in layer.partial_in(y * width..(y + 1) * width) {
                for (px, flip_x) in padding.columns_of(index % width).filter(|(px, _)| present.at(*px, py)) {
                    bits[px / 8] |= 1 << (px % 8);
                    normal_x[px] = if flip_x { -plane.normal[0] } else { plane.normal[0] };
                    normal_y[px] = if flip_y { -plane.normal[1] } else { plane.normal[1] };
                    cut[px] = plane.cut;
                    opacity[px] = plane.opacity;
                }
            }
        });
        planes
    }

    /// The fraction of a beam one pixel wide that cell `i` hides, if the beam passes it at the offset `at` from its
    /// centre.
    pub fn covered(&self, i: usize, at: [f32; 2]) -> f32 {
        self.line(i).map_or(1.0, |(normal, cut)| {
            self.opacity[i] * area_below(normal, cut - (normal[0] * at[0] + normal[1] * at[1]))
        })
    }

    /// The normal and the cut of the half-plane that cell `i` covers, if it does not cover all of its pixel.
    #[inline(always)]
    pub fn line(&self, i: usize) -> Option<([f32; 2], f32)> {
        let is_partial = self.bits[i / 8] >> (i % 8) & 1 != 0;
        is_partial.then(|| ([self.normal_x[i], self.normal_y[i]], self.cut[i]))
    }
}

/// The blocks in which a layer is laid out.
pub struct Present {
    across: usize,
    blocks: Vec<bool>,
}

impl Present {
    /// The blocks that are needed and contain a cell.
    pub fn new(bounds: &DepthBounds, layer: usize, needed: &[bool]) -> Present {
        let has_cells = |b: usize| bounds.occupied[b * bounds.layers + layer] != [0; 4];
        let blocks_present = needed.iter().enumerate().map(|(b, needed)| *needed && has_cells(b)).collect();
        Present { across: bounds.across, blocks: blocks_present }
    }

    fn at(&self, px: usize, py: usize) -> bool {
        self.blocks[py / BLOCK * self.across + px / BLOCK]
    }

    /// Padded row `py`, divided into ranges that are either laid out completely or not at all.
    fn parts(&self, py: usize) -> impl Iterator<Item = (bool, Range<usize>)> + '_ {
        let row = &self.blocks[py / BLOCK * self.across..][..self.across];
        let mut end = 0;
        row.chunk_by(|a, b| a == b).map(move |same| {
            let start = end;
            end += same.len();
            (same[0], start * BLOCK..end * BLOCK)
        })
    }

    /// The ranges of padded row `py` that are laid out.
    pub fn stretches(&self, py: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        self.parts(py).filter_map(|(laid_out, stretch)| laid_out.then_some(stretch))
    }
}

/// One layer, padded. A cell spans the depth codes from `lo` to `hi`; both are 0 where there is no cell.
pub struct PaddedLayer {
    pub role: Role,
    pub lo: Buffer<u16>,
    pub hi: Buffer<u16>,
    /// Planes of the channels of all groups, one after another; defined only where there is a cell.
    pub color: Vec<Buffer<f32>>,
    pub partial: PartialPlanes,
    pub(super) present: Present,
}

/// The part of a padded range that is inside the frame, and the parts to its left and right.
pub fn parts(
    padding: &Padding,
    stretch: &Range<usize>,
) -> (Range<usize>, impl Iterator<Item = usize> + use<>) {
    let (first, end) = (padding.pad[0], padding.pad[0] + padding.width);
    let inside = stretch.start.clamp(first, end)..stretch.end.clamp(first, end);
    let outside = (stretch.start..stretch.end.min(first)).chain(stretch.start.max(end)..stretch.end);
    (inside, outside)
}

impl PaddedLayer {
    /// Lays out the depths of a layer in the blocks that are `present`.
    pub fn new(depths: &DepthSpans, layer: &SceneLayer, padding: &Padding, present: Present) -> PaddedLayer {
        let cells = padding.stride * padding.rows;
        let (mut lo, mut hi) = (Buffer::unset(cells), Buffer::unset(cells));
        let rows = lo.par_chunks_mut(padding.stride).zip(hi.par_chunks_mut(padding.stride));
        rows.enumerate().for_each(|(py, (lo, hi))| {
            let at = padding.row(py).0 * padding.width;
            for (laid_out, stretch) in present.parts(py) {
                if !laid_out {
                    lo[stretch.clone()].fill(0);
                    hi[stretch].fill(0);
                    continue;
                }
                let (inside, outside) = parts(padding, &stretch);
                let source = at + inside.start - padding.pad[0]..at + inside.end - padding.pad[0];
                lo[inside.clone()].copy_from_slice(&depths.lo[source.clone()]);
                hi[inside].copy_from_slice(&depths.hi[source]);
                for px in outside {
                    let source = at + padding.column(px).0;
                    (lo[px], hi[px]) = (depths.lo[source], depths.hi[source]);
                }
            }
        });
        PaddedLayer {
            role: layer.role,
            lo,
            hi,
            color: Vec::new(),
            partial: PartialPlanes::new(layer, padding, &present),
            present,
        }
    }

    /// The ranges of padded row `py` that are laid out.
    pub fn stretches(&self, py: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        self.present.stretches(py)
    }
}
