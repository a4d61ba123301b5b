//! The opening: its shape, its transmission, and its lens points.

use super::outline::Outline;
use super::picture::Picture;
use super::profile::{Profile, Side};
use crate::error::{Result, value_error};
use std::f64::consts::TAU;
use std::sync::Arc;

/// The source of the opening's shape.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    Outline(Outline),
    Picture(Arc<Picture>),
}

/// Deviations of an opening from a clear disc, by their public names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// Straight or curved blades.
    Blades,
    /// Curved blades.
    Roundness,
    /// An anamorphic squeeze.
    Ratio,
    /// A hole in the middle.
    Obstruction,
    /// A Gaussian transmission.
    Apodization,
    /// Light towards the rim on one side of the focus, and towards the middle on the other.
    Spherical,
    /// A picture of the transmission.
    Image,
}

impl Feature {
    /// Every feature with its name.
    pub const NAMES: [(&'static str, Feature); 7] = [
        ("blades", Feature::Blades),
        ("roundness", Feature::Roundness),
        ("ratio", Feature::Ratio),
        ("obstruction", Feature::Obstruction),
        ("apodization", Feature::Apodization),
        ("spherical", Feature::Spherical),
        ("image", Feature::Image),
    ];
}

/// The aperture: where light passes, and how much.
#[derive(Debug, Clone, PartialEq)]
pub struct Aperture {
    pub(super) shape: Shape,
    pub(super) profile: Profile,
    /// Scale along both axes; the larger one is 1.
    pub(super) squeeze: [f64; 2],
    /// See [`Aperture::leaning`].
    pub(super) lean: [f64; 2],
}

fn fraction(name: &str, value: f64, what: &str, accepted: std::ops::RangeInclusive<f64>) -> Result<f64> {
    if accepted.contains(&value) {
        Ok(value)
    } else {
        Err(value_error!(
            "{name} must be {what}, from {} to {}; got {value}",
            accepted.start(),
            accepted.end()
        ))
    }
}

impl Aperture {
    /// A clear disc.
    pub const DISC: Aperture = Aperture {
        shape: Shape::Outline(Outline::Disc),
        profile: Profile::FLAT,
        squeeze: [1.0; 2],
        lean: [0.0; 2],
    };

    /// A disc (`blades = 0`) or a regular polygon, with an optional Gaussian transmission.
    pub fn new(blades: u32, rotation_deg: f64, apodization: Option<f64>) -> Result<Aperture> {
        if !(blades == 0 || (3..=64).contains(&blades)) {
            return Err(value_error!("blades must be 0 (a disc) or from 3 to 64; got {blades}"));
        }
        if !rotation_deg.is_finite() {
            return Err(value_error!("rotation must be a finite angle in degrees; got {rotation_deg}"));
        }
        if let Some(sigma) = apodization
            && !(sigma.is_finite() && sigma >= 0.05)
        {
            return Err(value_error!(
                "apodization must be the standard deviation of the transmission as a fraction of the aperture \
                 radius, at least 0.05; got {sigma}"
            ));
        }
        let outline = match blades {
            0 => Outline::Disc,
            _ => Outline::Blades {
                blades,
                first_angle: rotation_deg.to_radians().rem_euclid(TAU),
                roundness: 0.0,
            },
        };
        let profile = Profile { apodization, ..Profile::FLAT };
        Ok(Aperture { shape: Shape::Outline(outline), profile, ..Aperture::DISC })
    }

    /// An opening given by a picture.
    pub fn of_picture(picture: Picture) -> Aperture {
        Aperture { shape: Shape::Picture(Arc::new(picture)), ..Aperture::DISC }
    }

    /// The same with curved blades: 0 is straight, 1 makes them arcs of one circle.
    pub fn with_roundness(mut self, roundness: f64) -> Result<Aperture> {
        let given = fraction("roundness", roundness, "how much the blades bulge", 0.0..=1.0)?;
        if let Shape::Outline(Outline::Blades { roundness, .. }) = &mut self.shape {
            *roundness = given;
        } else if given != 0.0 {
            return Err(value_error!("roundness is for blades, and there are none; got {given}"));
        }
        Ok(self)
    }

    /// The same with an anamorphic squeeze: `ratio` times as high as wide. The longer half-axis keeps its length.
    pub fn with_ratio(self, ratio: f64) -> Result<Aperture> {
        fraction("ratio", ratio, "the height of the opening over its width", 0.05..=20.0)?;
        Ok(Aperture { squeeze: [ratio.recip().min(1.0), ratio.min(1.0)], ..self })
    }

