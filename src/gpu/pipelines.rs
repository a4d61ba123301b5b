//! Shaders that have been compiled.

#[cfg(feature = "test-shaders")]
use super::device::quotient;
use super::device::{Gpu, lock};
use super::shader::Shader;
#[cfg(feature = "test-shaders")]
use super::shader::perturbed::perturbed;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;

/// What a pipeline is made of: a shader for pictures with this number of channels, and the layout of its bindings.
pub struct PipelineKey {
    pub shader: Shader,
    pub channels: usize,
    pub layout: wgpu::BindGroupLayout,
}

impl PipelineKey {
    /// What it is found by; a shader always has the same bindings.
    fn name(&self) -> (&'static str, usize) {
        (self.shader.name, self.channels)
    }
}

#[cfg(not(feature = "test-shaders"))]
fn source(shader: &Shader) -> Cow<'static, str> {
    shader.source.into()
}

#[cfg(feature = "test-shaders")]
fn source(shader: &Shader) -> Cow<'static, str> {
    match quotient() {
        1.0 => shader.source.into(),
        factor => perturbed(shader.source, factor).into(),
    }
}

impl Gpu {
    /// Compiles the pipelines that are not there yet, each on a thread.
    pub(super) fn compile<'a>(&self, keys: impl Iterator<Item = &'a PipelineKey>) {
        let missing: HashMap<_, _> = {
            let pipelines = lock(&self.pipelines);
            keys.filter(|key| !pipelines.contains_key(&key.name())).map(|key| (key.name(), key)).collect()
        };
        missing.into_par_iter().for_each(|(_, key)| drop(self.pipeline(key)));
    }

    /// A pipeline, compiled on its first use.
    pub(super) fn pipeline(&self, key: &PipelineKey) -> Arc<wgpu::ComputePipeline> {
        if let Some(pipeline) = lock(&self.pipelines).get(&key.name()) {
            return Arc::clone(pipeline);
        }
        let PipelineKey { shader, channels, layout } = key;
        let module = self.module(shader);
        let layout = self.layout(shader.name, layout);
        let constants = shader.constants(*channels);
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(shader.name),
            layout: Some(&layout),
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &constants,
                ..Default::default()
            },
            cache: None,
        });
        Arc::clone(lock(&self.pipelines).entry(key.name()).or_insert(Arc::new(pipeline)))
    }

    /// A shader, compiled.
    fn module(&self, shader: &Shader) -> wgpu::ShaderModule {
        let source = wgpu::ShaderSource::Wgsl(source(shader));
        let descriptor = wgpu::ShaderModuleDescriptor { label: Some(shader.name), source };
        // With the counters that end endless loops, drivers would not unroll loops.
        let checks = wgpu::ShaderRuntimeChecks { force_loop_bounding: false, ..Default::default() };
        // SAFETY: the project's own shaders have no endless loop: each counts up to a bound. Every other check stays
        // on.
        unsafe { self.device.create_shader_module_trusted(descriptor, checks) }
    }

    /// The layout of a pipeline with one bind group.
    fn layout(&self, name: &'static str, group: &wgpu::BindGroupLayout) -> wgpu::PipelineLayout {
        self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(group)],
            ..Default::default()
        })
    }
}
