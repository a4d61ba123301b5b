//! The image of one frame through a lens.

use super::defocus::Optics;
use super::disparity_map::{DisparityMap, MaxRadius};
use super::lens::{Base, Lens, Strength};
use super::surface::FocusSurface;
use super::transverse::Transverse;
use crate::depth::Rays;
use crate::error::Result;

/// A frame of pixels: the output, with a margin and with pixels finer by a whole factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Columns of the output, which the field of view spans.
    pub width: usize,
    /// Rows of the output.
    pub height: usize,
    /// Number of pixels per pixel of the output, along each axis.
    pub finer: usize,
    /// Pixels of the output added on every side.
    pub margin: usize,
}

/// The second stop, in the barrel of a lens. As seen from pixel `p`, it is displaced across the opening to
/// `c(p) = per_px (p - centre)`, in radii of the opening, and clips it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SecondStop {
    /// The pixel on the axis.
    pub centre: [f64; 2],
    /// Displacement per pixel, in radii of the opening.
    pub per_px: f64,
}

impl SecondStop {
    /// The same for the part of the frame that begins with row `y`.
    pub fn rows_from(&self, y: usize) -> SecondStop {
        SecondStop { centre: [self.centre[0], self.centre[1] - y as f64], ..*self }
    }

    /// The centre of the second stop, as seen from a pixel.
    #[inline(always)]
    pub fn stop(&self, x: f64, y: f64) -> [f64; 2] {
        [self.per_px * (x - self.centre[0]), self.per_px * (y - self.centre[1])]
    }
}

/// The falloff: how the picture darkens away from the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Falloff {
    /// The pixel on the axis.
    pub centre: [f64; 2],
    /// Whether the light that the second stop clips is missing.
    pub optical: bool,
    /// Focal length in pixels, if light falls off with the fourth power of the cosine.
    pub natural_focal_px: Option<f64>,
}

impl Falloff {
    /// The fourth power of the cosine of the angle between the axis and a pixel's ray.
    #[inline(always)]
    pub fn cos4(&self, x: f64, y: f64) -> f64 {
        self.natural_focal_px.map_or(1.0, |f| {
            let (x, y) = ((x - self.centre[0]) / f, (y - self.centre[1]) / f);
            (1.0 + x * x + y * y).powi(-2)
        })
    }
}

/// All properties of a lens that a frame needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Imaging {
    /// The thin lens on the axis.
    pub optics: Optics,
    /// The focus surface of the rest of the picture.
    pub surface: FocusSurface,
    /// Least and greatest disparity in focus on the axis, if that is a range.
    pub in_focus: Option<[f64; 2]>,
    /// The largest radius of circles of confusion, but for what axial colour adds to it.
    pub max_radius: Option<MaxRadius>,
    /// The change of the disparity in focus for red, green and blue.
    pub axial_color: [f64; 3],
    /// Magnification of the red, green and blue pictures about [`FocusSurface::centre`].
    pub magnification: [f64; 3],
    /// The second stop, if the lens has one that clips.
    pub second_stop: Option<SecondStop>,
    /// The falloff, if the picture darkens.
    pub falloff: Option<Falloff>,
    /// Where rays land other than those of a thin lens, if they do.
    pub transverse: Option<Transverse>,
}

impl Imaging {
    /// The same for the part of the frame that begins with row `y`.
    pub fn rows_from(&self, y: usize) -> Imaging {
        let moved = |[cx, cy]: [f64; 2]| [cx, cy - y as f64];
        let surface = FocusSurface { centre: moved(self.surface.centre), ..self.surface };
        let second_stop = self.second_stop.map(|own| own.rows_from(y));
        let falloff = self.falloff.map(|own| Falloff { centre: moved(own.centre), ..own });
        let transverse = self.transverse.as_ref().map(|own| own.rows_from(y));
        Imaging { surface, second_stop, falloff, transverse, ..self.clone() }
    }

    /// The map of the picture's disparity to that for which this is a plain lens.
    pub fn disparity_map(&self) -> DisparityMap {
        DisparityMap::new(&self.optics, self.surface, self.in_focus, self.max_radius)
    }

    /// The nearest and the farthest distance in metres no more blurred than this radius, on the axis. Of a metric scene
    /// only.
    pub fn limits_m(&self, radius_px: f64) -> (f64, f64) {
        let [farthest, nearest] = self.in_focus.unwrap_or([self.optics.d_focus; 2]);
        let at = |d_focus| Optics { d_focus, ..self.optics }.limits_m(radius_px);
        (at(nearest).0, at(farthest).1)
    }

