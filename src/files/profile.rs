//! Colour profiles: the tone curves and primaries of an ICC profile, parsed by `moxcms`.

use super::error::Problem;
use moxcms::{ColorProfile, DataColorSpace, ProfileText, ToneReprCurve};
use rayon::prelude::*;

const ACCEPTED: &str = "profiles of RGB or grey with a tone curve for each channel, such as sRGB, Display P3 and \
                        Adobe RGB; convert the picture to one of them";

/// Codes of 16 bits, for each of which a curve has a value. A code of 8 bits is 257 times as large among them.
pub const CODES: usize = 1 << 16;

/// What a profile says of its codes.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// What it calls itself.
    pub name: String,
    /// For each channel of light, the linear light of every code. Never decreasing, from 0 to 1.
    pub curves: Vec<Vec<f32>>,
    /// From its linear light to CIE XYZ for a white of D50; the identity for grey.
    pub to_xyz: [[f64; 3]; 3],
}

/// Parses the bytes of a profile of a picture with `lights` channels of light, 1 or 3.
pub fn parse(icc: &[u8], lights: usize) -> Result<Profile, Problem> {
    let parsed = ColorProfile::new_from_slice(icc)
        .map_err(|error| Problem::Damaged(format!("its colour profile: {error}")))?;
    let name = name_of(&parsed);
    let refuse = |what: &str| Problem::Unsupported {
        found: format!("the colour profile {name:?} {what}"),
        accepted: ACCEPTED,
    };
    let trcs = match (parsed.color_space, lights) {
        (DataColorSpace::Gray, 1) => vec![&parsed.gray_trc],
        (DataColorSpace::Rgb, 3) => vec![&parsed.red_trc, &parsed.green_trc, &parsed.blue_trc],
        // Grey pictures are often said to be of the RGB space whose greys they are.
        (DataColorSpace::Rgb, 1) => vec![&parsed.green_trc],
        (space, _) => return Err(refuse(&format!("of {space:?} for a picture of {lights} channels"))),
    };
    let trcs: Option<Vec<&ToneReprCurve>> = trcs.into_iter().map(Option::as_ref).collect();
    let curves = trcs.ok_or_else(|| refuse("without tone curves"))?.into_iter().map(curve);
    let curves: Option<Vec<Vec<f32>>> = curves.collect();
    let curves = curves.ok_or_else(|| refuse("whose tone curves do not lead from black to white"))?;
    let to_xyz = match parsed.color_space {
        DataColorSpace::Rgb => parsed.colorant_matrix().v,
        _ => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };
    Ok(Profile { name, curves, to_xyz })
}

fn name_of(profile: &ColorProfile) -> String {
    let name = match &profile.description {
        Some(ProfileText::PlainString(name)) => name.as_str(),
        Some(ProfileText::Localizable(names)) => names.first().map_or("", |name| &name.value),
        Some(ProfileText::Description(name)) => &name.ascii_string,
        None => "",
    };
    // A file's own words may be of any length.
    name.trim_end_matches('\0').chars().take(80).collect()
}

/// The values of a curve, if they lead from black to white without turning back.
fn curve(curve: &ToneReprCurve) -> Option<Vec<f32>> {
    let of = |x: f64| match curve {
        ToneReprCurve::Lut(table) => Some(in_table(table, x)),
        ToneReprCurve::Parametric(parameters) => parametric(parameters, x),
    };
    let values = (0..CODES).map(|code| of(code as f64 / (CODES - 1) as f64).map(|light| light as f32));
    let values: Vec<f32> = values.collect::<Option<_>>()?;
    let rising = values.iter().all(|v| v.is_finite()) && values.is_sorted();
    let ends = values[0].abs() < 0.01 && (values[CODES - 1] - 1.0).abs() < 0.01;
    (rising && ends).then_some(values)
}

/// A curve of the type "curv": an identity, a power in 256ths, or a table of even steps.
fn in_table(table: &[u16], x: f64) -> f64 {
    match *table {
        [] => x,
        [power] => x.powf(f64::from(power) / 256.0),
        _ => {
            let place = x * (table.len() - 1) as f64;
            let below = (place as usize).min(table.len() - 2);
            let (low, high) = (f64::from(table[below]), f64::from(table[below + 1]));
            (low + (place - below as f64) * (high - low)) / 65535.0
        }
    }
}

/// A curve of the type "para": of its five functions, the one with as many parameters.
fn parametric(parameters: &[f32], x: f64) -> Option<f64> {
    let parameters: Vec<f64> = parameters.iter().map(|v| f64::from(*v)).collect();
    let power = |a: f64, b: f64, g: f64| (a * x + b).max(0.0).powf(g);
    Some(match parameters[..] {
        [g] => x.powf(g),
        [g, a, b] => power(a, b, g),
        [g, a, b, c] => power(a, b, g) + c,
        [g, a, b, c, d] => {
            if x >= d {
                power(a, b, g)
            } else {
                c * x
            }
        }
        [g, a, b, c, d, e, f] => {
            if x >= d {
                power(a, b, g) + e
            } else {
                c * x + f
            }
        }
        _ => return None,
    })
}

/// Linear light of codes of `channels` channels, the first of which have curves. The code values of others stay.
pub fn decode<T: Copy + Sync>(
    codes: &[T],
    channels: usize,
    curves: &[&[f32]],
    code: impl Fn(T) -> usize + Sync,
) -> Vec<f32> {
    let value = |(i, v): (usize, &T)| {
        let code = code(*v);
        curves.get(i % channels).map_or(code as f32 / (CODES - 1) as f32, |curve| curve[code])
    };
    codes.par_iter().enumerate().map(value).collect()
}

/// The 16-bit code of each value, with a fraction: where the curve has it.
pub fn encode(values: &[f32], channels: usize, curves: &[&[f32]]) -> Vec<f32> {
    let code = |(i, v): (usize, &f32)| match curves.get(i % channels) {
        None => v.clamp(0.0, 1.0) * (CODES - 1) as f32,
        Some(curve) => {
            // The first code that is not darker. NaN is darker than nothing, and becomes black.
            let above = curve.partition_point(|light| light < v).min(CODES - 1);
            let below = above.saturating_sub(1);
            let (low, high) = (curve[below], curve[above]);
            let between = if high > low { ((v - low) / (high - low)).clamp(0.0, 1.0) } else { 1.0 };
            below as f32 + between * (above - below) as f32
        }
    };
    values.par_iter().enumerate().map(code).collect()
}
