//! Samples of deep pixels, brought to layers from front to back.
//!
//! The samples of a pixel are sorted by depth. A volume, from Z to ZBack, is split into pieces of even disparity. Where
//! there are more samples than layers, neighbours are merged: two become one of their colour over each other, so a pixel
//! looks as it did, at their mean disparity, in which the circle of confusion is linear.
//!
//! Samples count by their optical depth, `-ln(1 - alpha)`. Those of things that one follows the other add up, so it makes no
//! difference into how many pieces a volume was cut. What is opaque has an infinite one: it stays where it is, and what is
//! merged with it comes to it. A wall behind fog keeps its distance, and its sharpness if it is in focus.

mod carried;

pub use carried::{Carried, Held};

use crate::cancel::Cancel;
use crate::error::Result;
use carried::Share;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// The coverage of a sample that gives light and has none: without any it would have no place in a layer.
const GLOW_ALPHA: f32 = 1e-3;
/// Pieces of a pixel's range of disparity for each layer. Two for one leave the merging its choice.
const PIECES_PER_LAYER: usize = 2;

/// The samples of a frame. Channels hold those of all pixels one after another, and are as long as all counts together.
pub struct DeepSamples<'a> {
    /// Pixels of a row.
    pub width: usize,
    /// The number of samples of each pixel.
    pub counts: &'a [u32],
    /// Red, green and blue, premultiplied; black if absent.
    pub color: [Option<&'a [f32]>; 3],
    /// Coverage; whole if absent.
    pub alpha: Option<&'a [f32]>,
    /// Depth where a sample begins.
    pub z: &'a [f32],
    /// Depth where it ends, if it is a volume.
    pub back: Option<&'a [f32]>,
    /// Further channels, merged as the samples are.
    pub carried: &'a [Carried<'a>],
}

/// Layers of a frame.
pub struct DeepLayers {
    /// How many there are; one at least.
    pub layers: usize,
    /// Premultiplied colour and coverage of each pixel, layer by layer.
    pub color: Vec<f32>,
    /// Depth of each pixel, layer by layer; infinite where there is no sample.
    pub depth: Vec<f32>,
    /// The further channels of each pixel, layer by layer; 0 where there is no sample.
    pub carried: Vec<Vec<f32>>,
}

/// A sample, a piece of one, or several that were merged.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    z: f32,
    color: [f32; 4],
    /// Where it comes from, and the part of that one's light.
    origin: (usize, f32),
    /// How many were merged.
    count: usize,
}

/// A row of pixels: the number of layers of each, and their values one after another.
struct Row {
    counts: Vec<u32>,
    color: Vec<f32>,
    depth: Vec<f32>,
    carried: Vec<Vec<f32>>,
}

/// The pixels that are wanted; those with samples are `seen` rows.
struct Window {
    columns: Range<i64>,
    rows: Range<i64>,
    seen: Range<usize>,
}

impl Window {
    /// Values of a number of channels of all layers; `fill` where there are none.
    fn laid_out<'a>(
        &self,
        layers: usize,
        channels: usize,
        fill: f32,
        rows: &'a [Row],
        values: impl Fn(&'a Row) -> &'a [f32] + Sync,
    ) -> Vec<f32> {
        let across = (self.columns.end - self.columns.start) as usize * channels;
        let down = (self.rows.end - self.rows.start) as usize;
        let mut all = vec![fill; layers * down * across];
        if channels == 0 {
            return all;
        }
        // The rows of the output that have pixels; each with those of all layers.
        let top = (self.seen.start as i64 - self.rows.start).max(0) as usize;
        let mut out: Vec<Vec<&mut [f32]>> = rows.iter().map(|_| Vec::new()).collect();
        for (line, plane) in all.chunks_exact_mut(across).enumerate() {
            if let Some(row) = (line % down).checked_sub(top).and_then(|row| out.get_mut(row)) {
                row.push(plane);
            }
        }
        out.par_iter_mut().zip(rows).for_each(|(out, row)| {
            let mut values = values(row).chunks_exact(channels);
            for (x, count) in (-self.columns.start..).zip(&row.counts) {
                for (layer, values) in values.by_ref().take(*count as usize).enumerate() {
                    if (0..(across / channels) as i64).contains(&x) {
                        out[layer][channels * x as usize..][..channels].copy_from_slice(values);
                    }
                }
            }
        });
        all
    }
}

