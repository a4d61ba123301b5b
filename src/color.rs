//! Transfer functions and sample types: from what users hold to linear `f32` and back.

use half::f16;

/// How samples stand for light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transfer {
    /// Proportional to light.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
}

impl Transfer {
    /// Every transfer with the name users give it.
    pub const NAMES: [(&'static str, Transfer); 2] = [("linear", Transfer::Linear), ("srgb", Transfer::Srgb)];

    /// Linear light of a code value (1 is white).
    pub fn decode(self, v: f32) -> f32 {
        match self {
            Transfer::Linear => v,
            Transfer::Srgb if v <= 0.04045 => v / 12.92,
            Transfer::Srgb => ((v + 0.055) / 1.055).powf(2.4),
        }
    }

    /// Code value of linear light.
    pub fn encode(self, v: f32) -> f32 {
        match self {
            Transfer::Linear => v,
            Transfer::Srgb if v <= 0.003_130_8 => 12.92 * v,
            Transfer::Srgb => 1.055 * v.powf(1.0 / 2.4) - 0.055,
        }
    }
}

/// A sample type that pictures come in.
pub trait Sample: Copy + Send + Sync {
    /// The code value, with 1 for white in integer types.
    fn to_code(self) -> f32;
    /// The nearest sample to a code value.
    fn from_code(v: f32) -> Self;
}

macro_rules! float_samples {
    ($($t:ty, $to:expr, $from:expr;)*) => {$(
        impl Sample for $t {
            fn to_code(self) -> f32 {
                $to(self)
            }
            fn from_code(v: f32) -> Self {
                $from(v)
            }
        }
    )*};
}

float_samples! {
    f16, f16::to_f32, half;
    f32, |v| v, |v| v;
    f64, |v| v as f32, f64::from;
}

/// The nearest half: unmixed colours may be brighter than all that came in, and halves end at 65504.
fn half(v: f32) -> f16 {
    f16::from_f32(v.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
}

macro_rules! integer_samples {
    ($($t:ty),*) => {$(
        impl Sample for $t {
            fn to_code(self) -> f32 {
                f32::from(self) / f32::from(<$t>::MAX)
            }
            fn from_code(v: f32) -> Self {
                // The cast saturates, which is the clamping to the type's range.
                (v * f32::from(<$t>::MAX)).round() as $t
            }
        }
    )*};
}

integer_samples!(u8, u16);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_saturate() {
        for (v, expected) in
            [(1e9, f16::MAX), (-7e4, f16::MIN), (65504.0, f16::MAX), (1.5, f16::from_f32(1.5))]
        {
            assert_eq!(f16::from_code(v), expected);
        }
    }

    #[test]
    fn every_integer_survives_the_way_there_and_back() {
        for transfer in [Transfer::Linear, Transfer::Srgb] {
            for v in 0..=u16::MAX {
                assert_eq!(u16::from_code(transfer.encode(transfer.decode(v.to_code()))), v);
            }
            for v in 0..=u8::MAX {
                assert_eq!(u8::from_code(transfer.encode(transfer.decode(v.to_code()))), v);
            }
        }
    }
}