    /// The same with a central obstruction, up to this fraction of the distance to the rim.
    pub fn with_obstruction(self, obstruction: f64) -> Result<Aperture> {
        let hole = fraction(
            "obstruction",
            obstruction,
            "the part of the way to the rim that is closed",
            0.0..=0.95,
        )?;
        Ok(Aperture { profile: Profile { hole, ..self.profile }, ..self })
    }

    /// The same with spherical aberration; see [`Profile`].
    pub fn with_spherical(self, spherical: f64) -> Result<Aperture> {
        let spherical = fraction("spherical", spherical, "the strength of the aberration", -1.0..=1.0)?;
        Ok(Aperture { profile: Profile { spherical, ..self.profile }, ..self })
    }

    /// The opening under a focus plane that is tilted by `lean` of shift per pixel.
    ///
    /// With such a plane the ray from lens point `l` goes through `l / (1 - lean . l)`; see
    /// [`FocusSurface`](crate::optics::FocusSurface). Points are scaled down by the farthest one, `1 / (1 - |lean|)`,
    /// to stay in the unit disc; the strength of the lens has to be scaled up by as much.
    pub fn leaning(&self, lean: [f64; 2]) -> Aperture {
        Aperture { lean, ..self.clone() }
    }

    /// See [`Aperture::leaning`].
    pub fn lean(&self) -> [f64; 2] {
        self.lean
    }

    /// Its deviations from a clear disc.
    pub fn features(&self) -> Vec<Feature> {
        let (outline, picture) = match &self.shape {
            Shape::Outline(outline) => (*outline, false),
            Shape::Picture(_) => (Outline::Disc, true),
        };
        let rounded = matches!(outline, Outline::Blades { roundness, .. } if roundness > 0.0);
        [
            (Feature::Blades, outline != Outline::Disc),
            (Feature::Roundness, rounded),
            (Feature::Ratio, self.squeeze != [1.0; 2]),
            (Feature::Obstruction, self.profile.hole > 0.0),
            (Feature::Apodization, self.profile.apodization.is_some()),
            (Feature::Spherical, self.profile.spherical != 0.0),
            (Feature::Image, picture),
        ]
        .into_iter()
        .filter_map(|(feature, has)| has.then_some(feature))
        .collect()
    }

    /// The number of blades, and the angle of the first corner in radians counter-clockwise on screen from the x
    /// axis, if the opening is a regular polygon of straight blades; `None` otherwise.
    pub fn polygon(&self) -> Option<(u32, f64)> {
        match &self.shape {
            Shape::Outline(outline) if self.squeeze == [1.0; 2] => outline.polygon(),
            _ => None,
        }
    }

    /// Whether all light passes everywhere inside the outline.
    pub fn is_clear(&self) -> bool {
        self.profile == Profile::FLAT && matches!(self.shape, Shape::Outline(_))
    }

    /// Whether the opening is a disc, whatever its transmission.
    pub fn is_round(&self) -> bool {
        self.shape == Shape::Outline(Outline::Disc) && self.squeeze == [1.0; 2]
    }

    /// Whether the distribution of light differs in front of the focus and behind it.
    pub fn has_sides(&self) -> bool {
        self.profile.spherical != 0.0
    }

    fn squeezed(&self, l: [f64; 2]) -> [f64; 2] {
        [l[0] * self.squeeze[0], l[1] * self.squeeze[1]]
    }

    fn unsqueezed(&self, l: [f64; 2]) -> [f64; 2] {
        [l[0] / self.squeeze[0], l[1] / self.squeeze[1]]
    }

    /// The lens point of a position on the outline or in the picture.
    pub(super) fn placed(&self, l: [f64; 2]) -> [f64; 2] {
        let l = self.squeezed(l);
        if self.lean == [0.0; 2] {
            return l;
        }
        let [bx, by] = self.lean;
        let scale = (1.0 - bx.hypot(by)) / (1.0 - bx * l[0] - by * l[1]);
        l.map(|v| scale * v)
    }

    /// The position on the outline or in the picture of a lens point; the inverse of [`Aperture::placed`].
    pub(super) fn source(&self, l: [f64; 2]) -> [f64; 2] {
        let scale = self.unleaned_scale(l);
        self.unsqueezed(l.map(|v| v * scale))
    }