impl Sample {
    fn alpha(&self) -> f32 {
        self.color[3]
    }

    /// What adds up of things that follow one another.
    fn optical_depth(&self) -> f32 {
        -(-self.alpha()).ln_1p()
    }

    /// What merging it with a sample behind it costs, by Ward's criterion: by how much the variance of disparity grows, each
    /// sample counting by its optical depth.
    fn cost_with(&self, behind: &Sample) -> f32 {
        if self.z == behind.z {
            return 0.0;
        }
        let apart = 1.0 / behind.z - 1.0 / self.z;
        let [front, behind] = [self, behind].map(Sample::optical_depth);
        apart * apart / (1.0 / front + 1.0 / behind)
    }

    /// It and a sample behind it as one.
    fn over(&self, behind: &Sample) -> Sample {
        let through = 1.0 - self.alpha();
        let color = std::array::from_fn(|c| self.color[c] + through * behind.color[c]);
        let [own, other] = [self, behind].map(Sample::optical_depth);
        let z = if own == f32::INFINITY || self.z == behind.z {
            self.z
        } else if other == f32::INFINITY {
            behind.z
        } else {
            (own + other) / (own / self.z + other / behind.z)
        };
        Sample { z, color, origin: self.origin, count: self.count + behind.count }
    }
}

