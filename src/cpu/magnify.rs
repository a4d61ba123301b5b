//! Carries out [`plan::magnify`](crate::plan::magnify).

use crate::cancel::Cancel;
use crate::error::Result;
use crate::picture::Size;
use crate::plan::magnify::{Interpolation, Source, sources};
use crate::rows::render_rows;

/// What is magnified, and how.
#[derive(Debug, Clone, Copy)]
pub struct Magnified {
    pub size: Size,
    /// The pixel that stays where it is.
    pub centre: [f64; 2],
    pub interpolation: Interpolation,
}

/// An interleaved picture with every channel magnified about the centre; the picture is mirrored at the border.
///
/// The cubic would overshoot beside a highlight. So each value is limited to the range of the four pixels around it:
/// there is no ringing, and no negative light.
pub fn magnify(
    picture: &[f32],
    &Magnified { size, centre, interpolation }: &Magnified,
    magnification_of: impl Fn(usize) -> f64,
    cancel: &Cancel,
    out: &mut [f32],
) -> Result<()> {
    let channels: Vec<(Vec<Source>, Vec<Source>)> = (0..size.channels)
        .map(|c| {
            let m = magnification_of(c);
            let along = |n: usize, centre: f64| sources(n, centre, m, interpolation);
            (along(size.width, centre[0]), along(size.height, centre[1]))
        })
        .collect();
    render_rows(
        out,
        size,
        cancel,
        || (),
        |(), y, out| {
            for (c, (columns, rows)) in channels.iter().enumerate() {
                let Source { places: source_rows, weights: down } = &rows[y];
                for (x, Source { places: source_columns, weights: across }) in columns.iter().enumerate() {
                    let value = |j: usize, i: usize| {
                        picture[(source_rows[j] * size.width + source_columns[i]) * size.channels + c]
                    };
                    let (mut sum, mut least, mut greatest) = (0.0, f32::INFINITY, f32::NEG_INFINITY);
                    for j in 0..4 {
                        let mut row = 0.0;
                        for i in 0..4 {
                            let v = value(j, i);
                            row += across[i] * v;
                            if (1..3).contains(&i) && (1..3).contains(&j) {
                                least = if v < least { v } else { least };
                                greatest = if v > greatest { v } else { greatest };
                            }
                        }
                        sum += down[j] * row;
                    }
                    out[x * size.channels + c] = sum.clamp(least, greatest);
                }
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 40, height: 30, channels: 2 };

    fn magnified(picture: impl Fn(f64, f64) -> f64, m: f64) -> Vec<f32> {
        let values: Vec<f32> = (0..SIZE.pixels())
            .flat_map(|i| {
                let v = picture((i % SIZE.width) as f64, (i / SIZE.width) as f64) as f32;
                [v, v]
            })
            .collect();
        let mut out = vec![0.0; values.len()];
        let magnification = |c| if c == 0 { m } else { 1.0 };
        let how = Magnified { size: SIZE, centre: [19.5, 14.5], interpolation: Interpolation::Cubic };
        magnify(&values, &how, magnification, &Cancel::default(), &mut out).unwrap();
        out
    }

    #[test]
    fn places_move_away_from_the_centre_by_the_magnification() {
        let wave = |x: f64, y: f64| (0.2 * x).sin() + (0.15 * y).cos();
        let out = magnified(wave, 1.04);
        for (x, y) in [(19, 14), (5, 25), (33, 8)] {
            let source = |v: usize, c: f64| c + (v as f64 - c) / 1.04;
            let expected = wave(source(x, 19.5), source(y, 14.5)) as f32;
            let at = (y * SIZE.width + x) * 2;
            assert!((out[at] - expected).abs() < 1e-3, "{} against {expected}", out[at]);
            assert_eq!(out[at + 1], wave(x as f64, y as f64) as f32);
        }
    }

    #[test]
    fn highlights_make_no_ring() {
        let out = magnified(|x, y| if (x, y) == (20.0, 20.0) { 1e4 } else { 0.25 }, 1.02);
        assert!(out.iter().all(|v| (0.25..=1e4).contains(v)));
    }
}
