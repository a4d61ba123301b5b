//! A picture taken apart by a matte: the colours of its foreground and of its background, and their depths.
//!
//! Where a matte is neither 0 nor 1, a pixel is a mixture of two colours that the picture does not tell apart. Those are chosen
//! that give the pixel and differ least from their neighbours', more so where the matte changes: from coarse to fine, after
//! Germer, Uelwer, Conrad and Harmeling, "Fast Multi-Level Foreground Estimation", 2020.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::refine::Plane;

/// How much neighbours' colours count where the matte is even, and by how much more where it changes by 1.
const EVEN: f32 = 1e-5;
const CHANGING: f32 = 1.0;
/// Rounds at sizes up to `SMALL_PX`, and at others.
const ROUNDS: [usize; 2] = [20, 4];
const SMALL_PX: usize = 32;

/// The colours of the foreground and of the background, a plane a channel.
pub fn colors(color: &[Plane], matte: &Plane, cancel: &Cancel) -> Result<[Vec<Plane>; 2]> {
    let mut levels = vec![(color.to_vec(), matte.clone())];
    while let Some((color, matte)) = levels.last()
        && matte.width.max(matte.height) > 1
    {
        levels.push((color.iter().map(Plane::halved).collect(), matte.halved()));
    }
    let mut found: Option<[Vec<Plane>; 2]> = None;
    for (color, matte) in levels.iter().rev() {
        let mut sides = match found.take() {
            None => [color.clone(), color.clone()],
            Some(sides) => {
                sides.map(|side| side.iter().map(|plane| plane.doubled(matte.width, matte.height)).collect())
            }
        };
        for _ in 0..ROUNDS[usize::from(matte.width.max(matte.height) > SMALL_PX)] {
            cancel.check()?;
            sides = round(color, matte, &sides);
        }
        found = Some(sides);
    }
    Ok(found.unwrap_or_else(|| [color.to_vec(), color.to_vec()]))
}

/// Each pixel's best two colours, given its neighbours'.
fn round(color: &[Plane], matte: &Plane, [front, back]: &[Vec<Plane>; 2]) -> [Vec<Plane>; 2] {
    let solved = |channel: usize| {
        let (color, front, back) = (&color[channel], &front[channel], &back[channel]);
        let side = |of_front: bool| {
            color.like(|y, out| {
                for (x, out) in out.iter_mut().enumerate() {
                    let (x, y) = (x as isize, y as isize);
                    let a = matte.at(x, y);
                    let b = 1.0 - a;
                    let (mut weights, mut fronts, mut backs) = (0.0, 0.0, 0.0);
                    for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                        let weight = EVEN + CHANGING * (a - matte.at(x + dx, y + dy)).abs();
                        weights += weight;
                        fronts += weight * front.at(x + dx, y + dy);
                        backs += weight * back.at(x + dx, y + dy);
                    }
                    // The least squares of a front + b back - color, and of the differences from the neighbours.
                    let v = color.at(x, y);
                    let (to_front, to_back) = (a * v + fronts, b * v + backs);
                    let (ff, fb, bb) = (a * a + weights, a * b, b * b + weights);
                    let determinant = ff * bb - fb * fb;
                    let solution =
                        if of_front { to_front * bb - to_back * fb } else { to_back * ff - to_front * fb };
                    *out = (solution / determinant).max(0.0);
                }
            })
        };
        (side(true), side(false))
    };
    let (fronts, backs) = (0..color.len()).map(solved).unzip();
    [fronts, backs]
}

/// Values continued from where `weight` is great to where it is none, from coarse to fine.
pub fn continued(values: &Plane, weight: &Plane) -> Plane {
    let sums = values.with(weight, |v, w| v * w);
    let mut levels = vec![(sums, weight.clone())];
    while let Some((sums, weights)) = levels.last()
        && weights.width.max(weights.height) > 1
    {
        levels.push((sums.halved(), weights.halved()));
    }
    let mean =
        |sums: &Plane, weights: &Plane| sums.with(weights, |sum, weight| sum / weight.max(f32::MIN_POSITIVE));
    let mut coarse: Option<Plane> = None;
    for (sums, weights) in levels.iter().rev() {
        let own = mean(sums, weights);
        coarse = Some(match coarse {
            None => own,
            Some(below) => {
                let below = below.resized(own.width, own.height);
                // What a pixel knows by itself goes before what is known around it.
                let trust = weights.with(weights, |weight, _| weight.min(1.0));
                let ours = own.with(&trust, |own, trust| own * trust);
                let theirs = below.with(&trust, |below, trust| below * (1.0 - trust));
                ours.with(&theirs, |a, b| a + b)
            }
        });
    }
    coarse.unwrap_or_else(|| values.clone())
}
