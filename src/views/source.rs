//! One of the other views: which of its pixels see what the reference does not, and how far they are to be trusted.

use super::camera::Warp;
use super::depth_map::{DepthMap, SAME_PX};
use super::view::View;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::memory::Buffer;
use crate::scene::edges::{self, EDGE};
use crate::scene::grid::BLOCK;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

/// What is known of a pixel of a view from the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Evidence {
    /// Nothing: it lies beyond the border of the reference, or beside a silhouette.
    None,
    /// The reference sees the same surface.
    Agrees,
    /// The reference sees something nearer, which does not hide it from this view.
    Hidden,
    /// The reference has seen through this place, or sees something there that this view has not seen.
    Contradicts,
}

/// Two rows of a view between which surfaces are that the reference does not see.
pub struct Strip {
    /// The first of the two rows.
    pub row: usize,
    pub columns: Range<usize>,
    /// Least and greatest row of the reference on which they lie.
    pub y: [f32; 2],
}

/// A view beside the reference.
pub struct Source<'a> {
    pub view: &'a View,
    pub depth: DepthMap<'a>,
    pub to_reference: Warp,
    pub from_reference: Warp,
    /// Pixels by which things are displaced against the reference, or blurred by the lens if that is more, to a unit of
    /// disparity.
    pub k: f32,
    /// See [`edges::connectivity`].
    pub connectivity: Vec<u8>,
    pub evidence: Vec<Evidence>,
    pub strips: Vec<Strip>,
    trust: Trust,
}

impl<'a> Source<'a> {
    pub fn new(
        view: &'a View,
        reference: &View,
        (map, seen): (DepthMap<'a>, DepthMap<'a>),
        k: f32,
        cancel: &Cancel,
    ) -> Result<Source<'a>> {
        let to_reference = Warp::between(&view.camera, &reference.camera);
        let from_reference = Warp::between(&reference.camera, &view.camera);
        let s = Buffer::of_each(map.disparity, |d| k * d);
        let connectivity = edges::connectivity(&s, map.width, map.height);
        drop(s);
        let nearest = nearest_of_reference(&seen, &map, &from_reference, cancel)?;
        let (evidence, votes) = evidence((&map, &seen), &nearest, &connectivity, (&to_reference, k), cancel)?;
        let trust = Trust::new(&votes, map.width.div_ceil(BLOCK));
        let strips = strips(&map, &evidence, &to_reference);
        Ok(Source {
            view,
            depth: map,
            to_reference,
            from_reference,
            k,
            connectivity,
            evidence,
            strips,
            trust,
        })
    }

    /// How far a pixel is to be trusted, from 0 to 1.
    pub fn trust(&self, x: usize, y: usize) -> f32 {
        self.trust.at(x, y)
    }
}

/// The nearest surface of the reference at each pixel of a view; 0 where there is none.
///
/// The order of disparities that are not negative is that of their bits.
fn nearest_of_reference(
    seen: &DepthMap,
    map: &DepthMap,
    from_reference: &Warp,
    cancel: &Cancel,
) -> Result<Vec<f32>> {
    let nearest: Vec<AtomicU32> = (0..map.disparity.len()).map(|_| AtomicU32::new(0)).collect();
    seen.disparity.par_chunks(seen.width).enumerate().try_for_each(|(y, row)| {
        cancel.check()?;
        for (x, &d) in row.iter().enumerate() {
            let found = from_reference.at(x as f64, y as f64, f64::from(d));
            if let Some((found, index)) = found.and_then(|s| Some((s, map.pixel_at(s.x, s.y)?))) {
                nearest[index].fetch_max((found.disparity as f32).to_bits(), Ordering::Relaxed);
            }
        }
        Ok(())
    })?;
    Ok(nearest.into_iter().map(|bits| f32::from_bits(bits.into_inner())).collect())
}

/// The evidence of every pixel, and how many pixels of each block agree and contradict.
fn evidence(
    (map, seen): (&DepthMap, &DepthMap),
    nearest: &[f32],
    connectivity: &[u8],
    (to_reference, k): (&Warp, f32),
    cancel: &Cancel,
) -> Result<(Vec<Evidence>, Vec<[u32; 2]>)> {
    let of_pixel = |index: usize| {
        let (x, y, d) = (index % map.width, index / map.width, map.disparity[index]);
        if connectivity[index] & EDGE != 0 {
            return Evidence::None;
        }
        let found = to_reference.at(x as f64, y as f64, f64::from(d));
        let Some((found, at)) = found.and_then(|s| Some((s, seen.pixel_at(s.x, s.y)?))) else {
            return Evidence::None;
        };
        let d_seen = found.disparity as f32;
        let behind = seen.behind_px(at, d_seen, k);
        if behind.abs() <= SAME_PX {
            return Evidence::Agrees;
        }
        if behind < 0.0 {
            // Beside a silhouette of the reference, the next pixel may be on the surface that this one is on.
            let through = seen.around(at).all(|i| seen.behind_px(i, d_seen, k) < -SAME_PX);
            return if through { Evidence::Contradicts } else { Evidence::None };
        }
        // What the reference sees hides the point from it, and must not hide it from here.
        let known = || map.around(index).filter(|i| nearest[*i] > 0.0);
        let slope = map.slope_px(index, k);
        let in_front = |i: usize| k * (nearest[i] - d) > SAME_PX + slope;
        if known().next().is_some() && known().all(in_front) {
            Evidence::Contradicts
        } else {
            Evidence::Hidden
        }
    };
    let across = map.width.div_ceil(BLOCK);
    let mut evidence = vec![Evidence::None; map.disparity.len()];
    let votes = evidence
        .par_chunks_mut(map.width * BLOCK)
        .enumerate()
        .map(|(band, out)| {
            cancel.check()?;
            let mut votes = vec![[0; 2]; across];
            for (i, out) in out.iter_mut().enumerate() {
                *out = of_pixel(band * BLOCK * map.width + i);
                let votes = &mut votes[i % map.width / BLOCK];
                match *out {
                    Evidence::Agrees => votes[0] += 1,
                    Evidence::Contradicts => votes[1] += 1,
                    Evidence::None | Evidence::Hidden => (),
                }
            }
            Ok(votes)
        })
        .collect::<Result<Vec<_>>>()?;
    Ok((evidence, votes.concat()))
}

