//! A scene on a device, and its renders. Only here does the device decide which code runs.

use crate::cancel::Cancel;
use crate::device::Device;
use crate::error::Result;
use crate::method::Method;
use crate::optics::Imaging;
use crate::picture::Picture;
use crate::scene::Scene;
use crate::simd::Simd;
use crate::{cpu, gpu};

pub use crate::gpu::PassTime;

/// A scene, with the data that devices keep of it from one picture to the next.
pub struct Renderer {
    scene: Scene,
    cache: gpu::SceneCache,
}

impl Renderer {
    /// A renderer of a picture whose width and height are multiples of `supersample`, and whose first `lights` channels
    /// hold light.
    pub fn new(picture: Picture, lights: usize, supersample: usize) -> Renderer {
        Renderer { scene: Scene::new(picture, lights, supersample), cache: gpu::SceneCache::default() }
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
        outs: Vec<&mut [f32]>,
    ) -> Result<Vec<PassTime>> {
        let scene = &self.scene;
        let all = lenses.iter().zip(outs);
        match device {
            Device::Cpu => {
                for (imaging, out) in all {
                    cpu::render::Exposure { scene, imaging, method, simd, cancel }.render(out)?;
                }
                Ok(Vec::new())
            }
            Device::Gpu(adapter) => {
                let job = gpu::render::Scope { scene, cache: &self.cache, method, simd, cancel };
                gpu::render::render_each(adapter, &job, all)
            }
        }
    }
}
