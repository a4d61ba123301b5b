//! The light of a pixel.

use crate::picture::{Layer, Size};

/// Colour times coverage, and coverage.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Light<const C: usize> {
    pub color: [f32; C],
    pub coverage: f32,
}

impl<const C: usize> Light<C> {
    pub const NONE: Self = Light { color: [0.0; C], coverage: 0.0 };

    /// A part of the light of pixel `at` of the picture.
    #[inline(always)]
    pub fn of(layer: &Layer, size: Size, at: usize, part: f32) -> Self {
        let mut light = Light { color: [0.0; C], coverage: part };
        for c in 0..C {
            light.color[c] = part * layer.color[c * size.pixels() + at];
        }
        light
    }

    /// Adds other light with a weight.
    #[inline(always)]
    pub fn add(&mut self, weight: f32, light: &Light<C>) {
        for c in 0..C {
            self.color[c] += weight * light.color[c];
        }
        self.coverage += weight * light.coverage;
    }

    /// Interpolates from this light to another.
    #[inline(always)]
    pub fn mix(&self, to: &Light<C>, fraction: f32) -> Light<C> {
        let mut light = *self;
        for c in 0..C {
            light.color[c] += fraction * (to.color[c] - self.color[c]);
        }
        light.coverage += fraction * (to.coverage - self.coverage);
        light
    }
}
