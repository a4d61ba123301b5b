//! Transfer functions and sample types: from the caller's samples to linear `f32` and back.

use half::f16;

/// The relation of samples to light (the colour encoding).
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
    #[inline(always)]
    pub fn decode(self, v: f32) -> f32 {
        match self {
            Transfer::Linear => v,
            Transfer::Srgb => {
                let x = (v + 0.055) / 1.055;
                // x^2.4 = x^2 (x^2)^(1/5)
                let curve = x * x * fifth_root(x * x);
                if v <= 0.04045 { v / 12.92 } else { curve }
            }
        }
    }

    /// Code value of linear light.
    #[inline(always)]
    pub fn encode(self, v: f32) -> f32 {
        match self {
            Transfer::Linear => v,
            Transfer::Srgb => {
                // x^(1 / 2.4) = x^(1/4) x^(1/6)
                let root = v.sqrt();
                let curve = 1.055 * (root.sqrt() * cube_root(root)) - 0.055;
                if v <= 0.003_130_8 { 12.92 * v } else { curve }
            }
        }
    }
}

/// A root of a positive number to a few per cent. A number's bits are approximately its logarithm; `one` are the bits
/// of 1.
#[inline(always)]
fn rough_root(z: f32, degree: f32) -> f32 {
    let one = 1.0f32.to_bits() as f32;
    f32::from_bits((one + (z.to_bits() as f32 - one) / degree) as i32 as u32)
}

/// The cube root of a positive number, by plain arithmetic that the compiler vectorises. Two steps of Halley's method
/// are made, each of which leaves about the cube of the previous error.
#[inline(always)]
fn cube_root(z: f32) -> f32 {
    let step = |y: f32| {
        let cube = y * y * y;
        y * ((cube + 2.0 * z) / (2.0 * cube + z))
    };
    step(step(rough_root(z, 3.0)))
}

/// The fifth root; see [`cube_root`].
#[inline(always)]
fn fifth_root(z: f32) -> f32 {
    let step = |y: f32| {
        let fifth = y * y * y * y * y;
        y * ((2.0 * fifth + 3.0 * z) / (3.0 * fifth + 2.0 * z))
    };
    step(step(rough_root(z, 5.0)))
}

/// A sample type of pictures.
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

/// The nearest half. Unmixed colours may be brighter than all input colours, and the largest half is 65504.
fn half(v: f32) -> f16 {
    f16::from_f32(v.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
}

macro_rules! integer_samples {
    ($($t:ty),*) => {$(
        impl Sample for $t {
            #[inline(always)]
            fn to_code(self) -> f32 {
                f32::from(self) / f32::from(<$t>::MAX)
            }
            #[inline(always)]
            fn from_code(v: f32) -> Self {
                // The cast truncates the fraction and saturates, which clamps to the range of the type.
                (v * f32::from(<$t>::MAX) + 0.5) as $t
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
    fn curves_are_those_of_the_standard() {
        // A few roundings, relative to the value from which the offset is subtracted.
        let close = |a: f32, b: f64| (f64::from(a) - b).abs() <= 7e-7 * (b.abs() + 0.055);
        for i in 0..200_000 {
            let v = (i as f32 * 1e-4).powi(3) * 1e-3;
            let x = f64::from(v);
            let linear = if v <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
            let code = if v <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
            assert!(close(Transfer::Srgb.decode(v), linear), "{v}: {}", Transfer::Srgb.decode(v));
            assert!(close(Transfer::Srgb.encode(v), code), "{v}: {}", Transfer::Srgb.encode(v));
            assert_eq!(Transfer::Srgb.encode(-v), 12.92 * -v);
            assert_eq!(Transfer::Srgb.decode(-v), -v / 12.92);
        }
        // Far beyond white, where no code value should be, they are still correct.
        assert!(close(Transfer::Srgb.encode(1e30), 1.055 * f64::from(1e30f32).powf(1.0 / 2.4)));
        assert!(close(Transfer::Srgb.decode(1e6), ((f64::from(1e6f32) + 0.055) / 1.055).powf(2.4)));
        for v in [f32::NAN, f32::INFINITY] {
            assert!(!Transfer::Srgb.decode(v).is_finite() && !Transfer::Srgb.encode(v).is_finite());
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