    /// The factor by which a lens point was scaled down: `l' = c l / (1 - b . l)` solved for `l` is
    /// `l' / (c + b . l')`.
    fn unleaned_scale(&self, l: [f64; 2]) -> f64 {
        let [bx, by] = self.lean;
        1.0 / (1.0 - bx.hypot(by) + bx * l[0] + by * l[1])
    }

    /// The position in the opening itself at which a lens point is seen.
    pub fn pupil(&self, l: [f64; 2]) -> [f64; 2] {
        let scale = self.unleaned_scale(l);
        l.map(|v| scale * v)
    }

    /// The density of the lens points of [`Aperture::placed`], relative to the densest: up to a constant, the map
    /// back to the lens magnifies areas by the third power of its scale.
    pub(super) fn density(&self, l: [f64; 2]) -> f64 {
        if self.lean == [0.0; 2] {
            return 1.0;
        }
        let densest = 1.0 / (1.0 - 2.0 * self.lean[0].hypot(self.lean[1]));
        (self.unleaned_scale(l) / densest).powi(3)
    }

    /// The part of the light that passes at a lens point inside the opening.
    pub fn transmission(&self, l: [f64; 2]) -> f64 {
        self.profile.transmission(self.rim_fraction(l))
    }

    /// Area of the opening relative to that of its enclosing disc.
    pub fn relative_area(&self) -> f64 {
        let area = match &self.shape {
            Shape::Outline(outline) => outline.relative_area() * (1.0 - self.profile.hole.powi(2)),
            Shape::Picture(picture) => picture.relative_area(),
        };
        area * self.squeeze[0] * self.squeeze[1]
    }

    /// The rim point before which the fraction `v` of the opening's area lies, going round.
    pub fn rim(&self, v: f64) -> [f64; 2] {
        match &self.shape {
            Shape::Outline(outline) => self.placed(outline.rim(v)),
            Shape::Picture(_) => self.placed(Outline::Disc.rim(v)),
        }
    }

    /// The position of a lens point between the centre (0) and the rim (1).
    pub fn rim_fraction(&self, l: [f64; 2]) -> f64 {
        match &self.shape {
            Shape::Outline(outline) => outline.rim_fraction(self.unsqueezed(l)),
            Shape::Picture(_) => Outline::Disc.rim_fraction(self.unsqueezed(l)),
        }
    }

    /// The positions in the opening itself of the rays of [`Aperture::lens_points`].
    pub fn pupil_points(&self, n: usize) -> Vec<[f64; 2]> {
        self.unaberrated().lens_points(n, Side::Behind)
    }

    /// The lens point through which the ray through a point of the opening seems to come, for surfaces on one side of the
    /// focus. Points on a ray from the middle keep the light between them and the middle.
    pub fn lens_point(&self, pupil: [f64; 2], side: Side) -> [f64; 2] {
        let l = self.unsqueezed(pupil);
        let Shape::Outline(outline) = &self.shape else { return self.placed(l) };
        let rho = outline.rim_fraction(l).min(1.0);
        if self.profile.spherical == 0.0 || rho <= self.profile.hole {
            return self.placed(l);
        }
        let own = Profile { spherical: 0.0, ..self.profile };
        let moved = self.profile.quantile(own.light_within(rho), side) / rho;
        self.placed(l.map(|v| moved * v))
    }

    /// The opening itself, of the light that passes it: without what the focus plane and aberrations make of it.
    pub fn unaberrated(&self) -> Aperture {
        let profile = Profile { spherical: 0.0, ..self.profile };
        Aperture { profile, lean: [0.0; 2], ..self.clone() }
    }

    /// `n` points of equal weight over the opening, for surfaces on one side of the focus: a Fibonacci (Kronecker)
    /// lattice in coordinates of equal light. Points with the same number on both sides belong to the same ray.
    pub fn lens_points(&self, n: usize, side: Side) -> Vec<[f64; 2]> {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        (0..n)
            .map(|i| {
                let (u, v) = ((i as f64 + 0.5) / n as f64, (0.5 + i as f64 * GOLDEN).fract());
                match &self.shape {
                    Shape::Outline(outline) => {
                        let rho = self.profile.quantile(u, side);
                        self.placed(outline.rim(v).map(|rim| rho * rim))
                    }
                    Shape::Picture(picture) => self.placed(picture.place(u, v)),
                }
            })
            .collect()
    }
}
