//! The GPU path: what carries the plans out on an adapter, through `wgpu` and the shaders in `shaders/`.
//!
//! A method is a file here that uploads its plan and runs a few passes, and a shader for each pass. [`adapters`] says
//! what there is, [`device`] opens one of them, [`commands`] runs passes on it, and [`resident`] keeps a picture there.
//! [`bands`] splits frames that are too large, [`by_focus`], [`magnify`], [`falloff`] and [`resolve`] are what lenses do
//! to whole pictures.

pub mod adapters;
mod bands;
mod by_focus;
mod commands;
mod device;
mod draw;
mod falloff;
mod gaussian;
mod hexagonal;
mod lens;
mod levels;
mod magnify;
mod poisson;
mod process;
mod resident;
mod resolve;
mod shader;
mod sprites;
mod taps;
#[cfg(test)]
mod tests;

pub use resident::Residence;

use crate::cancel::Cancel;
use crate::cpu::lens::{Clip, Sheets};
use crate::cpu::simd::Simd;
use crate::error::{Error, Result};
use crate::optics::{Imaging, Optics};
use crate::picture::{Picture, Size};
use crate::render::{self, Method, PassTime, Scene};
use bands::{Band, Need};
use commands::{Commands, Pending};
use device::Gpu;
use magnify::Sources;
use resident::Resident;
use std::sync::Arc;

/// A scene through each of some lenses, from the adapter that is the `adapter`th of [`adapters::all`], with the times of
/// all passes. One picture, or one band of it, comes back while the next one is computed.
pub fn render_each<'a>(
    adapter: usize,
    scene: &Scene,
    lenses: impl Iterator<Item = (&'a Imaging, &'a mut [f32])>,
    method: &Method,
    simd: Simd,
    cancel: &Cancel,
) -> Result<Vec<PassTime>> {
    let gpu = Gpu::open(adapter)?;
    let job = Job { gpu: &gpu, scene, method, simd, cancel };
    let work = || {
        let mut times = Vec::new();
        let mut finish = |(pending, out): (Pending, &mut [f32])| -> Result<()> {
            times.extend(pending.wait(cancel, out)?);
            Ok(())
        };
        let mut running: Option<(Pending, &mut [f32])> = None;
        for (imaging, mut out) in lenses {
            let exposure = Exposure::new(&job, imaging)?;
            for band in &exposure.bands {
                let next = exposure.start(band)?;
                let (own, behind) = out.split_at_mut(exposure.values_of(band));
                out = behind;
                running.replace((next, own)).map_or(Ok(()), &mut finish)?;
            }
        }
        running.map_or(Ok(()), &mut finish)?;
        Ok(times)
    };
    work().inspect_err(|error| {
        if matches!(error, Error::Device(_)) {
            gpu.retire();
        }
    })
}

/// What all pictures of a scene have in common.
struct Job<'a> {
    gpu: &'a Arc<Gpu>,
    scene: &'a Scene,
    method: &'a Method,
    simd: Simd,
    cancel: &'a Cancel,
}

/// The scene through one lens.
struct Exposure<'a> {
    job: &'a Job<'a>,
    imaging: &'a Imaging,
    /// The picture less the focus surface.
    picture: Arc<Picture>,
    /// Where a magnified picture comes from.
    sources: Option<Sources>,
    /// What the falloff knows of the opening.
    clip: Option<Clip>,
    bands: Vec<Band>,
}

