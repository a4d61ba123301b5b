//! Averages a super-sampled picture down to the pixels of the output; the twin of `cpu::resolve`.

use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::shader::{Shader, shader, shared};
use crate::error::Result;
use crate::picture::Size;

pub const RESOLVE: Shader = shader!("resolve", [], [Params]);

shared! {
    struct Params {
        size: [u32; 2],
        block: u32,
    }
}

/// The mean of every `n` x `n` block of an interleaved picture.
pub fn box_average(
    commands: &mut Commands,
    full: &wgpu::Buffer,
    size: Size,
    n: usize,
) -> Result<wgpu::Buffer> {
    let output = Size { width: size.width / n, height: size.height / n, ..size };
    let params = Params { size: pixels(output), block: n as u32 };
    let picture = commands.output(output)?;
    let groups = groups(output.width, output.height);
    commands.pass(&RESOLVE, size.channels, &params, &[Read(full), Write(&picture)], groups)?;
    Ok(picture)
}