impl DeepSamples<'_> {
    /// At most so many layers of these columns and rows; what is beyond the frame is empty.
    pub fn layers(
        &self,
        columns: Range<i64>,
        rows: Range<i64>,
        most: usize,
        cancel: &Cancel,
    ) -> Result<DeepLayers> {
        let height = self.counts.len() / self.width;
        let first = self.counts.chunks(self.width).scan(0usize, |end, row| {
            let first = *end;
            *end += row.iter().map(|count| *count as usize).sum::<usize>();
            Some(first)
        });
        let first: Vec<usize> = first.collect();
        let seen = rows.start.clamp(0, height as i64) as usize..rows.end.clamp(0, height as i64) as usize;
        let merged = seen.clone().into_par_iter().map(|y| {
            cancel.check()?;
            Ok(self.row(y, first[y], most))
        });
        let merged: Vec<Row> = merged.collect::<Result<_>>()?;
        let layers = merged.par_iter().flat_map_iter(|row| row.counts.iter().copied()).max();
        let layers = layers.unwrap_or(0).max(1) as usize;
        let window = Window { columns, rows, seen };
        let carried = self.carried.iter().enumerate().map(|(i, carried)| {
            window.laid_out(layers, carried.channels(), 0.0, &merged, |row| &row.carried[i])
        });
        let carried = carried.collect();
        let color = window.laid_out(layers, 4, 0.0, &merged, |row| &row.color);
        let depth = window.laid_out(layers, 1, f32::INFINITY, &merged, |row| &row.depth);
        Ok(DeepLayers { layers, color, depth, carried })
    }

    /// The samples of a row, which begin at `first`, as at most so many of each pixel.
    fn row(&self, y: usize, first: usize, most: usize) -> Row {
        let mut row = Row {
            counts: Vec::with_capacity(self.width),
            color: Vec::new(),
            depth: Vec::new(),
            carried: self.carried.iter().map(|_| Vec::new()).collect(),
        };
        let (mut pixel, mut shares) = (Vec::new(), Vec::new());
        let mut start = first;
        for &count in &self.counts[y * self.width..][..self.width] {
            let end = start + count as usize;
            pixel.clear();
            match self.back {
                None => pixel.extend((start..end).map(|i| self.sample(i))),
                Some(back) => self.split(start..end, back, most, &mut pixel),
            }
            start = end;
            pixel.retain_mut(|sample| {
                let light = sample.color[..3].iter().any(|v| v.abs() > 0.0);
                let alpha = &mut sample.color[3];
                if light && *alpha <= 0.0 {
                    *alpha = GLOW_ALPHA;
                }
                let is_seen = *alpha > 0.0 && !sample.z.is_nan();
                *alpha = alpha.min(1.0);
                is_seen
            });
            pixel.sort_by(|a, b| a.z.total_cmp(&b.z));
            if !self.carried.is_empty() {
                shares.clear();
                shares.extend(pixel.iter().map(|sample: &Sample| {
                    let (sample, part, seen) = (sample.origin.0, sample.origin.1, sample.alpha());
                    Share { sample, light: part, seen }
                }));
            }
            merge(&mut pixel, most);
            row.counts.push(pixel.len() as u32);
            row.color.extend(pixel.iter().flat_map(|sample| sample.color));
            row.depth.extend(pixel.iter().map(|sample| sample.z));
            if !self.carried.is_empty() {
                self.carry(&pixel, &mut shares, &mut row.carried);
            }
        }
        row
    }

    /// Appends the further channels of a pixel's layers, given what each of its samples had before they were merged.
    fn carry(&self, layers: &[Sample], mut shares: &mut [Share], out: &mut [Vec<f32>]) {
        for layer in layers {
            let own;
            (own, shares) = shares.split_at_mut(layer.count);
            let mut passing = 1.0;
            for share in own.iter_mut() {
                let stopped = share.seen;
                share.light *= passing;
                share.seen *= passing;
                passing *= 1.0 - stopped;
            }
            self.carried.iter().zip(&mut *out).for_each(|(carried, out)| carried.append(own, out));
        }
    }

    fn sample(&self, i: usize) -> Sample {
        let [r, g, b] = self.color.map(|plane| plane.map_or(0.0, |plane| plane[i]));
        let color = [r, g, b, self.alpha.map_or(1.0, |plane| plane[i])];
        Sample { z: self.z[i], color, origin: (i, 1.0), count: 1 }
    }

    /// Splits the volumes of a pixel into thin samples, where their circles of confusion differ.
    ///
    /// A volume of even density passes the same part of the light on every length of its way, so the piece of it that is the
    /// share f of its depth stops `1 - (1 - alpha)^f`. Its colour is to the whole as its alpha is (OpenEXR's *Interpreting
    /// deep pixels*).
    fn split(&self, samples: Range<usize>, back: &[f32], most: usize, out: &mut Vec<Sample>) {
        let is_volume = |i: usize| back[i] > self.z[i] && self.z[i] > 0.0 && back[i].is_finite();
        let ends = |i: usize| [1.0 / self.z[i], 1.0 / if is_volume(i) { back[i] } else { self.z[i] }];
        let range =
            samples.clone().map(ends).fold([f32::INFINITY, f32::NEG_INFINITY], |range, [near, far]| {
                [range[0].min(far), range[1].max(near)]
            });
        // The disparity of a piece, as layers divide that of the pixel.
        let step = (range[1] - range[0]) / (PIECES_PER_LAYER * most) as f32;
        for i in samples {
            let whole = self.sample(i);
            if !is_volume(i) {
                out.push(whole);
                continue;
            }
            let [near, far] = ends(i);
            let count = ((near - far) / step).ceil().max(1.0) as usize;
            let alpha = whole.alpha().clamp(0.0, 1.0);
            let passed = f64::from((-alpha).ln_1p());
            let bound =
                |number: usize| f64::from(near) - f64::from(near - far) * number as f64 / count as f64;
            for number in 0..count {
                let bounds = [bound(number), bound(number + 1)];
                let share = (1.0 / bounds[1] - 1.0 / bounds[0]) / f64::from(1.0 / far - 1.0 / near);
                let stopped = -(share * passed).exp_m1();
                let part = if alpha > 0.0 { stopped / f64::from(alpha) } else { share };
                let of_piece = |v: f32| (f64::from(v) * part) as f32;
                let [r, g, b, _] = whole.color.map(of_piece);
                out.push(Sample {
                    z: (2.0 / (bounds[0] + bounds[1])) as f32,
                    color: [r, g, b, stopped as f32],
                    origin: (i, part as f32),
                    count: 1,
                });
            }
        }
    }
}

