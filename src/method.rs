//! How to compute: the methods and their settings.

use crate::error::{Result, value_error};
use crate::optics::{Base, Imaging, Lens};
use crate::plan;
use crate::plan::lens::optical_vignetting::PupilClip;

/// The choice of a method, with its own settings.
#[derive(Debug, Clone)]
pub enum Method {
    /// The integral over the lens, with visibility for every lens sample.
    Lens(plan::lens::Settings),
    /// Taps scattered over each pixel's circle of confusion.
    Poisson(plan::poisson::Settings),
    /// A wide separable blur, composited over the picture.
    Gaussian(plan::gaussian::Settings),
    /// A few look-ups at fixed offsets.
    Taps(plan::taps::Settings),
    /// Line blurs that form a hexagon.
    Hexagonal(plan::hexagonal::Settings),
    /// Interpolation between the targets of a chain of filters.
    Levels(plan::levels::Settings),
    /// Blurred pixels drawn as sprites.
    Sprites(plan::sprites::Settings),
}

impl Method {
    /// The public name, and the option in metres that it uses, if any.
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

    /// The public name.
    pub fn name(&self) -> &'static str {
        self.describe().0
    }

    /// The clipping of the opening that the falloff needs, if there is a second stop.
    pub(crate) fn clip_of(&self, imaging: &Imaging) -> Option<PupilClip> {
        match self {
            Method::Lens(settings) => settings.clip_of(imaging),
            _ => None,
        }
    }

    /// Refuses combinations that the method does not support: numbers of layers and of light channels, and properties
    /// of the lens. Every method supports everything that the thin lens itself, its focus surface or an operation on
    /// whole pictures can express.
    pub fn check(&self, lens: &Lens, layers: usize, lights: usize) -> Result<()> {
        let (name, metric_option) = self.describe();
        if layers > 1 && !matches!(self, Method::Lens(_)) {
            return Err(value_error!(
                "method={name:?} takes color and depth of one layer; got {layers} layers, which are for \
                 method=\"lens\""
            ));
        }
        if lens.aberrations.cat_eye > 0.0 && !matches!(self, Method::Lens(_)) {
            return Err(value_error!(
                "lens: cat_eye is for method=\"lens\"; method={name:?} draws the same opening everywhere"
            ));
        }
        if let Some(name) = lens.aberrations.transverse() {
            let Method::Lens(settings) = self else {
                return Err(value_error!(
                    "lens: {name} is for method=\"lens\"; method={:?} draws the same opening everywhere",
                    self.name()
                ));
            };
            if lens.aberrations.psf.is_some() && settings.aperture.has_sides() {
                return Err(value_error!(
                    "aperture: spherical must be 0 for a lens with psf, which holds all aberrations"
                ));
            }
        }
        for (aberration, values) in
            [("axial_color", lens.aberrations.axial_color), ("lateral_color", lens.aberrations.lateral_color)]
        {
            if values != [values[0]; 3] && lights != 3 {
                return Err(value_error!(
                    "lens: {aberration} needs color of three channels, red, green and blue; got {lights}"
                ));
            }
        }
        if let (Some(option), Some(_)) = (metric_option, lens.in_focus) {
            return Err(value_error!(
                "{option} is measured from a plane in focus, and the lens has a range, in_focus; only one may be given"
            ));
        }
        if let (Some(option), Base::Relative { .. }) = (metric_option, lens.base) {
            return Err(value_error!(
                "{option} is in metres, but the lens was made by Lens.from_disparity, which knows of none"
            ));
        }
        Ok(())
    }
}
