//! Falloff: the picture darkened away from the axis; the twin of `cpu::falloff`.

use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::lens::optical_vignetting::SecondStop;
use super::shader::{Shader, shader, shared};
use crate::error::Result;
use crate::optics::Falloff;
use crate::picture::Size;
use crate::plan::lens::optical_vignetting::PupilClip;

pub const FALLOFF: Shader = shader!("falloff", ["lens/optical_vignetting"], [Params, SecondStop]);

shared! {
    struct Params {
        size: [u32; 2],
        centre: [f32; 2],
        per_focal: f32,
        lights: u32,
        _gap: [u32; 2],
        second_stop: SecondStop,
    }
}

/// Darkens the first `lights` channels of a picture.
pub fn darken(
    commands: &mut Commands,
    picture: &wgpu::Buffer,
    size: Size,
    lights: usize,
    falloff: &Falloff,
    clip: Option<&PupilClip>,
) -> Result<()> {
    let (second_stop, open) = SecondStop::new(clip, [0.0; 2], 0);
    let params = Params {
        size: pixels(size),
        centre: falloff.centre.map(|v| v as f32),
        per_focal: falloff.natural_focal_px.map_or(0.0, f64::recip) as f32,
        lights: lights as u32,
        _gap: [0; 2],
        second_stop,
    };
    let open = commands.gpu.upload("the open parts", &open)?;
    let on_all = groups(size.width, size.height);
    commands.pass(&FALLOFF, size.channels, &params, &[Read(&open), Write(picture)], on_all)
}
