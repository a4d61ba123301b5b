//! Colours with different focus, each rendered separately.

use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::shader::{Shader, shader, shared};
use crate::error::Result;
use crate::picture::{COVERAGE, Size, channels_at};

pub const BY_FOCUS: Shader = shader!("by_focus", [], [Params]);

shared! {
    struct Params {
        size: [u32; 2],
        channels: u32,
        color: u32,
        coverage: u32,
    }
}

/// A picture whose colours come from `render(commands, color, channels)`; coverage is green's.
pub fn render(
    commands: &mut Commands,
    size: Size,
    render: impl Fn(&mut Commands, usize, &[usize]) -> Result<wgpu::Buffer>,
) -> Result<wgpu::Buffer> {
    const GREEN: usize = 1;
    let picture = commands.output(size)?;
    let mark = commands.mark();
    for color in 0..COVERAGE {
        commands.recycle(mark);
        let channels = channels_at(color, size.channels);
        let part = render(commands, color, &channels)?;
        let params = Params {
            size: pixels(size),
            channels: channels.len() as u32,
            color: color as u32,
            coverage: u32::from(channels.contains(&COVERAGE) && color == GREEN),
        };
        let on_all = groups(size.width, size.height);
        commands.pass(&BY_FOCUS, size.channels, &params, &[Read(&part), Write(&picture)], on_all)?;
    }
    Ok(picture)
}
