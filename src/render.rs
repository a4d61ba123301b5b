//! A render from end to end: a picture, what is prepared from it, and what comes out.

use crate::cancel::Cancel;
use crate::cpu::lens::Sheets;
use crate::cpu::simd::Simd;
use crate::device::{Device, Place};
use crate::error::{Result, value_error};
use crate::optics::{Lens, Optics};
use crate::picture::Picture;
use crate::{cpu, gpu, plan};
use std::sync::{Arc, Mutex};

/// How to compute: each method with its own settings.
#[derive(Debug, Clone)]
pub enum Method {
    /// The integral over the lens, with visibility for every lens point.
    Lens(cpu::lens::Settings),
    /// Taps scattered over each pixel's circle of confusion.
    Poisson(plan::poisson::Settings),
    /// A wide separable blur laid over the picture.
    Gaussian(plan::gaussian::Settings),
    /// A few look-ups at fixed places.
    Taps(plan::taps::Settings),
    /// Line blurs that make up a hexagon.
    Hexagonal(plan::hexagonal::Settings),
    /// Between the targets of a chain of filters.
    Levels(plan::levels::Settings),
    /// Blurred pixels drawn one by one.
    Sprites(plan::sprites::Settings),
}

impl Method {
    /// The name users give it, and the option in metres that it uses, if any.
    fn describe(&self) -> (&'static str, Option<&'static str>) {
        match self {
            Method::Lens(_) => ("lens", None),
            Method::Poisson(_) => ("poisson", None),
            Method::Gaussian(settings) => ("gaussian", settings.metric_option()),
            Method::Taps(settings) => ("taps", settings.metric_option()),
            Method::Hexagonal(_) => ("hexagonal", None),
            Method::Levels(_) => ("levels", None),
            Method::Sprites(_) => ("sprites", None),
        }
    }

    /// The name users give it.
    pub fn name(&self) -> &'static str {
        self.describe().0
    }

    /// Refuses pictures and lenses that the method cannot work with.
    pub fn check(&self, lens: &Lens, layers: usize) -> Result<()> {
        let (name, metric_option) = self.describe();
        if layers > 1 && !matches!(self, Method::Lens(_)) {
            return Err(value_error!(
                "method={name:?} takes color and depth of one layer; got {layers} layers, which are for \
                 method=\"lens\""
            ));
        }
        if let (Some(option), Lens::Relative { .. }) = (metric_option, lens) {
            return Err(value_error!(
                "{option} is in metres, but the lens was made by Lens.from_disparity, which knows of none"
            ));
        }
        Ok(())
    }
}

/// How long one pass took on a GPU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassTime {
    /// The shader.
    pub name: &'static str,
    /// Its time on the device.
    pub seconds: f64,
}

/// One picture of a scene.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// Interleaved, premultiplied where it has coverage.
    pub pixels: Vec<f32>,
    /// The passes that made it, in order; empty on the CPU, and where a GPU keeps no time.
    pub passes: Vec<PassTime>,
}

/// A picture on its device, with what has been prepared from it.
pub struct Scene {
    picture: Picture,
    /// Pixels of the picture to one of the output, along each axis.
    supersample: usize,
    /// The sheets last used, with the lens strength they were made for.
    sheets: Mutex<Option<(f64, Arc<Sheets>)>>,
    /// The picture on the device last used.
    residence: gpu::Residence,
}

impl Scene {
    /// A scene of a picture whose width and height are multiples of `supersample`.
    pub fn new(picture: Picture, supersample: usize) -> Scene {
        Scene { picture, supersample, sheets: Mutex::new(None), residence: gpu::Residence::default() }
    }

    /// The sheets for this lens, made anew if those at hand are for another strength.
    ///
    /// The lock is never held over parallel work: a worker that waits inside it may be handed another render of
    /// the same scene, and would wait for itself.
    fn sheets(&self, optics: &Optics, simd: Simd, cancel: &Cancel) -> Result<Arc<Sheets>> {
        // A poisoned lock only means that another render was interrupted; what it holds is whole or absent.
        let cached = || self.sheets.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let at_hand = cached().as_ref().filter(|(k, _)| *k == optics.k).map(|(_, sheets)| Arc::clone(sheets));
        if let Some(sheets) = at_hand {
            cpu::lens::check_radius(&self.picture, optics)?;
            return Ok(sheets);
        }
        let sheets = Arc::new(cpu::lens::prepare(&self.picture, optics, simd, cancel)?);
        *cached() = Some((optics.k, Arc::clone(&sheets)));
        Ok(sheets)
    }

    /// The scene through each of some lenses. The method has been [checked](Method::check).
    pub fn render_each(
        &self,
        optics: &[Optics],
        method: &Method,
        device: Device,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<Vec<Rendered>> {
        match device.place(method)? {
            Place::Cpu => optics.iter().map(|optics| self.on_cpu(optics, method, simd, cancel)).collect(),
            Place::Gpu(adapter) => {
                let source = gpu::Source {
                    picture: &self.picture,
                    residence: &self.residence,
                    sheets: |optics: &Optics| self.sheets(optics, simd, cancel),
                    supersample: self.supersample,
                };
                gpu::render_each(adapter, &source, optics, method, simd, cancel)
            }
        }
    }

    fn on_cpu(&self, optics: &Optics, method: &Method, simd: Simd, cancel: &Cancel) -> Result<Rendered> {
        let (picture, size, front) = (&self.picture, self.picture.size, &self.picture.layers[0]);
        let full = match method {
            Method::Lens(settings) => {
                let sheets = self.sheets(optics, simd, cancel)?;
                cpu::lens::render(picture, &sheets, optics, settings, self.supersample, simd, cancel)
            }
            Method::Poisson(settings) => cpu::poisson::render(front, size, optics, settings, simd, cancel),
            Method::Gaussian(settings) => cpu::gaussian::render(front, size, optics, settings, simd, cancel),
            Method::Taps(settings) => cpu::taps::render(front, size, optics, settings, simd, cancel),
            Method::Hexagonal(settings) => {
                cpu::hexagonal::render(front, size, optics, settings, simd, cancel)
            }
            Method::Levels(settings) => cpu::levels::render(front, size, optics, settings, simd, cancel),
            Method::Sprites(settings) => cpu::sprites::render(front, size, optics, settings, simd, cancel),
        }?;
        let pixels = match self.supersample {
            1 => full,
            n => cpu::resolve::box_average(&full, size, n),
        };
        Ok(Rendered { pixels, passes: Vec::new() })
    }
}
