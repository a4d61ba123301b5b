//! Tiles in focus: all that reaches them is blurred so little that neighbouring pixels merely exchange some light.

use crate::aperture::{Aperture, EXCHANGED_PX, exchange, exchange_slope};

/// All discs up to this radius are in focus.
pub const IN_FOCUS_PX: f64 = EXCHANGED_PX;

/// The blur of pixels in focus.
#[derive(Debug, Clone, Copy)]
pub struct InFocus {
    /// Shift of the focus relative to infinity.
    s_focus: f64,
    /// See [`Aperture::loss_per_px2`].
    pub loss_per_px2: [f32; 2],
}

impl InFocus {
    pub fn new(aperture: &Aperture, s_focus: f64) -> InFocus {
        InFocus { s_focus, loss_per_px2: aperture.loss_per_px2() }
    }

    /// The weights of a neighbour in the same row and in the same column, for a surface of shift `s` relative to
    /// infinity.
    #[inline(always)]
    pub fn weights(&self, s: f32) -> [f32; 2] {
        let t = (f64::from(s) - self.s_focus) as f32;
        self.loss_per_px2.map(|loss| exchange(loss, t))
    }

    /// By how much these weights rise with each pixel of shift.
    pub fn slopes(&self, s: f32) -> [f32; 2] {
        let t = (f64::from(s) - self.s_focus) as f32;
        self.loss_per_px2.map(|loss| exchange_slope(loss, t))
    }
}
