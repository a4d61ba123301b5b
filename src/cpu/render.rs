//! Renders a scene through a lens on the CPU; the twin of `gpu::render`.

use super::magnify::{self, Magnified};
use super::{falloff, gaussian, hexagonal, job::Job, lens, levels, poisson, resolve, sprites, taps};
use crate::cancel::Cancel;
use crate::carried::Carried;
use crate::error::Result;
use crate::memory::Buffer;
use crate::method::Method;
use crate::optics::{Imaging, Optics};
use crate::picture::{Picture, Size, channels_at};
use crate::plan::magnify::Interpolation;
use crate::scene::Scene;
use crate::simd::Simd;
use std::borrow::Cow;
use std::sync::Arc;

/// A scene, and the lens through which it is rendered.
pub struct Exposure<'a> {
    pub scene: &'a Scene,
    pub imaging: &'a Imaging,
    pub method: &'a Method,
    pub simd: Simd,
    pub cancel: &'a Cancel,
}

impl Exposure<'_> {
    /// Renders the picture at the size of the output, interleaved, into `out`.
    pub fn render(&self, out: &mut [f32]) -> Result<()> {
        let Some(carried) = &self.scene.carried else { return self.resolved(out) };
        let pixels = out.len() / carried.outputs();
        let mut rendered = Buffer::unset(pixels * carried.rendered());
        self.resolved(&mut rendered)?;
        carried.finish(&rendered, self.scene.has_own_pixels(), out);
        Ok(())
    }

    /// Renders the picture, or the channels that it carries in their own order, at the size of the output.
    fn resolved(&self, out: &mut [f32]) -> Result<()> {
        if self.scene.supersample == 1 {
            return self.full(out);
        }
        let mut full = self.unset();
        self.full(&mut full)?;
        resolve::box_average(&full, self.size(), self.scene.supersample, out);
        Ok(())
    }

    /// The size of the picture, with the channels that are rendered.
    fn size(&self) -> Size {
        let size = self.scene.picture.size;
        let carried = self.scene.carried.as_ref();
        Size { channels: carried.map_or(size.channels, Carried::rendered), ..size }
    }

    /// Uninitialised memory for the picture at its own size.
    fn unset(&self) -> Buffer<f32> {
        Buffer::unset(self.size().pixels() * self.size().channels)
    }

    /// Renders the picture at its own size.
    fn full(&self, out: &mut [f32]) -> Result<()> {
        let Exposure { scene, imaging, cancel, .. } = *self;
        let size = self.size();
        if imaging.is_magnified() {
            let mut blurred = self.unset();
            self.blurred(&mut blurred)?;
            let magnification = |channel| imaging.magnification_of(channel);
            let interpolation = Interpolation::of(scene.carried.as_ref());
            let magnified = Magnified { size, centre: imaging.surface.centre, interpolation };
            magnify::magnify(&blurred, &magnified, magnification, cancel, out)?;
        } else {
            self.blurred(out)?;
        }
        if let Some(falloff) = &imaging.falloff {
            let clip = self.method.clip_of(imaging);
            let lights = scene.carried.as_ref().map_or(scene.lights, Carried::lights);
            falloff::darken(out, size, lights, falloff, clip.as_ref());
        }
        Ok(())
    }

    /// Runs the method on the picture.
    fn blurred(&self, out: &mut [f32]) -> Result<()> {
        let Exposure { scene, imaging, simd, cancel, .. } = *self;
        let mapped = scene.mapped(&imaging.disparity_map());
        by_focus(imaging, &mapped, out, |part, out| {
            let (picture, optics) = (&*part.picture, &part.optics);
            let job = Job { front: &picture.layers[0], size: picture.size, optics, simd, cancel };
            match self.method {
                Method::Lens(settings) => {
                    let (optics, settings) = settings.leaning(imaging, optics)?;
                    let all = scene.layered(&mapped, &optics, simd, cancel)?;
                    let layered = match part.channels {
                        None => all,
                        Some(channels) => Arc::new(all.of_channels(channels, simd)),
                    };
                    let input = lens::Input { picture, scene: &layered, supersample: scene.supersample };
                    lens::render(&input, &optics, &settings, simd, cancel, out)
                }
                Method::Poisson(settings) => poisson::render(&job, settings, out),
                Method::Gaussian(settings) => gaussian::render(&job, settings, out),
                Method::Taps(settings) => taps::render(&job, settings, out),
                Method::Hexagonal(settings) => hexagonal::render(&job, settings, out),
                Method::Levels(settings) => levels::render(&job, settings, out),
                Method::Sprites(settings) => sprites::render(&job, settings, out),
            }
        })
    }
}

/// The part of a picture that is rendered at one focus: all of it, or some of its channels.
struct Part<'a> {
    picture: Cow<'a, Picture>,
    channels: Option<&'a [usize]>,
    optics: Optics,
}

/// The picture with each colour rendered at its own focus, or all together if their focus is the same. If there is
/// coverage, each colour needs it for its render; the result keeps green's.
fn by_focus(
    imaging: &Imaging,
    picture: &Picture,
    out: &mut [f32],
    render: impl Fn(&Part, &mut [f32]) -> Result<()>,
) -> Result<()> {
    if !imaging.is_axially_chromatic() {
        let optics = imaging.optics_of(1);
        return render(&Part { picture: Cow::Borrowed(picture), channels: None, optics }, out);
    }
    let channels = picture.size.channels;
    for color in 0..3 {
        let rendered = channels_at(color, channels);
        let mut values = Buffer::unset(picture.size.pixels() * rendered.len());
        let part = Part {
            picture: Cow::Owned(picture.of_channels(&rendered)),
            channels: Some(&rendered),
            optics: imaging.optics_of(color),
        };
        render(&part, &mut values)?;
        for (i, &channel) in rendered.iter().enumerate() {
            if channel == color || color == 1 {
                let values = values.iter().skip(i).step_by(rendered.len());
                out.iter_mut().skip(channel).step_by(channels).zip(values).for_each(|(out, v)| *out = *v);
            }
        }
    }
    Ok(())
}
