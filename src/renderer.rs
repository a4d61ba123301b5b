//! A scene on a device, and its renders. Only here does the device decide which code runs.

use crate::cancel::Cancel;
use crate::carried::Carried;
use crate::device::Device;
use crate::error::Result;
use crate::method::Method;
use crate::optics::Imaging;
use crate::picture::Picture;
use crate::scene::Scene;
use crate::simd::Simd;
use crate::{cpu, gpu};
use rayon::prelude::*;

pub use crate::gpu::PassTime;

/// A scene, with the data that devices keep of it from one picture to the next.
pub struct Renderer {
    scene: Scene,
    cache: gpu::SceneCache,
}

impl Renderer {
    /// A renderer of a picture whose width and height are multiples of `supersample`, and whose first `lights` channels
    /// hold light. If it carries channels, these are rendered in place of its own: by the method `lens`.
    pub fn new(picture: Picture, lights: usize, carried: Option<Carried>, supersample: usize) -> Renderer {
        let scene = Scene::new(picture, lights, carried, supersample);
        Renderer { scene, cache: gpu::SceneCache::default() }
    }

    /// Renders the scene through each of some lenses into one of `outs` each: interleaved, and premultiplied if there
    /// is coverage. The method must have been [checked](Method::check). Returns the GPU passes in order, with their
    /// times; empty on the CPU, and if the GPU cannot measure time.
    pub fn render_each(
        &self,
        lenses: &[Imaging],
        method: &Method,
        device: Device,
        simd: Simd,
        cancel: &Cancel,
        mut outs: Vec<&mut [f32]>,
    ) -> Result<Vec<PassTime>> {
        let scene = &self.scene;
        let all = lenses.iter().zip(outs.iter_mut().map(|out| &mut **out));
        let passes = match device {
            Device::Cpu => {
                for (imaging, out) in all {
                    cpu::render::Exposure { scene, imaging, method, simd, cancel }.render(out)?;
                }
                Vec::new()
            }
            Device::Gpu(adapter) => {
                let job = gpu::render::Scope { scene, cache: &self.cache, method, simd, cancel };
                gpu::render::render_each(adapter, &job, all)?
            }
        };
        if scene.carried.is_none() && scene.lights < scene.picture.size.channels {
            outs.iter_mut().for_each(|out| bound_coverage(out, scene.picture.size.channels));
        }
        Ok(passes)
    }
}

impl Renderer {
    /// The gradients of a render on the CPU; see [`cpu::adjoint`].
    pub fn gradient<T>(
        &self,
        imaging: &Imaging,
        method: &Method,
        simd: Simd,
        cancel: &Cancel,
        of: impl FnOnce(&cpu::render::Exposure) -> Result<T>,
    ) -> Result<T> {
        let scene = &self.scene;
        of(&cpu::render::Exposure { scene, imaging, method, simd, cancel })
    }
}

/// Bounds the last channel of an interleaved picture by 1: no pixel is covered more than wholly.
///
/// Weights of a mean add up to 1 but for rounding. And sharpening undoes the blur of drawing cells at fractions of a
/// pixel by adding to a cell what it has more than its neighbours. That is right in the mean of many cells; where few
/// are averaged, and one of whole coverage has neighbours of less, more than 1 is left.
fn bound_coverage(picture: &mut [f32], channels: usize) {
    const PIXELS: usize = 1 << 14;
    picture.par_chunks_mut(PIXELS * channels).for_each(|part| {
        part.iter_mut().skip(channels - 1).step_by(channels).for_each(|alpha| *alpha = alpha.min(1.0));
    });
}
