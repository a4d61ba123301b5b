//! How a weighted sum of a rendered picture changes with the picture, its depth and the lens.

use super::lens::{self, Derivatives};
use super::render::Exposure;
use super::{falloff, resolve};
use crate::error::{Result, value_error};
use crate::memory::Buffer;
use crate::method::Method;
use crate::optics::Optics;
use crate::picture::{Picture, Size};
use crate::plan::lens::{Settings, check_full_resolution, reach_px};
use crate::rows::with_channels;
use crate::scene::layered::LayeredScene;
use crate::scene::origins::Origins;
pub use lens::Asked;
use rayon::prelude::*;
use std::sync::Arc;

/// How a weighted sum of a rendered picture changes, as far as that was asked for.
pub struct Gradients {
    /// With each pixel of the picture, interleaved, layer after layer.
    pub color: Option<Buffer<f32>>,
    pub depth: Option<ByDepth>,
}

/// How a weighted sum of a rendered picture changes with depth and with the lens.
pub struct ByDepth {
    /// With the disparity of each pixel.
    pub disparity: Buffer<f32>,
    /// With the logarithm of the strength of the lens.
    pub log_k: f64,
    /// With the disparity in focus.
    pub d_focus: f64,
}

/// A picture, prepared for one lens, and the weights of the rendered one as planes.
struct Prepared {
    picture: Arc<Picture>,
    layered: Arc<LayeredScene>,
    origins: Arc<Origins>,
    optics: Optics,
    settings: Settings,
    weights: Buffer<f32>,
}

impl Exposure<'_> {
    /// How the sum of the rendered picture, weighted by `cotangent`, changes. The weights are interleaved, at the size of the
    /// output. For the method `lens`.
    pub fn gradients(&self, cotangent: &[f32], asked: Asked) -> Result<Gradients> {
        let Exposure { scene, simd, cancel, .. } = *self;
        if asked != Asked::Colors {
            self.check_lens()?;
        }
        let Prepared { picture, layered, origins, optics, settings, weights } = self.prepared(cotangent)?;
        let input = lens::Input { picture: &picture, scene: &layered, supersample: scene.supersample };
        let Derivatives { colors, shifts } =
            lens::adjoint(&input, &origins, &optics, &settings, (simd, cancel), &weights, asked)?;
        let layer = |planes: &[f32]| interleaved(planes, picture.size);
        let color = colors.map(|colors| {
            let layers: Vec<_> =
                colors.chunks(picture.size.pixels() * picture.size.channels).map(layer).collect();
            let layers: Vec<&[f32]> = layers.iter().map(|layer| &layer[..]).collect();
            Buffer::concat(&layers)
        });
        let depth = shifts.map(|shifts| by_depth(&layered, &optics, shifts, &origins));
        Ok(Gradients { color, depth })
    }

    /// Refuses lenses whose gradients by depth are not known.
    fn check_lens(&self) -> Result<()> {
        let Exposure { scene, imaging, .. } = *self;
        if scene.picture.layers.len() > 1 {
            return Err(value_error!(
                "wrt: gradients of depth and of the lens are for pictures of one layer; got {} layers",
                scene.picture.layers.len()
            ));
        }
        let map = imaging.disparity_map();
        if scene.picture.layers.iter().any(|layer| !map.keeps(|| layer.disparity_range())) {
            return Err(value_error!(
                "wrt: gradients of depth and of the lens are for a lens without tilt, field_curvature and in_focus, and \
                 without max_coc_px"
            ));
        }
        if imaging.second_stop.is_some() {
            return Err(value_error!(
                "wrt: gradients of depth and of the lens are for a lens without cat_eye"
            ));
        }
        Ok(())
    }

    fn prepared(&self, cotangent: &[f32]) -> Result<Prepared> {
        let Exposure { scene, imaging, simd, cancel, .. } = *self;
        let Method::Lens(settings) = self.method else {
            return Err(value_error!(
                "gradients are for method=\"lens\"; got method={:?}",
                self.method.name()
            ));
        };
        for (is_there, words) in [
            (imaging.is_axially_chromatic(), "axial_color"),
            (imaging.is_magnified(), "lateral_color and breathing_focal_length_mm"),
            (imaging.transverse.is_some(), "coma, astigmatism, barn_doors and psf"),
        ] {
            if is_there {
                return Err(value_error!("gradients are for a lens without {words}"));
            }
        }
        let size = scene.picture.size;
        let mut full = resolve::spread(cotangent, size, scene.supersample);
        if let Some(falloff) = &imaging.falloff {
            falloff::darken(&mut full, size, scene.lights, falloff, self.method.clip_of(imaging).as_ref());
        }
        let picture = scene.mapped(&imaging.disparity_map());
        let (optics, settings) = settings.leaning(imaging, &imaging.optics_of(1))?;
        let (layered, origins) = scene.layered_with_origins(&picture, &optics, simd, cancel)?;
        check_full_resolution(reach_px(&layered, optics.k * optics.d_focus))?;
        Ok(Prepared { picture, layered, origins, optics, settings, weights: planes(&full, size) })
    }
}

/// How a sum changes with depth and with the lens, from how it does with the shifts of cells.
fn by_depth(
    layered: &LayeredScene,
    optics: &Optics,
    by_shift: Vec<Buffer<f32>>,
    origins: &Origins,
) -> ByDepth {
    let s_focus = optics.k * optics.d_focus;
    let (mut log_k, mut focus) = (0.0, 0.0);
    for (layer, by_shift) in layered.layers.iter().zip(&by_shift) {
        for (s, v) in layer.s.iter().zip(&**by_shift).filter(|(s, _)| !s.is_nan()) {
            log_k += f64::from(*v) * (f64::from(*s) - s_focus);
            focus -= f64::from(*v);
        }
    }
    let mut disparity = lens::by_pixel(layered.size, by_shift, origins);
    let k = optics.k as f32;
    disparity.par_iter_mut().for_each(|v| *v *= k);
    ByDepth { disparity, log_k, d_focus: optics.k * focus }
}

/// Planes of interleaved pixels.
fn planes(pixels: &[f32], size: Size) -> Buffer<f32> {
    let mut planes = Buffer::unset(pixels.len());
    planes.par_chunks_mut(size.pixels()).enumerate().for_each(|(c, plane)| {
        plane.iter_mut().zip(pixels[c..].iter().step_by(size.channels)).for_each(|(out, v)| *out = *v);
    });
    planes
}

/// Interleaved pixels of planes.
fn interleaved(planes: &[f32], size: Size) -> Buffer<f32> {
    let mut pixels = Buffer::unset(planes.len());
    let n = size.pixels();
    with_channels!(size.channels, C => {
        pixels.par_chunks_mut(size.width * C).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.chunks_exact_mut(C).enumerate() {
                for (c, out) in pixel.iter_mut().enumerate() {
                    *out = planes[c * n + y * size.width + x];
                }
            }
        });
    });
    pixels
}
