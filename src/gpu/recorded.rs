//! Passes and copies that are recorded, until they are submitted.

use super::device::Gpu;
use super::pipelines::PipelineKey;

/// What is recorded.
pub enum Command {
    Pass(Pass),
    Copy { from: wgpu::Buffer, from_byte: u64, to: wgpu::Buffer, to_byte: u64, bytes: u64 },
}

/// A shader on so many workgroups.
pub struct Pass {
    pub pipeline: PipelineKey,
    pub bind_group: wgpu::BindGroup,
    pub groups: [u32; 3],
    /// The query set and the first query index for its times, if it is timed.
    pub stamps: Option<(wgpu::QuerySet, u32)>,
}

/// Commands in the form that is submitted. Pipelines that are missing are compiled first, all of them together.
pub fn encoded(gpu: &Gpu, commands: &[Command]) -> wgpu::CommandEncoder {
    gpu.compile(commands.iter().filter_map(|command| match command {
        Command::Pass(pass) => Some(&pass.pipeline),
        Command::Copy { .. } => None,
    }));
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    for command in commands {
        match command {
            Command::Pass(pass) => encode(gpu, &mut encoder, pass),
            Command::Copy { from, from_byte, to, to_byte, bytes } => {
                encoder.copy_buffer_to_buffer(from, *from_byte, to, *to_byte, *bytes);
            }
        }
    }
    encoder
}

fn encode(gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, pass: &Pass) {
    let Pass { pipeline, bind_group, groups: [x, y, z], stamps } = pass;
    let timestamp_writes = stamps.as_ref().map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
        query_set,
        beginning_of_pass_write_index: Some(*first),
        end_of_pass_write_index: Some(first + 1),
    });
    let descriptor = wgpu::ComputePassDescriptor { label: Some(pipeline.shader.name), timestamp_writes };
    let mut pass = encoder.begin_compute_pass(&descriptor);
    pass.set_pipeline(&gpu.pipeline(pipeline));
    pass.set_bind_group(0, bind_group, &[]);
    pass.dispatch_workgroups(*x, *y, *z);
}
