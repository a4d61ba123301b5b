//! Renders a scene through a lens on a GPU; the twin of `cpu::render`.

use super::bands::{self, Band, Bytes, Requirements};
use super::commands::{Commands, PassTime, Pending};
use super::device::Gpu;
use super::magnify::{self, Sources};
use super::picture::GpuPicture;
use super::scene_cache::SceneCache;
use super::{by_focus, carried, falloff, gaussian, hexagonal, lens, levels, poisson, resolve, sprites, taps};
use crate::cancel::Cancel;
use crate::carried::Carried;
use crate::error::{Error, Result};
use crate::memory::Buffer;
use crate::method::Method;
use crate::optics::{Imaging, Optics};
use crate::picture::{Picture, Size};
use crate::plan::lens::Settings;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::magnify::Interpolation;
use crate::scene::Scene;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use std::sync::Arc;

/// Renders a scene through each of some lenses on the adapter with index `adapter` in
/// [`adapters::all`](super::adapters::all), and times all passes. One picture, or one band of it, is transferred back while the next one is computed.
pub fn render_each<'a>(
    adapter: usize,
    scope: &Scope,
    lenses: impl Iterator<Item = (&'a Imaging, &'a mut [f32])>,
) -> Result<Vec<PassTime>> {
    let (gpu, cancel) = (Gpu::open(adapter)?, scope.cancel);
    let work = || {
        let mut times = Vec::new();
        let mut finish = |(pending, out): (Pending, &mut [f32])| -> Result<()> {
            times.extend(pending.wait(cancel, out)?);
            Ok(())
        };
        let mut running = None;
        for (imaging, out) in lenses {
            let mut exposure = Exposure::new(&gpu, scope, imaging)?;
            let Some(carried) = &scope.scene.carried else {
                exposure.start_all(out, &mut running, &mut finish)?;
                continue;
            };
            let mut rendered = Buffer::unset(out.len() / carried.outputs() * carried.rendered());
            let mut running = None;
            exposure.start_all(&mut rendered, &mut running, &mut finish)?;
            running.map_or(Ok(()), &mut finish)?;
            carried.finish(&rendered, scope.scene.has_own_pixels(), out);
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

/// The input that all pictures of a scene share.
pub struct Scope<'a> {
    pub scene: &'a Scene,
    /// The data of the scene that the device keeps.
    pub cache: &'a SceneCache,
    pub method: &'a Method,
    pub simd: Simd,
    pub cancel: &'a Cancel,
}

/// The scene, and the lens through which it is rendered.
pub(super) struct Exposure<'a> {
    gpu: &'a Arc<Gpu>,
    scope: &'a Scope<'a>,
    imaging: &'a Imaging,
    /// The picture with mapped disparity.
    picture: Arc<Picture>,
    /// The source pixels of the picture, if it is magnified.
    sources: Option<Sources>,
    /// The clipping of the opening that the falloff needs.
    clip: Option<PupilClip>,
    requirements: Requirements,
    /// The bands that have not been rendered yet.
    pub(super) bands: Vec<Band>,
    /// Number of bands whose pictures stay on the device.
    kept: usize,
}

impl<'a> Exposure<'a> {
    pub(super) fn new(gpu: &'a Arc<Gpu>, scope: &'a Scope, imaging: &'a Imaging) -> Result<Exposure<'a>> {
        let scene = scope.scene;
        let picture = scene.mapped(&imaging.disparity_map());
        let interpolation = Interpolation::of(scene.carried.as_ref());
        let sources = Sources::new(imaging, picture.size, interpolation);
        let clip = scope.method.clip_of(imaging);
        let requirements = Requirements::reaching(0);
        let (bands, kept) = (Vec::new(), 1);
        let mut exposure =
            Exposure { gpu, scope, imaging, picture, sources, clip, requirements, bands, kept };
        exposure.requirements = exposure.requirements()?;
        let of_buffers = Bytes { one: gpu.most_bytes() as usize, all: usize::MAX };
        let most = Bytes { all: gpu.memory_for_frames() as usize, ..of_buffers };
        exposure.bands = exposure.split(most, 0).map_err(|least| exposure.refused(least))?;
        // If it is for the sum of all buffers that there are several bands, the device cannot hold all of them.
        let fewest = exposure.split(of_buffers, 0).map_or(0, |bands| bands.len());
        exposure.kept = if exposure.bands.len() == fewest { fewest } else { 1 };
        Ok(exposure)
    }

    /// The bands from a row on, for a device that has no more than `most`; the error is what a band needs at least.
    fn split(&self, most: Bytes, from: usize) -> std::result::Result<Vec<Band>, Bytes> {
        let Picture { size, layers, .. } = &*self.picture;
        let step = self.scope.scene.supersample;
        bands::split(most, (*size, layers.len()), self.requirements, (from, step), |rows| {
            self.sources.as_ref().map_or(rows.clone(), |sources| sources.of_rows(rows))
        })
    }

    /// The error for bands that need more than the device has.
    fn refused(&self, least: Bytes) -> Error {
        const BAND: &str = "a band of the picture";
        let Bytes { one, all } = least;
        if one as u64 > self.gpu.most_bytes() {
            return self.gpu.too_large(BAND, one as u64);
        }
        self.gpu.out_of_memory_for(BAND, all as u64)
    }

    /// Splits the rest of the picture, from a band on, into bands of half its size, or if that is too small for any, into
    /// the smallest. Gives back what the device keeps.
    fn split_more(&mut self, band: &Band) -> Result<()> {
        let Picture { size, layers, .. } = &*self.picture;
        let Bytes { one, all } = bands::bytes(band, *size, layers.len(), self.requirements);
        let mut most = Bytes { one: one.min(self.gpu.most_bytes() as usize), all: all / 2 };
        self.bands = loop {
            match self.split(most, band.rows.start) {
                Ok(bands) => break bands,
                Err(least) if least.all < all && least.one <= most.one => most.all = least.all,
                Err(_) => return Err(self.refused(Bytes { one, all })),
            }
        };
        self.kept = 1;
        self.scope.cache.clear();
        self.gpu.reclaim(self.scope.cancel)
    }

    /// Starts to compute one band after another, whose pictures go to parts of `out`. While one is computed, the one before
    /// is `running`, which is then given to `finish`; so is the last one before the next picture.
    fn start_all<'o>(
        &mut self,
        mut out: &'o mut [f32],
        running: &mut Option<(Pending, &'o mut [f32])>,
        finish: &mut impl FnMut((Pending, &mut [f32])) -> Result<()>,
    ) -> Result<()> {
        while let Some(band) = self.bands.first().cloned() {
            let next = match self.start(&band) {
                Ok(next) => next,
                Err(Error::Memory(_)) => {
                    // There is less memory than was planned with: other programs have some of it, too.
                    running.take().map_or(Ok(()), &mut *finish)?;
                    self.split_more(&band)?;
                    continue;
                }
                Err(error) => return Err(error),
            };
            self.bands.remove(0);
            let (own, behind) = out.split_at_mut(self.values_of(&band));
            out = behind;
            running.replace((next, own)).map_or(Ok(()), &mut *finish)?;
        }
        Ok(())
    }

    /// The size of the picture, with the channels that are rendered.
    fn size(&self) -> Size {
        let size = self.picture.size;
        let carried = self.scope.scene.carried.as_ref();
        Size { channels: carried.map_or(size.channels, Carried::rendered), ..size }
    }

    /// The number of output values of a band.
    fn values_of(&self, band: &Band) -> usize {
        let (size, n) = (self.size(), self.scope.scene.supersample);
        band.rows.len() / n * (size.width / n) * size.channels
    }

    /// The optics of all renders that make up the picture.
    fn optics(&self) -> impl Iterator<Item = Optics> {
        let colors = if self.imaging.is_axially_chromatic() { 0..3 } else { 1..2 };
        colors.map(|color| self.imaging.optics_of(color))
    }

    fn requirements(&self) -> Result<Requirements> {
        let largest_px = || {
            let range = self.picture.layers[0].disparity_range();
            self.optics().map(|optics| optics.largest_radius_px(range)).fold(0.0, f64::max)
        };
        let focuses = self.optics().count();
        Ok(match self.scope.method {
            Method::Lens(settings) => {
                let mut all = Requirements::reaching(0);
                for optics in self.optics() {
                    let (optics, _) = settings.leaning(self.imaging, &optics)?;
                    let carried = &self.picture.carried;
                    let of_focus = lens::requirements(&*self.layered(&optics)?, &optics).carrying(carried);
                    all = Requirements { reach_px: all.reach_px.max(of_focus.reach_px), ..of_focus };
                }
                all
            }
            Method::Poisson(settings) => poisson::requirements(settings, &self.imaging.optics),
            Method::Gaussian(_) => gaussian::requirements(),
            Method::Taps(settings) => taps::requirements(settings, &self.imaging.optics),
            Method::Hexagonal(settings) => {
                hexagonal::requirements(settings, largest_px()).for_focuses(focuses)
            }
            Method::Levels(settings) => levels::requirements(settings, largest_px()).for_focuses(focuses),
            Method::Sprites(settings) => sprites::requirements(settings, largest_px()).for_focuses(focuses),
        })
    }

    /// The layered scene for a lens that has been adapted to the focus surface.
    fn layered(&self, optics: &Optics) -> Result<Arc<LayeredScene>> {
        let Scope { scene, simd, cancel, .. } = *self.scope;
        scene.layered(&self.picture, optics, simd, cancel)
    }

    /// Starts to compute one band.
    pub(super) fn start(&self, band: &Band) -> Result<Pending> {
        let (gpu, &Scope { scene, cache, .. }) = (self.gpu, self.scope);
        let kept = self.kept;
        let picture = cache.picture(gpu, &self.picture, &band.read, kept)?;
        if let Method::Lens(settings) = self.scope.method {
            // What takes long on the CPU and is kept comes first.
            let (optics, _) = settings.leaning(self.imaging, &self.imaging.optics)?;
            self.layered(&optics)?;
        }
        gpu.guarded(|| {
            let mut commands = Commands::new(gpu, self.scope.cancel);
            let output = match &scene.carried {
                Some(carried) => self.carried(&mut commands, band, &picture, carried)?,
                None => {
                    let rendered = if self.imaging.is_axially_chromatic() {
                        by_focus::render(&mut commands, picture.size, |commands, color, channels| {
                            self.part(
                                commands,
                                band,
                                &picture,
                                Some(channels),
                                &self.imaging.optics_of(color),
                            )
                        })?
                    } else {
                        self.part(&mut commands, band, &picture, None, &self.imaging.optics_of(1))?
                    };
                    self.developed(&mut commands, band, rendered, picture.size, scene.lights)?
                }
            };
            commands.submit(&output)
        })
    }

    /// What was rendered of a band, with the operations on whole pictures, at the size of the output. The first `lights`
    /// channels hold light.
    fn developed(
        &self,
        commands: &mut Commands,
        band: &Band,
        rendered: wgpu::Buffer,
        read: Size,
        lights: usize,
    ) -> Result<wgpu::Buffer> {
        let size = Size { height: band.rows.len(), ..read };
        let full = match &self.sources {
            Some(sources) => magnify::render(commands, &rendered, read, band, sources)?,
            None if band.rows == band.read => rendered,
            None => {
                let row = size.width * size.channels * size_of::<f32>();
                let full = commands.output(size)?;
                let first = band.rows.start - band.read.start;
                commands.copy_part(&rendered, first * row, &full, 0, size.height * row);
                full
            }
        };
        if let Some(falloff) = self.imaging.rows_from(band.rows.start).falloff {
            let clip = self.clip.as_ref().map(|clip| clip.rows_from(band.rows.start));
            falloff::darken(commands, &full, size, lights, &falloff, clip.as_ref())?;
        }
        match self.scope.scene.supersample {
            1 => Ok(full),
            n => resolve::box_average(commands, &full, size, n),
        }
    }

    /// Renders a band of all channels that the picture carries, side by side in the order of their groups.
    fn carried(
        &self,
        commands: &mut Commands,
        band: &Band,
        picture: &GpuPicture,
        carried: &Carried,
    ) -> Result<wgpu::Buffer> {
        let (all, n) = (carried.rendered(), self.scope.scene.supersample);
        let output = Size { width: picture.size.width / n, height: band.rows.len() / n, channels: all };
        let side_by_side = commands.output(output)?;
        let Method::Lens(settings) = self.scope.method else {
            unreachable!("channels are for the method lens")
        };
        let mut first = 0;
        self.lens(
            commands,
            band,
            (picture, None),
            (settings, &self.imaging.optics_of(1)),
            |commands, g, group| {
                let channels = carried.groups[g].size.channels;
                let lights = carried.lights().saturating_sub(first).min(channels);
                let read = Size { channels, ..picture.size };
                let group = self.developed(commands, band, group.clone(), read, lights)?;
                let size = Size { channels, ..output };
                carried::put(commands, (&group, size), first, (&side_by_side, all))?;
                first += channels;
                Ok(())
            },
        )?;
        Ok(side_by_side)
    }

    /// Renders a band by the flagship; see [`lens::render`]. Of the channels of the `whole` picture, these are a `part` that may be rendered alone.
    fn lens(
        &self,
        commands: &mut Commands,
        band: &Band,
        (whole, part): (&GpuPicture, Option<(&GpuPicture, &[usize])>),
        (settings, optics): (&Settings, &Optics),
        take: impl FnMut(&mut Commands, usize, &wgpu::Buffer) -> Result<()>,
    ) -> Result<()> {
        let &Scope { scene, cache, simd, cancel, .. } = self.scope;
        let imaging = self.imaging.rows_from(band.read.start);
        let (optics, settings) = settings.leaning(&imaging, optics)?;
        let layered = self.layered(&optics)?;
        let (mut layered, mut cells) =
            cache.cells(commands, whole, &layered, (&band.read, self.kept), simd)?;
        let mut picture = whole;
        if let Some((part, channels)) = part {
            layered = Arc::new(layered.of_channels(channels, simd));
            cells = Arc::new(cells.of_channels(commands, channels)?);
            picture = part;
        }
        let input = lens::Input { picture, scene: &layered, cells: &cells, supersample: scene.supersample };
        lens::render(commands, &input, &optics, &settings, (simd, cancel), take)
    }

    /// Renders a band of a picture at one focus: all of its channels, or only some.
    fn part(
        &self,
        commands: &mut Commands,
        band: &Band,
        picture: &GpuPicture,
        channels: Option<&[usize]>,
        optics: &Optics,
    ) -> Result<wgpu::Buffer> {
        let (gpu, &Scope { cache, .. }) = (self.gpu, self.scope);
        let part = channels.map(|channels| picture.of_channels(commands, channels)).transpose()?;
        let whole = picture;
        let picture = part.as_ref().unwrap_or(whole);
        match self.scope.method {
            Method::Lens(settings) => {
                let mut rendered = None;
                let part = part.as_ref().zip(channels);
                self.lens(commands, band, (whole, part), (settings, optics), |_, _, own| {
                    rendered = Some(own.clone());
                    Ok(())
                })?;
                Ok(rendered.expect("a picture that carries nothing is one group"))
            }
            Method::Poisson(settings) => poisson::render(commands, picture, optics, settings),
            Method::Hexagonal(settings) => hexagonal::render(commands, picture, optics, settings),
            Method::Levels(settings) => levels::render(commands, picture, optics, settings),
            Method::Gaussian(settings) => gaussian::render(commands, picture, optics, settings),
            Method::Taps(settings) => taps::render(commands, picture, optics, settings),
            Method::Sprites(settings) => {
                let table = cache.sprites(gpu, settings, &sprites::steps(picture, optics, settings))?;
                sprites::render(commands, &table, picture, optics, settings)
            }
        }
    }
}