/// Merges neighbours until there are no more than so many samples.
fn merge(samples: &mut Vec<Sample>, most: usize) {
    if samples.len() <= most {
        return;
    }
    // Every sample's neighbours, and how often it has been merged; `None` for what has become a part of another.
    let ends = samples.len();
    let mut before: Vec<usize> = (0..=ends).map(|i| i.wrapping_sub(1)).collect();
    let mut after: Vec<usize> = (1..=ends).collect();
    let mut merged = vec![Some(0u32); ends];
    // The bits of numbers that are not negative are ordered as they are.
    let pair = |samples: &[Sample], merged: &[Option<u32>], front: usize, behind: usize| {
        let cost = samples[front].cost_with(&samples[behind]);
        Reverse((cost.to_bits(), front, behind, merged[front], merged[behind]))
    };
    let mut pairs: BinaryHeap<_> = (1..ends).map(|i| pair(samples, &merged, i - 1, i)).collect();
    let mut left = ends;
    while left > most
        && let Some(Reverse((_, front, behind, front_merged, behind_merged))) = pairs.pop()
    {
        if (front_merged, behind_merged) != (merged[front], merged[behind]) {
            continue;
        }
        samples[front] = samples[front].over(&samples[behind]);
        merged[front] = merged[front].map(|times| times + 1);
        merged[behind] = None;
        let next = after[behind];
        (after[front], before[next]) = (next, front);
        left -= 1;
        if next < ends {
            pairs.push(pair(samples, &merged, front, next));
        }
        if before[front] < ends {
            pairs.push(pair(samples, &merged, before[front], front));
        }
    }
    let mut kept = merged.iter().map(Option::is_some);
    samples.retain(|_| kept.next() == Some(true));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn merged(samples: &[(f32, f32)], most: usize) -> Vec<(f32, f32)> {
        let mut all: Vec<Sample> = samples
            .iter()
            .map(|&(z, alpha)| Sample { z, color: [alpha; 4], origin: (0, 1.0), count: 1 })
            .collect();
        merge(&mut all, most);
        all.iter().map(|sample| (sample.z, sample.alpha())).collect()
    }

    #[test]
    fn the_cheapest_pair_is_merged_first_and_of_equal_ones_the_nearest() {
        assert_eq!(merged(&[(1.0, 1.0), (1.1, 1.0), (4.0, 1.0)], 2), [(1.0, 1.0), (4.0, 1.0)]);
        assert_eq!(merged(&[(2.0, 0.5), (2.0, 0.5), (2.0, 0.5), (2.0, 0.5)], 3).len(), 3);
        assert_eq!(merged(&[(2.0, 0.5); 3], 2), [(2.0, 0.75), (2.0, 0.5)]);
        assert_eq!(merged(&[(2.0, 1.0); 3], 2), [(2.0, 1.0), (2.0, 1.0)]);
        assert_eq!(merged(&[(1.0, 0.5), (2.0, 0.25)], 2), [(1.0, 0.5), (2.0, 0.25)]);
    }

    #[test]
    fn what_is_opaque_stays_where_it_is() {
        assert_eq!(merged(&[(1.0, 0.5), (1.25, 1.0)], 1), [(1.25, 1.0)]);
        assert_eq!(merged(&[(1.0, 1.0), (1.25, 1.0)], 1), [(1.0, 1.0)]);
        assert_eq!(merged(&[(1.0, 1.0), (1.25, 0.5)], 1), [(1.0, 1.0)]);
    }

    #[test]
    fn it_makes_no_difference_into_how_many_pieces_a_volume_was_cut() {
        let passed = |disparity: f32, part: f32| (1.0 / disparity, 1.0 - 0.3f32.powf(part));
        let [(two, a)] = merged(&[passed(0.9, 0.5), passed(0.5, 0.5)], 1)[..] else { panic!() };
        let four = [passed(0.9, 0.25), passed(0.9, 0.25), passed(0.5, 0.4), passed(0.5, 0.1)];
        let [(four, b)] = merged(&four, 1)[..] else { panic!() };
        assert!((two - 1.0 / 0.7).abs() < 1e-5 && (four - two).abs() < 1e-5 && (a - b).abs() < 1e-6);
    }

    #[test]
    fn light_is_kept_however_many_are_merged() {
        let many: Vec<(f32, f32)> = (0..10_000).map(|i| (1.0 + i as f32 * 1e-3, 1e-4)).collect();
        let passed = merged(&many, 3).iter().map(|(_, alpha)| 1.0 - alpha).product::<f32>();
        assert!((passed - (-1.0f32).exp()).abs() < 1e-3, "{passed}");
    }
}
