//! The lens, in one place and in `f64`.
//!
//! With disparity `d = 1/z` the circle of confusion is linear in disparity. Everything else in the crate works
//! in *shift* units: `s = k d` is a disparity in pixels of circle of confusion, and
//!
//! ```text
//! t = k (d - d_focus)            signed shift in pixels: > 0 in front of the focus plane
//! radius_px = -t                 the signed radius the public `coc` reports: > 0 behind the focus plane
//! q(d) = p + t l                 where the ray through output pixel p and lens point l, |l| <= 1, meets d
//! ```
//!
//! so a whole frame needs only two numbers, `k` and `d_focus`, and no kernel needs a focal length. Further properties
//! of real lenses are added around this: a [`DisparityMap`] of the picture comes before anything else; it makes a
//! [`FocusSurface`] or a range in focus a plane, and bounds radii. Chromatic aberration is a focus and a magnification for each channel, a [`SecondStop`]
//! determines which lens points a pixel does not see, and [`Transverse`] aberrations change where rays land.

mod camera;
mod defocus;
mod disparity_map;
mod fields;
mod imaging;
mod lens;
mod lens_map;
mod surface;
mod transverse;

pub use camera::{SENSORS, Sensor};
pub use defocus::{Defocus, Measure, Optics};
pub use disparity_map::{DisparityMap, MaxRadius};
pub use fields::Fields;
pub use imaging::{Falloff, Frame, Imaging, SecondStop};
pub use lens::{Aberrations, Base, FovAxis, Lens, Mount, Strength, Vignetting};
pub use lens_map::{Deviation, LensMap};
pub use surface::FocusSurface;
pub use transverse::{BarnDoors, Course, Field, Transverse};
