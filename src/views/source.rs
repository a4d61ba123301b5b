//! One of the other views: which of its pixels see what the reference does not.

use super::camera::Warp;
use super::depth_map::{DepthMap, SAME_PX};
use super::evidence::Evidence;
use super::lamps::Lamps;
use super::motion::ToReference;
use super::trust::{Fit, Trust};
use super::view::View;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::picture::Size;
use crate::scene::edges::EDGE;
use crate::scene::grid::BLOCK;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

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
    pub to_reference: ToReference<'a>,
    pub from_reference: Warp,
    /// Pixels by which things are displaced against the reference, or blurred by the lens if that is more, to a unit of
    /// disparity.
    pub k: f32,
    /// See [`ToReference::connectivity`].
    pub connectivity: Vec<u8>,
    pub evidence: Vec<Evidence>,
    pub strips: Vec<Strip>,
    pub lamps: Lamps,
    trust: Trust,
}

impl<'a> Source<'a> {
    pub fn new(
        view: &'a View,
        reference: &View,
        (map, seen): (DepthMap<'a>, DepthMap<'a>),
        (k, size, lights): (f32, Size, usize),
        cancel: &Cancel,
    ) -> Result<Source<'a>> {
        let warp = Warp::between(&view.camera, &reference.camera);
        let to_reference = ToReference::new(map, warp, view.flow.as_ref());
        let from_reference = Warp::between(&reference.camera, &view.camera);
        let connectivity = to_reference.connectivity(k);
        let nearest = nearest_of_reference((&map, &seen), &from_reference, (&to_reference, k), cancel)?;
        let witness = Witness { map, seen, nearest: &nearest, to_reference: &to_reference, k };
        let (evidence, votes) = evidence(&witness, &connectivity, cancel)?;
        let of_lamp = |index: usize, sample: usize| witness.evidence(sample, index);
        let lamps =
            Lamps::new((view, size, lights), (&map, &connectivity), (&to_reference, k), of_lamp, cancel)?;
        let fit = Fit { map, to_reference: &to_reference, colors: (view, reference), lights };
        let trust = Trust::new(&votes, &fit.of_blocks(&evidence, cancel)?, map.width.div_ceil(BLOCK));
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
            lamps,
            trust,
        })
    }

    /// How far a pixel is to be trusted, from 0 to 1.
    pub fn trust(&self, x: usize, y: usize) -> f32 {
        self.trust.at(x, y)
    }
}

/// The nearest surface of the reference at each pixel of a view; 0 where there is none. What moves is where it was when the
/// view was taken.
///
/// The order of disparities that are not negative is that of their bits.
fn nearest_of_reference(
    (map, seen): (&DepthMap, &DepthMap),
    from_reference: &Warp,
    (to_reference, k): (&ToReference, f32),
    cancel: &Cancel,
) -> Result<Vec<f32>> {
    let nearest: Vec<AtomicU32> = (0..map.disparity.len()).map(|_| AtomicU32::new(0)).collect();
    let put = |index: usize, d: f32| {
        nearest[index].fetch_max(d.to_bits(), Ordering::Relaxed);
    };
    let moved = if to_reference.carries() { seen.disparity.len() } else { 0 };
    let moved: Vec<AtomicBool> = (0..moved).map(|_| AtomicBool::new(false)).collect();
    if to_reference.carries() {
        // What both see and has moved tells where it was.
        (0..map.disparity.len()).into_par_iter().filter(|i| to_reference.has_moved(*i)).for_each(|i| {
            let found = to_reference.at(i).and_then(|s| Some((s.disparity as f32, seen.pixel_at(s.x, s.y)?)));
            let Some((d, at)) = found else { return };
            let is_same = |at: usize| seen.behind_px(at, d, k).abs() <= SAME_PX;
            if is_same(at) {
                put(i, map.disparity[i]);
                seen.around(at)
                    .filter(|at| is_same(*at))
                    .for_each(|at| moved[at].store(true, Ordering::Relaxed));
            }
        });
    }
    seen.disparity.par_chunks(seen.width).enumerate().try_for_each(|(y, row)| {
        cancel.check()?;
        for (x, &d) in row.iter().enumerate() {
            if moved.get(y * seen.width + x).is_some_and(|moved| moved.load(Ordering::Relaxed)) {
                continue;
            }
            let found = from_reference.at(x as f64, y as f64, f64::from(d));
            if let Some((found, index)) = found.and_then(|s| Some((s, map.pixel_at(s.x, s.y)?))) {
                put(index, found.disparity as f32);
            }
        }
        Ok(())
    })?;
    Ok(nearest.into_iter().map(|bits| f32::from_bits(bits.into_inner())).collect())
}

/// What the reference tells of the points that a view sees.
struct Witness<'a> {
    map: DepthMap<'a>,
    seen: DepthMap<'a>,
    /// See [`nearest_of_reference`].
    nearest: &'a [f32],
    to_reference: &'a ToReference<'a>,
    k: f32,
}

impl Witness<'_> {
    /// The evidence of the surface at pixel `sample`, continued to another pixel.
    fn evidence(&self, sample: usize, index: usize) -> Evidence {
        let Witness { map, seen, nearest, k, .. } = self;
        let d = map.disparity[sample];
        let found = self.to_reference.continued(sample, index);
        let Some((found, at)) = found.and_then(|s| Some((s, seen.pixel_at(s.x, s.y)?))) else {
            return Evidence::None;
        };
        let d_seen = found.disparity as f32;
        let behind = seen.behind_px(at, d_seen, *k);
        if behind.abs() <= SAME_PX {
            return Evidence::Agrees;
        }
        if behind < 0.0 {
            // Beside a silhouette of the reference, the next pixel may be on the surface that this one is on.
            let through = seen.around(at).all(|i| seen.behind_px(i, d_seen, *k) < -SAME_PX);
            return if through { Evidence::Contradicts } else { Evidence::None };
        }
        // What the reference sees hides the point from it, and must not hide it from here.
        let known = || map.around(index).filter(|i| nearest[*i] > 0.0);
        let slope = map.slope_px(sample, *k);
        let in_front = |i: usize| k * (nearest[i] - d) > SAME_PX + slope;
        if known().next().is_some() && known().all(in_front) {
            Evidence::Contradicts
        } else {
            Evidence::Hidden
        }
    }
}

/// The evidence of every pixel, and how many pixels of each block agree and contradict.
fn evidence(
    witness: &Witness,
    connectivity: &[u8],
    cancel: &Cancel,
) -> Result<(Vec<Evidence>, Vec<[u32; 2]>)> {
    let map = &witness.map;
    let of_pixel = |index: usize| {
        if connectivity[index] & EDGE != 0 { Evidence::None } else { witness.evidence(index, index) }
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
fn strips(map: &DepthMap, evidence: &[Evidence], to_reference: &ToReference) -> Vec<Strip> {
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
                if let Some(seen) = to_reference.at(row * map.width + x) {
                    y = [y[0].min(seen.y as f32), y[1].max(seen.y as f32)];
                }
            }
        }
        Some(Strip { row, columns, y })
    };
    (0..map.height.saturating_sub(1)).into_par_iter().filter_map(strip).collect()
}
