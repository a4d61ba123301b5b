//! A layered scene laid out for the sweep, with a mirrored margin. Only blocks that some sweep reads are filled.

use super::culling::PatchBounds;
use super::padded_colors::{Drawn, DrawnGroup};
use super::padded_layer::{PaddedLayer, Present};
use crate::plan::lens::footprint::Footprint;
use crate::plan::lens::padded_bounds;
use crate::plan::lens::padding::Padding;
use crate::scene::colors::Colors;
use crate::scene::depth_bounds::{DepthBits, DepthBounds};
use crate::scene::depth_codes::DepthCodes;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;

/// All data that the sweep reads.
pub struct Padded {
    pub padding: Padding,
    pub codes: DepthCodes,
    /// The largest shift, in front of the focus plane or behind it.
    pub reach_px: f64,
    pub layers: Vec<PaddedLayer>,
    /// The number of the picture's first layer.
    pub front: usize,
    /// Whether light passes through some cell.
    pub translucent: bool,
    pub bounds: DepthBounds,
    /// See [`padded_bounds::windows`].
    pub windows: Vec<DepthBits>,
    /// The finer bounds of depth.
    pub patches: PatchBounds,
}

impl Padded {
    /// Lays out the depths of all layers in the needed blocks; colours follow with [`Padded::set_colors`].
    pub fn new(
        scene: &LayeredScene,
        padding: Padding,
        bounds: DepthBounds,
        reach_px: f64,
        needed: &[bool],
        simd: Simd,
    ) -> Padded {
        let layers = scene.layers.iter().zip(scene.depths.iter()).enumerate();
        let layers: Vec<_> = layers
            .map(|(k, (layer, d))| PaddedLayer::new(d, layer, &padding, Present::new(&bounds, k, needed)))
            .collect();
        let (windows, patches) = (padded_bounds::windows(&bounds), PatchBounds::new(&layers, &padding, simd));
        let translucent = layers.iter().any(|layer| layer.partial.translucent);
        let (codes, front) = (scene.codes, scene.front);
        Padded { padding, codes, reach_px, layers, front, translucent, bounds, windows, patches }
    }

    /// Lays out the colours of all layers in all groups of channels, widened or sharpened to their footprint. Where they are
    /// carried by a picture, `guide` has its colours.
    pub fn set_colors(
        &mut self,
        scene: &LayeredScene,
        groups: &[DrawnGroup],
        guide: Option<&[Colors]>,
        footprint: &Footprint,
        s_focus: f64,
        simd: Simd,
    ) {
        let drawn =
            Drawn { layers: &scene.layers, size: scene.size, groups, guide, footprint, s_focus, simd };
        for (layer, padded) in self.layers.iter_mut().enumerate() {
            padded.set_colors(&drawn, layer, &self.padding);
        }
    }
}
