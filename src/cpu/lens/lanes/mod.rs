//! The operations of the sweep and of its adjoint on a row of cells, for each instruction set.
//!
//! All implementations give the same bits: comparisons are exact, and sums are plain additions in the same order.

mod floats;
mod operations;
mod portable;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(target_arch = "x86_64")]
pub use floats::Avx2Floats;
pub use floats::{FLOATS, Floats};
pub use operations::{CellRay, HalfPlaneRow, Lanes};
pub use portable::Portable;
#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};
