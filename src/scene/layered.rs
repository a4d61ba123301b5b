//! The scene as a layered depth image (LDI): for every pixel, the surfaces that a ray meets, front to back.
//!
//! A cell is one surface at one pixel: a depth, an unmixed colour and, where it covers its pixel in part, a
//! half-plane. The layers depend on the strength of the lens (`s = k d`) but not on its focus: a focal stack shares
//! them.

use super::colors::Colors;
use super::depth_bounds::DepthBounds;
use super::depth_codes::DepthCodes;
use super::depth_spans::{self, DepthSpans};
use super::given_layers;
use super::half_plane;
use super::highlights;
use super::holdouts::{self, Held};
use super::layer::{Role, SceneLayer, Surfaces};
use super::one_layer;
use super::origins::Origins;
use super::shifts;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::{Picture, Size};
use crate::simd::Simd;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// All layers of a scene, front to back.
pub struct LayeredScene {
    /// The frame.
    pub size: Size,
    /// The layers themselves.
    pub layers: Vec<SceneLayer>,
    /// The number of the picture's first layer; those before it are holdouts.
    pub front: usize,
    /// What the pinhole sees of the picture behind its holdouts. Without holdouts it sees the picture.
    pub held: Option<Held>,
    /// What a ray that meets no cell has met. If set, it is an unknown surface, and the other rays speak for it;
    /// otherwise it is empty space.
    pub opaque: bool,
    /// Least and greatest shift of all cells, relative to infinity.
    pub shifts: (f64, f64),
    /// How depths are coded.
    pub codes: DepthCodes,
    /// The depths of each layer.
    pub depths: Arc<Vec<DepthSpans>>,
    /// The bounds of depth in the blocks of the frame.
    pub bounds: Arc<DepthBounds>,
    /// The highlights; found when first asked for.
    highlights: OnceLock<Arc<highlights::Found>>,
}

impl LayeredScene {
    fn new(picture: &Picture, surfaces: Surfaces, simd: Simd) -> LayeredScene {
        let held = holdouts::seen(picture, &surfaces.layers);
        LayeredScene::of_surfaces(picture.size, surfaces, held, simd)
    }

    /// The scene of these surfaces; `held` is what the pinhole sees of them behind holdouts, if there are any.
    pub(super) fn of_surfaces(
        size: Size,
        Surfaces { layers, opaque }: Surfaces,
        held: Option<Held>,
        simd: Simd,
    ) -> LayeredScene {
        let front = layers.iter().take_while(|layer| layer.role == Role::Holdout).count();
        let shifts = depth_spans::shift_range(&layers);
        let codes = DepthCodes::new(shifts);
        let depths: Vec<_> =
            (0..layers.len()).map(|layer| DepthSpans::new(&layers, size, layer, &codes, simd)).collect();
        let bounds = DepthBounds::new(size, &depths, &codes, (front, &layers[front]), simd);
        let (depths, bounds) = (Arc::new(depths), Arc::new(bounds));
        let highlights = OnceLock::new();
        LayeredScene { size, layers, front, held, opaque, shifts, codes, depths, bounds, highlights }
    }

    /// The same scene with these highlights.
    pub(super) fn with_highlights(self, found: highlights::Found) -> LayeredScene {
        LayeredScene { highlights: OnceLock::from(Arc::new(found)), ..self }
    }

    /// The cells of each layer that are highlights, and what is left of them.
    pub fn highlights(&self, simd: Simd) -> Arc<highlights::Found> {
        // The search is not done inside the lock: workers that wait for one another there could wait for themselves.
        let found = self.highlights.get().map(Arc::clone);
        found.unwrap_or_else(|| {
            let found = Arc::new(highlights::find(self.size, &self.layers, self.front, simd));
            Arc::clone(self.highlights.get_or_init(|| found))
        })
    }

    /// The same cells with only these channels of their colours, and without carried ones.
    pub fn of_channels(&self, channels: &[usize], simd: Simd) -> LayeredScene {
        let found = self.highlights(simd).of_channels(channels);
        let n = self.size.pixels();
        let of = |layer: &SceneLayer| SceneLayer {
            role: layer.role,
            s: Arc::clone(&layer.s),
            colors: layer.colors.of_channels(channels),
            carried: Vec::new(),
            partial: Arc::clone(&layer.partial),
            connectivity: Arc::clone(&layer.connectivity),
        };
        LayeredScene {
            size: Size { channels: channels.len(), ..self.size },
            layers: self.layers.iter().map(of).collect(),
            front: self.front,
            held: self.held.as_ref().map(|held| {
                let kept: Vec<_> = channels.iter().map(|&c| &held.own[c * n..][..n]).collect();
                Held::of_picture(Buffer::concat(&kept))
            }),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::clone(&self.depths),
            bounds: Arc::clone(&self.bounds),
            highlights: OnceLock::from(Arc::new(found)),
        }
    }

