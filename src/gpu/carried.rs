//! Channels that a picture carries, side by side as they are rendered.

use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::shader::{Shader, shader, shared};
use crate::error::Result;
use crate::picture::Size;

pub const CARRIED: Shader = shader!("carried", [], [Params]);

shared! {
    struct Params {
        size: [u32; 2],
        all: u32,
        first: u32,
    }
}

/// Puts a group of channels of this size, the first of which has the number `first`, among `all` of a picture.
pub fn put(
    commands: &mut Commands,
    (group, size): (&wgpu::Buffer, Size),
    first: usize,
    (picture, all): (&wgpu::Buffer, usize),
) -> Result<()> {
    let params = Params { size: pixels(size), all: all as u32, first: first as u32 };
    let on_all = groups(size.width, size.height);
    commands.pass(&CARRIED, size.channels, &params, &[Read(group), Write(picture)], on_all)
}
