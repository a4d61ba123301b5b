//! Quads that are blended into render targets.

use super::commands::{Bound, Commands};
use super::device::{Gpu, lock};
use super::shader::Shader;
use crate::error::Result;
use bytemuck::Pod;
use std::sync::Arc;
use wgpu::TextureFormat::{R32Float, Rgba32Float};

/// The rows of a target must begin at multiples of this number of values when it is copied.
const ROW_VALUES: usize = (wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize) / size_of::<f32>();

/// Instanced quads: a vertex shader for their corners, and a fragment shader for their contribution to each pixel.
pub struct Draw {
    pub name: &'static str,
    pub vertex: &'static Shader,
    pub fragment: &'static Shader,
}

/// The targets into which quads are added: colour, and coverage.
pub struct Targets {
    color: wgpu::Texture,
    coverage: wgpu::Texture,
}

impl Targets {
    /// Targets of this size, if the device can blend their formats and they are not too large for it.
    pub fn new(gpu: &Gpu, width: usize, height: usize) -> Option<Targets> {
        let blends = gpu.device.features().contains(wgpu::Features::FLOAT32_BLENDABLE);
        if !blends || width.max(height) > gpu.limits.max_texture_dimension_2d as usize {
            return None;
        }
        let texture = |format| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("a target of sprites"),
                size: wgpu::Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            })
        };
        Some(Targets { color: texture(Rgba32Float), coverage: texture(R32Float) })
    }

    /// Number of values from one row to the next in buffers to which targets of this width are copied.
    pub fn pitch(width: usize) -> usize {
        width.next_multiple_of(ROW_VALUES)
    }

    /// Copies the targets to buffers.
    pub fn copy(&self, commands: &mut Commands, color: &wgpu::Buffer, coverage: &wgpu::Buffer) {
        for (texture, buffer, value) in
            [(&self.color, color, size_of::<[f32; 4]>()), (&self.coverage, coverage, size_of::<f32>())]
        {
            let size = texture.size();
            let bytes_per_row = Some((Targets::pitch(size.width as usize) * value) as u32);
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
            let buffer = wgpu::TexelCopyBufferInfo { buffer, layout };
            commands.encoder.copy_texture_to_buffer(texture.as_image_copy(), buffer, size);
        }
    }
}

impl Commands<'_> {
    /// Clears the targets and adds as many quads as the indirect `draw` (a buffer and an offset) says. Bindings are
    /// as in [`Commands::pass`], the same for both shaders.
    pub fn draw<P: Pod>(
        &mut self,
        quads: &Draw,
        channels: usize,
        params: &P,
        buffers: &[Bound],
        draw: (&wgpu::Buffer, u64),
        targets: &Targets,
    ) -> Result<()> {
        let size = targets.color.size();
        self.begin(quads.name, f64::from(size.width) * f64::from(size.height))?;
        let stages = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let (layout, bind_group) = self.bindings(quads.name, params, buffers, stages)?;
        let pipeline = pipeline(self.gpu, quads, channels, &layout);
        let views = [&targets.color, &targets.coverage].map(|target| target.create_view(&Default::default()));
        let attachments = views.each_ref().map(|view| {
            let ops = wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            };
            Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
        });
        let stamps = self.stamps();
        let timestamp_writes = stamps.as_ref().map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(*first),
            end_of_pass_write_index: Some(first + 1),
        });
        let mut pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(quads.name),
            color_attachments: &attachments,
            timestamp_writes,
            ..Default::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.draw_indirect(draw.0, draw.1);
        drop(pass);
        self.passes.push(quads.name);
        Ok(())
    }
}

/// The pipeline of a draw, compiled on its first use.
fn pipeline(
    gpu: &Gpu,
    quads: &Draw,
    channels: usize,
    layout: &wgpu::BindGroupLayout,
) -> Arc<wgpu::RenderPipeline> {
    let key = (quads.name, channels);
    if let Some(pipeline) = lock(&gpu.draws).get(&key) {
        return Arc::clone(pipeline);
    }
    let [vertex, fragment] = [quads.vertex, quads.fragment].map(|shader| gpu.module(shader));
    let [of_vertex, of_fragment] = [quads.vertex, quads.fragment].map(|shader| shader.constants(channels));
    let compiled = |constants| wgpu::PipelineCompilationOptions { constants, ..Default::default() };
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let target = |format| {
        let blend = Some(wgpu::BlendState { color: add, alpha: add });
        Some(wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL })
    };
    let layout = gpu.layout(quads.name, layout);
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(quads.name),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &vertex,
            entry_point: None,
            compilation_options: compiled(&of_vertex),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            ..Default::default()
        },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &fragment,
            entry_point: None,
            compilation_options: compiled(&of_fragment),
            targets: &[target(Rgba32Float), target(R32Float)],
        }),
        multiview_mask: None,
        cache: None,
    });
    Arc::clone(lock(&gpu.draws).entry(key).or_insert(Arc::new(pipeline)))
}