    /// For each layer the number of that of the picture whose pixels its cells are: none for a holdout, and for what the
    /// picture hides.
    pub fn layers_of_picture(&self) -> impl Iterator<Item = Option<usize>> {
        let mut numbers = 0..;
        self.layers.iter().map(move |layer| if layer.colors.is_list() { None } else { numbers.next() })
    }

    /// The same cells in some rows of the frame, which begin with a block and end with one or
    /// with the frame. Everything that was found for the whole frame stays as it is.
    pub fn rows(&self, rows: Range<usize>, simd: Simd) -> LayeredScene {
        let found = self.highlights(simd).rows(rows.clone(), self.size);
        let width = self.size.width;
        let pixels = rows.start * width..rows.end * width;
        let size = Size { height: rows.len(), ..self.size };
        let carried = |layer: &'_ SceneLayer| {
            let of_group =
                |colors: &Colors| colors.rows(pixels.clone(), Size { channels: colors.channels(), ..size });
            layer.carried.iter().map(of_group).collect()
        };
        let of = |layer: &SceneLayer| {
            let partial = layer.partial_in(pixels.clone()).iter();
            let partial = partial.map(|(index, plane)| (index - pixels.start, *plane)).collect();
            let connectivity = if layer.connectivity.is_empty() {
                Vec::new()
            } else {
                layer.connectivity[pixels.clone()].to_vec()
            };
            SceneLayer {
                role: layer.role,
                s: Arc::new(Buffer::from(&layer.s[pixels.clone()])),
                colors: layer.colors.rows(pixels.clone(), size),
                carried: carried(layer),
                partial: Arc::new(partial),
                connectivity: Arc::new(connectivity),
            }
        };
        let depths = self.depths.iter().map(|depths| DepthSpans {
            lo: Buffer::from(&depths.lo[pixels.clone()]),
            hi: Buffer::from(&depths.hi[pixels.clone()]),
        });
        LayeredScene {
            size,
            layers: self.layers.iter().map(of).collect(),
            front: self.front,
            held: self.held.as_ref().map(|held| {
                let kept = |planes: &Buffer<f32>| {
                    let planes = planes.chunks(self.size.pixels()).map(|plane| &plane[pixels.clone()]);
                    Buffer::concat(&planes.collect::<Vec<_>>())
                };
                Held { own: Arc::new(kept(&held.own)), carried: held.carried.iter().map(kept).collect() }
            }),
            opaque: self.opaque,
            shifts: self.shifts,
            codes: self.codes,
            depths: Arc::new(depths.collect()),
            bounds: Arc::new(self.bounds.rows(rows)),
            highlights: OnceLock::from(Arc::new(found)),
        }
    }
}

/// The layers of a picture of one layer without holdouts, and where these come from; see [`build`].
pub fn build_with_origins(
    picture: &Picture,
    lights: usize,
    k: f64,
    simd: Simd,
    cancel: &Cancel,
) -> Result<(LayeredScene, Origins)> {
    let (surfaces, origins) = one_layer::layers_with_origins(picture, lights, k, simd, cancel)?;
    Ok((LayeredScene::new(picture, surfaces, simd), origins))
}

/// The layers of a picture, whose first `lights` channels hold light, under a lens of strength `k` pixels per unit of
/// disparity.
pub fn build(picture: &Picture, lights: usize, k: f64, simd: Simd, cancel: &Cancel) -> Result<LayeredScene> {
    let mut surfaces = match picture.layers.as_slice() {
        [layer] => one_layer::layers(picture, layer, lights, k, simd, cancel),
        _ => given_layers::layers(picture, lights, k, simd, cancel),
    }?;
    let holdouts = picture.holdouts.iter().map(|holdout| {
        cancel.check()?;
        Ok(holdouts::Cells {
            s: shifts::of_cells(holdout, &holdout.color, picture.size, k, simd),
            partial: half_plane::of_layer(picture.size, &holdout.color),
        })
    });
    let holdouts = holdouts.collect::<Result<Vec<_>>>()?;
    surfaces.layers = holdouts::between(picture, surfaces.layers, surfaces.opaque, &holdouts);
    Ok(LayeredScene::new(picture, surfaces, simd))
}