/// The pairs of rows with hidden pixels.
fn strips(map: &DepthMap, evidence: &[Evidence], to_reference: &Warp) -> Vec<Strip> {
    let hidden = |row: usize| {
        let row = &evidence[row * map.width..][..map.width];
        let first = row.iter().position(|e| *e == Evidence::Hidden)?;
        let last = row.iter().rposition(|e| *e == Evidence::Hidden)?;
        Some(first.saturating_sub(1)..(last + 2).min(map.width))
    };
    let hidden: Vec<Option<Range<usize>>> = (0..map.height).into_par_iter().map(hidden).collect();
    let strip = |row: usize| {
        let (above, below) = (hidden[row].clone(), hidden[row + 1].clone());
        let columns = match (above, below) {
            (Some(a), Some(b)) => a.start.min(b.start)..a.end.max(b.end),
            (a, b) => a.or(b)?,
        };
        let mut y = [f32::INFINITY, f32::NEG_INFINITY];
        for row in [row, row + 1] {
            for x in columns.clone() {
                let d = f64::from(map.disparity[row * map.width + x]);
                if let Some(seen) = to_reference.at(x as f64, row as f64, d) {
                    y = [y[0].min(seen.y as f32), y[1].max(seen.y as f32)];
                }
            }
        }
        Some(Strip { row, columns, y })
    };
    (0..map.height.saturating_sub(1)).into_par_iter().filter_map(strip).collect()
}

/// How far the pixels of a view are to be trusted.
///
/// Where the view and the reference do not fit together (something has moved, a pose is wrong, depth has another scale),
/// silhouettes are displaced, and along them a strip as wide as the displacement contradicts.
struct Trust {
    across: usize,
    of_block: Vec<f32>,
}

/// The strip of a displacement by one pixel is this part of the three by three blocks around, if a silhouette crosses
/// them. That much may be, and three times as much may not.
const DISPLACED: f32 = 1.0 / (3 * BLOCK) as f32;

/// Where blocks know less than this many pixels, as a row of them, the whole view speaks for them.
const FEW: f32 = BLOCK as f32;

impl Trust {
    fn new(votes: &[[u32; 2]], across: usize) -> Trust {
        let down = votes.len() / across;
        let sum = |all: &mut dyn Iterator<Item = [u32; 2]>| {
            all.fold([0, 0], |[a, c], [agree, contradict]| [a + agree, c + contradict])
        };
        let [agree, contradict] = sum(&mut votes.iter().copied());
        let whole = contradict as f32 / (agree + contradict).max(1) as f32;
        let of_block = |i: usize| {
            let (x, y) = (i % across, i / across);
            let rows = y.saturating_sub(1)..(y + 2).min(down);
            let columns = || x.saturating_sub(1)..(x + 2).min(across);
            let mut around = rows.flat_map(|y| columns().map(move |x| votes[y * across + x]));
            let [agree, contradict] = sum(&mut around);
            let share = (contradict as f32 + FEW * whole) / ((agree + contradict) as f32 + FEW);
            (1.5 - 0.5 * share / DISPLACED).clamp(0.0, 1.0)
        };
        Trust { across, of_block: (0..votes.len()).map(of_block).collect() }
    }

    /// Interpolated between the centres of the blocks.
    fn at(&self, x: usize, y: usize) -> f32 {
        let down = self.of_block.len() / self.across;
        let along = |v: usize, n: usize| {
            let place = ((v as f32 + 0.5) / BLOCK as f32 - 0.5).clamp(0.0, (n - 1) as f32);
            (place as usize, (place as usize + 1).min(n - 1), place.fract())
        };
        let ((left, right, u), (top, bottom, v)) = (along(x, self.across), along(y, down));
        let at = |x: usize, y: usize| self.of_block[y * self.across + x];
        let row = |y: usize| (1.0 - u) * at(left, y) + u * at(right, y);
        (1.0 - v) * row(top) + v * row(bottom)
    }
}