impl<'a> Exposure<'a> {
    fn new(job: &'a Job, imaging: &'a Imaging) -> Result<Exposure<'a>> {
        let scene = job.scene;
        let picture = scene.flattened(&imaging.surface);
        let sources = Sources::new(imaging, picture.size);
        let clip = render::clip_of(imaging, job.method);
        let mut exposure = Exposure { job, imaging, picture, sources, clip, bands: Vec::new() };
        let need = exposure.need()?;
        let Picture { size, layers } = &*exposure.picture;
        exposure.bands = bands::split(job.gpu, *size, layers.len(), need, scene.supersample, |rows| {
            exposure.sources.as_ref().map_or(rows.clone(), |sources| sources.of_rows(rows))
        })?;
        Ok(exposure)
    }

    /// How many values of the output a band makes.
    fn values_of(&self, band: &Band) -> usize {
        let (size, n) = (self.picture.size, self.job.scene.supersample);
        band.rows.len() / n * (size.width / n) * size.channels
    }

    /// The lenses that the picture is rendered through.
    fn optics(&self) -> impl Iterator<Item = Optics> {
        let colors = if self.imaging.is_axially_chromatic() { 0..3 } else { 1..2 };
        colors.map(|color| self.imaging.optics_of(color))
    }

    fn need(&self) -> Result<Need> {
        let largest_px = || {
            let range = self.picture.layers[0].disparity_range();
            self.optics().map(|optics| optics.largest_radius_px(range)).fold(0.0, f64::max)
        };
        Ok(match self.job.method {
            Method::Lens(settings) => {
                let mut need = Need::reaching(0);
                for optics in self.optics() {
                    let (optics, _) = render::leaning(self.imaging, &optics, settings)?;
                    let of_focus = lens::need(&*self.sheets(&optics)?, &optics);
                    need = Need { reach_px: need.reach_px.max(of_focus.reach_px), ..of_focus };
                }
                need
            }
            Method::Poisson(settings) => poisson::need(settings, &self.imaging.optics),
            Method::Gaussian(_) => gaussian::need(),
            Method::Taps(settings) => taps::need(settings, &self.imaging.optics),
            Method::Hexagonal(settings) => hexagonal::need(settings, largest_px()),
            Method::Levels(settings) => levels::need(settings, largest_px()),
            Method::Sprites(settings) => sprites::need(settings, largest_px()),
        })
    }

    /// The sheets of the picture, for a lens that has been adapted to the focus surface.
    fn sheets(&self, optics: &Optics) -> Result<Arc<Sheets>> {
        let Job { scene, simd, cancel, .. } = *self.job;
        scene.sheets(&self.picture, &self.imaging.surface, optics, simd, cancel)
    }

    /// Begins to compute one band.
    fn start(&self, band: &Band) -> Result<Pending> {
        let Job { gpu, scene, .. } = *self.job;
        let bands = self.bands.len();
        let picture = scene.residence.picture(gpu, &self.picture, &band.read, bands)?;
        if let Method::Lens(settings) = self.job.method {
            // What takes long on the CPU, and is kept, comes first.
            let (optics, _) = render::leaning(self.imaging, &self.imaging.optics, settings)?;
            scene.residence.cells(gpu, &self.sheets(&optics)?, &band.read, bands)?;
        }
        gpu.guarded(|| {
            let mut commands = Commands::new(gpu);
            let rendered = if self.imaging.is_axially_chromatic() {
                by_focus::render(&mut commands, picture.size, |commands, color, channels| {
                    let part = picture.of_channels(commands, channels)?;
                    self.part(commands, band, &part, Some(channels), &self.imaging.optics_of(color))
                })?
            } else {
                self.part(&mut commands, band, &picture, None, &self.imaging.optics_of(1))?
            };
            let size = Size { height: band.rows.len(), ..picture.size };
            let full = match &self.sources {
                Some(sources) => magnify::render(&mut commands, &rendered, picture.size, band, sources)?,
                None if band.rows == band.read => rendered,
                None => {
                    let row = size.width * size.channels * size_of::<f32>();
                    let full = commands.output(size)?;
                    let first = band.rows.start - band.read.start;
                    commands.copy_part(&rendered, first * row, &full, 0, size.height * row);
                    full
                }
            };
            if let Some(falloff) = self.imaging.from_row(band.rows.start).falloff {
                let clip = self.clip.as_ref().map(|clip| clip.from_row(band.rows.start));
                falloff::darken(&mut commands, &full, size, scene.lights, &falloff, clip.as_ref())?;
            }
            let output = match scene.supersample {
                1 => full,
                n => resolve::box_average(&mut commands, &full, size, n)?,
            };
            commands.submit(&output)
        })
    }

    /// What one focus makes of a band: of all its channels, or of some, which `picture` then has alone.
    fn part(
        &self,
        commands: &mut Commands,
        band: &Band,
        picture: &Resident,
        channels: Option<&[usize]>,
        optics: &Optics,
    ) -> Result<wgpu::Buffer> {
        let Job { gpu, scene, simd, cancel, .. } = *self.job;
        match self.job.method {
            Method::Lens(settings) => {
                let imaging = self.imaging.from_row(band.read.start);
                let (optics, settings) = render::leaning(&imaging, optics, settings)?;
                let sheets = self.sheets(&optics)?;
                let (mut sheets, mut cells) =
                    scene.residence.cells(gpu, &sheets, &band.read, self.bands.len())?;
                if let Some(channels) = channels {
                    sheets = Arc::new(sheets.of_channels(channels));
                    cells = Arc::new(cells.of_channels(commands, channels)?);
                }
                let input =
                    lens::Input { picture, sheets: &sheets, cells: &cells, supersample: scene.supersample };
                lens::render(commands, &input, &optics, &settings, simd, cancel)
            }
            Method::Poisson(settings) => poisson::render(commands, picture, optics, settings),
            Method::Hexagonal(settings) => hexagonal::render(commands, picture, optics, settings),
            Method::Levels(settings) => levels::render(commands, picture, optics, settings),
            Method::Gaussian(settings) => gaussian::render(commands, picture, optics, settings),
            Method::Taps(settings) => taps::render(commands, picture, optics, settings),
            Method::Sprites(settings) => {
                sprites::render(commands, &scene.residence, picture, optics, settings)
            }
        }
    }
}
