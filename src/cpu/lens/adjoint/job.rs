//! What is differentiated, and by what.

use crate::cpu::lens::disc::Gather;
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::group::Group;
use crate::picture::Size;
use crate::plan::lens::kernels::Kernels;

/// By what the weighted sum of a rendered picture is differentiated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    Colors,
    Shifts,
    Both,
}

impl Asked {
    pub fn colors(self) -> bool {
        self != Asked::Shifts
    }

    pub fn shifts(self) -> bool {
        self != Asked::Colors
    }
}

/// A frame, and the weights of the picture that is rendered of it.
pub struct Job<'a> {
    pub frame: &'a Frame<'a>,
    pub size: Size,
    pub asked: Asked,
    pub cotangent: &'a [f32],
    /// The channels of the picture, and their exact discs.
    pub group: &'a Group<'a>,
    pub discs: Gather<'a>,
    /// The discs beside those of surfaces of one depth, if they are asked for.
    pub beside: Kernels,
}