    /// The optics of one channel. Channels beyond three, which are coverage, have green's.
    pub fn optics_of(&self, channel: usize) -> Optics {
        let axial = self.axial_color.get(channel).unwrap_or(&self.axial_color[1]);
        Optics { d_focus: self.optics.d_focus + axial, ..self.optics }
    }

    /// The magnification of a channel; channels beyond three have green's.
    pub fn magnification_of(&self, channel: usize) -> f64 {
        *self.magnification.get(channel).unwrap_or(&self.magnification[1])
    }

    /// Whether the focus of the three colours differs.
    pub fn is_axially_chromatic(&self) -> bool {
        self.axial_color != [self.axial_color[0]; 3]
    }

    /// Whether the magnification of the three colours differs.
    pub fn is_laterally_chromatic(&self) -> bool {
        self.magnification != [self.magnification[0]; 3]
    }

    /// Whether any channel is magnified.
    pub fn is_magnified(&self) -> bool {
        self.magnification != [1.0; 3]
    }
}

impl Frame {
    /// A frame without margin and without finer pixels.
    pub fn plain(width: usize, height: usize) -> Frame {
        Frame { width, height, finer: 1, margin: 0 }
    }

    /// The thin lens on the axis.
    pub fn optics(&self, lens: &Lens) -> Optics {
        let optics = match lens.base {
            Base::Thin { aperture_radius, focus_distance, .. } => Optics {
                k: aperture_radius * lens.focal_px(self.width, self.height).unwrap_or(0.0),
                d_focus: 1.0 / focus_distance,
            },
            Base::Relative { strength, focus_disparity } => {
                let k = match strength {
                    Strength::Px(px) => px,
                    Strength::Percent(percent) => 0.01 * percent * self.width as f64,
                };
                Optics { k, d_focus: focus_disparity }
            }
        };
        Optics { k: optics.k * self.finer as f64, ..optics }
    }

    /// Focal length in pixels of this frame.
    pub fn focal_px(&self, lens: &Lens) -> Option<f64> {
        lens.focal_px(self.width, self.height).map(|f| f * self.finer as f64)
    }

    /// The pixel on the optical axis; pixel centres have integer coordinates.
    pub fn centre(&self, lens: &Lens) -> [f64; 2] {
        let along = |n: usize, offset: f64| {
            (n as f64 * (0.5 + offset) + self.margin as f64) * self.finer as f64 - 0.5
        };
        let [x, y] = lens.mount.principal_point;
        [along(self.width, x), along(self.height, y)]
    }

    /// The directions of its pixels' rays; `None` for a lens over relative disparity, for which they are not known.
    pub fn rays(&self, lens: &Lens) -> Option<Rays> {
        self.focal_px(lens).map(|focal_px| Rays { focal_px, centre: self.centre(lens) })
    }

    /// All properties of a lens that this frame needs.
    pub fn imaging(&self, lens: &Lens) -> Result<Imaging> {
        let (mut optics, centre, focal_px) = (self.optics(lens), self.centre(lens), self.focal_px(lens));
        let in_focus = lens.disparities_in_focus().filter(|[least, most]| least < most);
        if in_focus.is_some() {
            // All of the range becomes this disparity and is stored as f32: then its radius is exactly 0.
            optics.d_focus = f64::from(optics.d_focus as f32);
        }
        let surface = lens.focus_surface(focal_px, centre);
        surface.lean(optics.k)?;
        let half_diagonal = 0.5 * (self.width as f64).hypot(self.height as f64) * self.finer as f64;
        let aberrations = &lens.aberrations;
        let vignetting = aberrations.vignetting;
        let breathing = lens.magnification();
        Ok(Imaging {
            optics,
            surface,
            in_focus,
            max_radius: None,
            axial_color: aberrations.axial_color,
            magnification: aberrations.lateral_color.map(|less_1| breathing * (1.0 + less_1)),
            second_stop: (aberrations.cat_eye > 0.0)
                .then(|| SecondStop { centre, per_px: aberrations.cat_eye / half_diagonal }),
            falloff: (vignetting.is_optical() || vignetting.is_natural()).then(|| Falloff {
                centre,
                optical: vignetting.is_optical(),
                natural_focal_px: focal_px.filter(|_| vignetting.is_natural()),
            }),
            transverse: aberrations.transverse().map(|_| Transverse {
                centre,
                half_diagonal_px: half_diagonal,
                coma: aberrations.coma,
                astigmatism: aberrations.astigmatism,
                barn_doors: aberrations.barn_doors,
                map: aberrations.psf.clone(),
            }),
        })
    }
}
