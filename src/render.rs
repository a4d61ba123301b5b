//! A render from end to end: a picture, what is prepared from it, and what comes out.

use crate::cancel::Cancel;
use crate::cpu::lens::Sheets;
use crate::cpu::simd::Simd;
use crate::device::Device;
use crate::error::{Result, value_error};
use crate::memory::Buffer;
use crate::optics::{Base, FocusSurface, Imaging, Lens, Optics};
use crate::picture::Picture;
use crate::{cpu, gpu, plan};
use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};

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

    /// Refuses pictures of so many layers and light channels, and lenses, that the method cannot work with. Every
    /// method honours what the thin lens itself, its focus surface or a whole picture can express.
    pub fn check(&self, lens: &Lens, layers: usize, lights: usize) -> Result<()> {
        let (name, metric_option) = self.describe();
        if layers > 1 && !matches!(self, Method::Lens(_)) {
            return Err(value_error!(
                "method={name:?} takes color and depth of one layer; got {layers} layers, which are for \
                 method=\"lens\""
            ));
        }
        if lens.flaws.cat_eye > 0.0 && !matches!(self, Method::Lens(_)) {
            return Err(value_error!(
                "lens: cat_eye is for method=\"lens\"; method={name:?} draws the same opening everywhere"
            ));
        }
        for (flaw, values) in
            [("axial_color", lens.flaws.axial_color), ("lateral_color", lens.flaws.lateral_color)]
        {
            if values != [values[0]; 3] && lights != 3 {
                return Err(value_error!(
                    "lens: {flaw} needs color of three channels, red, green and blue; got {lights}"
                ));
            }
        }
        if let (Some(option), Base::Relative { .. }) = (metric_option, lens.base) {
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

/// A picture as the focus surface of a lens has it, and its sheets for a lens of some strength.
type Prepared = (f64, FocusSurface, Arc<Sheets>);

/// A picture on its device, with what has been prepared from it.
pub struct Scene {
    pub(crate) picture: Arc<Picture>,
    /// Channels that hold light, without coverage.
    pub(crate) lights: usize,
    /// Pixels of the picture to one of the output, along each axis.
    pub(crate) supersample: usize,
    /// The picture less the focus surface last used.
    flattened: Mutex<Option<(FocusSurface, Arc<Picture>)>>,
    /// The sheets last used.
    sheets: Mutex<Option<Prepared>>,
    /// The picture on the device last used.
    pub(crate) residence: gpu::Residence,
}

impl Scene {
    /// A scene of a picture whose width and height are multiples of `supersample`, and whose first `lights` channels
    /// hold light.
    pub fn new(picture: Picture, lights: usize, supersample: usize) -> Scene {
        let picture = Arc::new(picture);
        Scene {
            picture,
            lights,
            supersample,
            flattened: Mutex::new(None),
            sheets: Mutex::new(None),
            residence: gpu::Residence::default(),
        }
    }

    /// The picture for which this focus surface is a plane that faces the camera.
    ///
    /// No lock is ever held over parallel work: a worker that waits inside it may be handed another render of
    /// the same scene, and would wait for itself.
    pub(crate) fn flattened(&self, surface: &FocusSurface) -> Arc<Picture> {
        if surface.is_facing() {
            return Arc::clone(&self.picture);
        }
        // A poisoned lock only means that another render was interrupted; what it holds is whole or absent.
        let cached = || self.flattened.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand = cached().as_ref().filter(|(own, _)| own == surface).map(|(_, p)| Arc::clone(p));
        at_hand.unwrap_or_else(|| {
            let picture = Arc::new(self.picture.less(|x, y| surface.offset(x, y)));
            *cached() = Some((*surface, Arc::clone(&picture)));
            picture
        })
    }

    /// The sheets of the flattened picture for this lens, made anew if those at hand are for another.
    pub(crate) fn sheets(
        &self,
        picture: &Picture,
        surface: &FocusSurface,
        optics: &Optics,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<Arc<Sheets>> {
        let cached = || self.sheets.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |(k, own, _): &&Prepared| *k == optics.k && own == surface;
        let at_hand = cached().as_ref().filter(fits).map(|(_, _, sheets)| Arc::clone(sheets));
        if let Some(sheets) = at_hand {
            cpu::lens::check_radius(picture, optics)?;
            return Ok(sheets);
        }
        let sheets = Arc::new(cpu::lens::prepare(picture, optics, simd, cancel)?);
        *cached() = Some((optics.k, *surface, Arc::clone(&sheets)));
        Ok(sheets)
    }

    /// The scene through each of some lenses, into a picture of `outs` each: interleaved, premultiplied where it has
    /// coverage. The method has been [checked](Method::check). Returns the passes that made them, in order; none on the
    /// CPU, and where a GPU keeps no time.
    pub fn render_each(
        &self,
        lenses: &[Imaging],
        method: &Method,
        device: Device,
        simd: Simd,
        cancel: &Cancel,
        outs: Vec<&mut [f32]>,
    ) -> Result<Vec<PassTime>> {
        let all = lenses.iter().zip(outs);
        match device {
            Device::Cpu => {
                for (lens, out) in all {
                    self.on_cpu(lens, method, simd, cancel, out)?;
                }
                Ok(Vec::new())
            }
            Device::Gpu(adapter) => gpu::render_each(adapter, self, all, method, simd, cancel),
        }
    }

    fn on_cpu(
        &self,
        imaging: &Imaging,
        method: &Method,
        simd: Simd,
        cancel: &Cancel,
        out: &mut [f32],
    ) -> Result<()> {
        if self.supersample == 1 {
            return self.in_full(imaging, method, simd, cancel, out);
        }
        let mut full = self.unset();
        self.in_full(imaging, method, simd, cancel, &mut full)?;
        cpu::resolve::box_average(&full, self.picture.size, self.supersample, out);
        Ok(())
    }

    /// Memory for the picture at its own size.
    fn unset(&self) -> Buffer<f32> {
        Buffer::unset(self.picture.size.pixels() * self.picture.size.channels)
    }

    /// The picture at its own size.
    fn in_full(
        &self,
        imaging: &Imaging,
        method: &Method,
        simd: Simd,
        cancel: &Cancel,
        out: &mut [f32],
    ) -> Result<()> {
        let size = self.picture.size;
        if imaging.is_magnified() {
            let mut blurred = self.unset();
            self.blurred(imaging, method, simd, cancel, &mut blurred)?;
            let magnification = |channel| imaging.magnification_of(channel);
            cpu::magnify::magnify(&blurred, size, imaging.surface.centre, magnification, cancel, out)?;
        } else {
            self.blurred(imaging, method, simd, cancel, out)?;
        }
        if let Some(falloff) = &imaging.falloff {
            let clip = clip_of(imaging, method);
            cpu::falloff::darken(out, size, self.lights, falloff, clip.as_ref());
        }
        Ok(())
    }

    /// What the method makes of the picture.
    fn blurred(
        &self,
        imaging: &Imaging,
        method: &Method,
        simd: Simd,
        cancel: &Cancel,
        out: &mut [f32],
    ) -> Result<()> {
        let surface = &imaging.surface;
        let flattened = self.flattened(surface);
        by_focus(imaging, &flattened, out, |part, out| {
            let (picture, optics, front) = (&part.picture, &part.optics, &part.picture.layers[0]);
            match method {
                Method::Lens(settings) => {
                    let (optics, settings) = leaning(imaging, optics, settings)?;
                    let all = self.sheets(&flattened, surface, &optics, simd, cancel)?;
                    let sheets = match part.channels {
                        None => all,
                        Some(channels) => Arc::new(all.of_channels(channels)),
                    };
                    let input = cpu::lens::Input { picture, sheets: &sheets, supersample: self.supersample };
                    cpu::lens::render(&input, &optics, &settings, simd, cancel, out)
                }
                Method::Poisson(settings) => {
                    cpu::poisson::render(front, picture.size, optics, settings, simd, cancel, out)
                }
                Method::Gaussian(settings) => {
                    cpu::gaussian::render(front, picture.size, optics, settings, simd, cancel, out)
                }
                Method::Taps(settings) => {
                    cpu::taps::render(front, picture.size, optics, settings, simd, cancel, out)
                }
                Method::Hexagonal(settings) => {
                    cpu::hexagonal::render(front, picture.size, optics, settings, simd, cancel, out)
                }
                Method::Levels(settings) => {
                    cpu::levels::render(front, picture.size, optics, settings, simd, cancel, out)
                }
                Method::Sprites(settings) => {
                    cpu::sprites::render(front, picture.size, optics, settings, simd, cancel, out)
                }
            }
        })
    }
}

/// The lens and the opening of the flagship as the focus surface and the barrel make them.
pub(crate) fn leaning(
    imaging: &Imaging,
    optics: &Optics,
    settings: &cpu::lens::Settings,
) -> Result<(Optics, cpu::lens::Settings)> {
    let (lean, stronger) = imaging.surface.leaning(optics.k)?;
    let settings = cpu::lens::Settings {
        aperture: settings.aperture.leaning(lean),
        views: settings.views,
        barrel: imaging.barrel,
    };
    Ok((Optics { k: optics.k * stronger, ..*optics }, settings))
}

/// The channel that coverage is, in pictures of three colours.
pub(crate) const COVERAGE: usize = 3;

/// The channels that are rendered at the focus of a colour: itself, and coverage, which colours need where there is
/// one.
pub(crate) fn channels_at(color: usize, channels: usize) -> Vec<usize> {
    if channels > COVERAGE { vec![color, COVERAGE] } else { vec![color] }
}

/// What the falloff knows of the opening, where a barrel clips it.
pub(crate) fn clip_of(imaging: &Imaging, method: &Method) -> Option<cpu::lens::Clip> {
    match (method, imaging.barrel, imaging.falloff) {
        (Method::Lens(settings), Some(barrel), Some(falloff)) if falloff.optical => {
            Some(cpu::lens::Clip::new(barrel, &settings.aperture))
        }
        _ => None,
    }
}

/// What is rendered at one focus: all of a picture, or some of its channels.
struct Part<'a> {
    picture: Cow<'a, Picture>,
    channels: Option<&'a [usize]>,
    optics: Optics,
}

/// The picture with every colour rendered at its own focus, all at once where that is the same. Coverage, which colours
/// need where there is one, is green's.
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
