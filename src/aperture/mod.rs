//! The opening of the lens: lens points for the flagship and area-exact kernels for constant depth.
//!
//! Lens coordinates have the picture's axes (x right, y down), and the unit disc bounds them. A point behind the
//! focus plane is drawn as the opening itself, a point in front of it as the opening rotated by 180 degrees.
//!
//! An opening is an [`outline`] with a [`profile`] of light from its centre to its rim, or a [`picture`]. Either maps
//! the unit square to the lens so that equal areas have equal light. So lens points have equal weights, and either
//! has an exact [`kernel`]; [`transfer`] fits small kernels to what the lens does to fine structure.

mod coverage;
mod kernel;
mod opening;
mod outline;
mod picture;
mod profile;
#[cfg(test)]
mod tests;
mod transfer;

pub use kernel::{Kernel, KernelRow};
pub use opening::{Aperture, Feature};
pub use picture::Picture;
pub use profile::Side;
pub use transfer::{EXCHANGED_PX, ROUNDING, exchange, exchange_slope};
