//! Alpha matting of edge pixels: the colour of the surface in front, the colour of the surface behind, and the
//! coverage.
//!
//! A pixel on a silhouette holds `C = a F + (1 - a) B` but one depth only. Unless both are separated, a single disc
//! carries the mixture; one such pixel on the rim of a bright lamp contaminates its whole neighbourhood.

use super::contrast::HIGHLIGHT_RATIO;
use super::edges::{self, CONNECTED_PX, EDGE};
use super::front_layer::{FrontLayer, Surface, sub};
use super::grid::BLOCK;
use super::layer::SceneLayer;
use super::recipe::{PureSource, Recipe, toward};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::picture::Size;
use crate::rows::ITEMS_PER_TASK;
use rayon::prelude::*;

/// The longest ring of pixels searched for a pure colour: past the edge pixels of a structure that is itself as thin
/// as its edges, two on each side.
const MAX_RING: i32 = 4;
/// Coverage closer than this to 0 or 1 is taken for pure.
const PURE: f32 = 0.01;
/// How much of a mixed pixel's colour may stay unexplained by two pure colours, as a multiple of their variances and
/// squared contrast. Two colours that vary leave over their variances on average. A residual of twice that is no
/// longer theirs.
const UNEXPLAINED: f32 = 2.0;
/// A pixel's depth is that of its centre, so an unexplained residual is more likely to belong to the surface at the
/// centre than to the other one. This is the factor by which its variance counts more. Averaged over the positions of
/// a straight edge, the surface at the centre covers three quarters of the pixel, three times as much as the other: a
/// little more than that.
const SEEN_AT_CENTRE: f32 = 4.0;

/// An edge pixel separated into two surfaces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MixedPixel {
    pub index: usize,
    /// Shift, colour and coverage of the surface in front.
    pub s_front: f32,
    pub front: [f32; 4],
    pub coverage: f32,
    /// Shift and colour of the surface behind.
    pub s_back: f32,
    pub back: [f32; 4],
    pub recipe: Recipe,
}

/// Weighted mean of colours, and the variance of their light (summed over channels).
#[derive(Default)]
struct Pure {
    weight: f32,
    sum: [f32; 4],
    sum_squares: f32,
}

impl Pure {
    fn add(&mut self, frame: &FrontLayer, color: [f32; 4], weight: f32) {
        self.weight += weight;
        self.sum.iter_mut().zip(color).for_each(|(sum, c)| *sum += weight * c);
        color[..frame.lights].iter().for_each(|c| self.sum_squares += weight * c * c);
    }

    fn mean_and_variance(&self, frame: &FrontLayer) -> Option<([f32; 4], f32)> {
        let mean = self.sum.map(|s| s / self.weight);
        (self.weight > 0.0).then(|| (mean, (self.sum_squares / self.weight - frame.norm2(mean)).max(0.0)))
    }
}

/// Visits what shows nothing but the surface at shift `s_surface` around a pixel, with its weight: pixels away from every edge,
/// and cells that are known to be hidden, of their layer; nearest rings first, weighted by `1 / r^2`.
pub(super) fn pure_pixels<'a>(
    frame: &FrontLayer<'a>,
    (x, y): (usize, usize),
    s_surface: f32,
    mut visit: impl FnMut(usize, Option<&'a SceneLayer>, f32),
) {
    let is_there = |s: f32| (s - s_surface).abs() < CONNECTED_PX;
    let mut found = false;
    for ring in 1..=MAX_RING {
        if ring > 2 && found {
            break;
        }
        for dy in -ring..=ring {
            let step = if dy.abs() == ring { 1 } else { 2 * ring };
            for dx in (-ring..=ring).step_by(step as usize) {
                let Some(q) = frame.offset(x, y, dx, dy) else { continue };
                let weight = 1.0 / (dx * dx + dy * dy) as f32;
                if frame.connectivity[q] & EDGE == 0 && is_there(frame.s[q]) {
                    visit(q, None, weight);
                    found = true;
                }
                for layer in frame.behind.iter().filter(|layer| is_there(layer.s[q])) {
                    visit(q, Some(layer), weight);
                    found = true;
                }
            }
        }
    }
}

/// The pure colour of the surface at shift `s_surface` around a pixel, and its variance.
fn pure_color(frame: &FrontLayer, x: usize, y: usize, s_surface: f32) -> Option<([f32; 4], f32)> {
    let mut pure = Pure::default();
    pure_pixels(frame, (x, y), s_surface, |q, hidden, weight| {
        let color = hidden.map_or_else(|| frame.color_at(q), |layer| layer.colors.at(q));
        pure.add(frame, color, weight);
    });
    pure.mean_and_variance(frame)
}

/// The pixel that shows most of a structure too thin to have a pure pixel. Among the surrounding pixels with the
/// structure's depth, it is the one whose colour differs most from the other surface: the structure covers that pixel
/// most.
fn extreme_pixel(frame: &FrontLayer, x: usize, y: usize, s_surface: f32, other: [f32; 4]) -> Option<usize> {
    let around = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dx, dy)));
    around
        .filter_map(|(dx, dy)| frame.offset(x, y, dx, dy))
        .filter(|&q| (frame.s[q] - s_surface).abs() < CONNECTED_PX)
        .map(|q| (frame.norm2(sub(frame.color_at(q), other)), q))
        .reduce(|best, next| if next.0 > best.0 { next } else { best })
        .map(|(_, q)| q)
}

/// Which edge pixels are separated.
#[derive(Clone, Copy)]
pub enum Separated {
    All,
    /// Those with a surface that is so many times as bright as the other one, and as this light.
    Outshining {
        times: f32,
        light: f32,
    },
}

impl Separated {
    /// Those with a lamp: an error in where a surface ends is made up for by the next pixel, but not one in a lamp's light.
    pub fn lamps(frame: &FrontLayer) -> Separated {
        Separated::Outshining { times: HIGHLIGHT_RATIO, light: frame.median_light() }
    }

    /// How much a pixel of these two colours is separated: from none at the limit on, and all from twice the limit on.
    fn strength(self, frame: &FrontLayer, a: [f32; 4], b: [f32; 4]) -> f32 {
        let Separated::Outshining { times, light } = self else { return 1.0 };
        let (a, b) = (frame.norm2(a).sqrt(), frame.norm2(b).sqrt());
        let limit = times * a.min(b).max(light);
        (a.max(b) / limit.max(f32::MIN_POSITIVE) - 1.0).clamp(0.0, 1.0)
    }

    /// For every block whether something in it is bright enough to be separated; `None` if that is no condition.
    fn bright_blocks(self, frame: &FrontLayer) -> Option<Vec<bool>> {
        let Separated::Outshining { times, light } = self else { return None };
        let Size { width, height, .. } = frame.size;
        let is_bright = |color: [f32; 4]| frame.norm2(color).sqrt() > times * light;
        let any_bright = |i: usize| {
            is_bright(frame.color_at(i)) || frame.behind.iter().any(|layer| is_bright(layer.colors.at(i)))
        };
        let across = width.div_ceil(BLOCK);
        let of_block = |b: usize| {
            let (x, y) = (b % across * BLOCK, b / across * BLOCK);
            let mut rows = y..(y + BLOCK).min(height);
            rows.any(|y| (x..(x + BLOCK).min(width)).any(|x| any_bright(y * width + x)))
        };
        Some((0..across * height.div_ceil(BLOCK)).into_par_iter().map(of_block).collect())
    }
}

/// The surfaces that a pixel mixes. Where three surfaces meet, its own one is one of
/// the two, and the other is the one of which there is more around it.
pub(super) fn two_surfaces<'a>(frame: &FrontLayer<'a>, x: usize, y: usize) -> [Surface<'a>; 2] {
    let own = frame.s[y * frame.size.width + x];
    let (mut nearer, mut farther) = (0.0, 0.0);
    let (mut s_front, mut s_back) = (own, own);
    for (dx, dy, s) in around(frame, x, y) {
        // A step of this size is one from surface to surface, and a larger one is no more than that.
        let step = ((s - own) / (2.0 * CONNECTED_PX)).clamp(-1.0, 1.0);
        nearer += nearness(dx, dy) * step.max(0.0);
        farther += nearness(dx, dy) * (-step).max(0.0);
        (s_front, s_back) = (s_front.max(s), s_back.min(s));
    }
    let at = |s: f32| Surface { s, known: None };
    if nearer > farther {
        return [at(s_front), at(own)];
    }
    [at(own), frame.known_behind(x, y).unwrap_or(at(s_back))]
}

/// The weight of a neighbour: (1 2 1) along each axis.
fn nearness(dx: i32, dy: i32) -> f32 {
    ((2 - dx.abs()) * (2 - dy.abs())) as f32
}

/// Separates one edge pixel; `None` if no pure colour is known of either surface, or it is not to be separated.
fn unmix_pixel(frame: &FrontLayer, separated: Separated, x: usize, y: usize) -> Option<MixedPixel> {
    let index = y * frame.size.width + x;
    let [front, back] = two_surfaces(frame, x, y);
    let (s_front, s_back) = (front.s, back.s);
    if s_front - s_back < CONNECTED_PX {
        return None;
    }

    let strength = edges::strength(frame.s, frame.size.width, frame.size.height, x, y);
    let [front, back] = [front, back].map(|Surface { s, known }| match known {
        Some(known) => Some((known.color, known.variance)),
        None => pure_color(frame, x, y, s),
    });
    // The variance of a guessed colour is unknown; it is taken to be that of the other colour.
    let guessed = |q: usize, variance: f32| (frame.color_at(q), variance);
    let mut sources = [PureSource::Around; 2];
    let ((front, front_variance), (back, back_variance)) = match (front, back) {
        (Some(front), Some(back)) => (front, back),
        (None, Some(back)) => {
            let guess = extreme_pixel(frame, x, y, s_front, back.0)?;
            sources[0] = PureSource::Pixel(guess as u32);
            (guessed(guess, back.1), back)
        }
        (Some(front), None) => {
            let guess = extreme_pixel(frame, x, y, s_back, front.0)?;
            sources[1] = PureSource::Pixel(guess as u32);
            (front, guessed(guess, front.1))
        }
        (None, None) => return None,
    };
    let share = separated.strength(frame, front, back);
    if share <= 0.0 {
        return None;
    }
    let strength = strength * share;

    // The coverage as depth alone suggests it: the [1 2 1]^2 average of "in front".
    let middle = 0.5 * (s_front + s_back);
    let (mut in_front, mut all) = (0.0, 0.0);
    for (dx, dy, s) in around(frame, x, y) {
        let weight = nearness(dx, dy);
        all += weight;
        in_front += if s > middle { weight } else { 0.0 };
    }
    let prior = in_front / all;
    let known = frame.known.binary_search_by_key(&index, |known| known.index).map(|i| frame.known[i]);
    let prior = known.map_or(prior, |known| prior + known.trust * (known.coverage - prior));

    let pixel = Pixel { frame, color: frame.color_at(index), front, back, prior };
    let floor = 1e-4 * (frame.norm2(front) + frame.norm2(back)) + f32::MIN_POSITIVE;
    let pure = pixel.split(front_variance + floor, back_variance + floor);
    let unexplained = frame.norm2(pixel.rest(pure.coverage));
    let contrast = frame.norm2(sub(front, back));
    let limit = UNEXPLAINED * (front_variance + back_variance + contrast + floor);
    // From half of the limit on, one explanation fades into the other.
    let foreign = (2.0 * unexplained / limit - 1.0).clamp(0.0, 1.0);
    let split = if foreign == 0.0 {
        pure
    } else {
        // The pixel contains something that neither pure colour shows, such as half a lamp. It belongs to the surface
        // whose pixels in the neighbourhood, mixed ones too, vary the most.
        let (own_front, own_back) =
            if frame.s[index] > middle { (SEEN_AT_CENTRE, 1.0) } else { (1.0, SEEN_AT_CENTRE) };
        let varied = |own: f32, s: f32, color: [f32; 4], variance: f32| {
            let pure = variance + floor;
            let varied = own * (spread(frame, x, y, s, color) + pure);
            // Variances fade by ratios: the spread may be many times the other.
            if foreign < 1.0 { pure * (varied / pure).powf(foreign) } else { varied }
        };
        pixel.split(
            varied(own_front, s_front, front, front_variance),
            varied(own_back, s_back, back, back_variance),
        )
    };
    Some(split.begun(index, pixel.color, frame.s[index], (s_front, s_back), (sources, strength)))
}

/// The shifts of a pixel and of its eight neighbours, with their offsets.
pub(super) fn around<'a>(
    frame: &'a FrontLayer,
    x: usize,
    y: usize,
) -> impl Iterator<Item = (i32, i32, f32)> + use<'a> {
    let offsets = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
    offsets.filter_map(move |(dx, dy)| frame.offset(x, y, dx, dy).map(|q| (dx, dy, frame.s[q])))
}

/// How far around a pixel [`spread`] searches, half a block: one lamp on a surface makes others nearby likely.
const SPREAD_RING: i32 = 8;

/// Mean squared difference between the pixels of a surface around a pixel and the surface's pure colour.
fn spread(frame: &FrontLayer, x: usize, y: usize, s_surface: f32, pure: [f32; 4]) -> f32 {
    let offsets = || -SPREAD_RING..=SPREAD_RING;
    let around = offsets().flat_map(|dy| offsets().map(move |dx| (dx, dy))).filter(|&d| d != (0, 0));
    let (mut sum, mut count) = (0.0, 0.0f32);
    for q in around.filter_map(|(dx, dy)| frame.offset(x, y, dx, dy)) {
        if (frame.s[q] - s_surface).abs() < CONNECTED_PX {
            sum += frame.norm2(sub(frame.color_at(q), pure));
            count += 1.0;
        }
    }
    sum / count.max(1.0)
}

/// A mixed pixel with the pure colours of both surfaces and the coverage that depth suggests.
struct Pixel<'a> {
    frame: &'a FrontLayer<'a>,
    color: [f32; 4],
    front: [f32; 4],
    back: [f32; 4],
    prior: f32,
}

/// A pixel's two colours and coverage.
struct Split {
    coverage: f32,
    front: [f32; 4],
    back: [f32; 4],
    /// See [`Recipe::rest_to_front`].
    rest_to_front: f32,
}

impl Split {
    /// The pixel of this colour and shift, separated as far as the edge has begun. At an edge without strength, both
    /// surfaces are the pixel itself.
    fn begun(
        &self,
        index: usize,
        color: [f32; 4],
        s: f32,
        (s_front, s_back): (f32, f32),
        ([front, back], strength): ([PureSource; 2], f32),
    ) -> MixedPixel {
        let toward = |v: f32, end: f32| toward(strength, v, end);
        let colored = |end: [f32; 4]| std::array::from_fn(|c| toward(color[c], end[c]));
        MixedPixel {
            index,
            s_front: toward(s, s_front),
            front: colored(self.front),
            coverage: self.coverage,
            s_back: toward(s, s_back),
            back: colored(self.back),
            recipe: Recipe { front, back, rest_to_front: self.rest_to_front, strength, back_light: 1.0 },
        }
    }
}

impl Pixel<'_> {
    /// The part of the pixel's colour that the two pure colours do not explain at this coverage.
    fn rest(&self, coverage: f32) -> [f32; 4] {
        std::array::from_fn(|c| self.color[c] - coverage * self.front[c] - (1.0 - coverage) * self.back[c])
    }

    /// How much of the unexplained rest of a pixel goes to the surface in front, in all channels alike: as much as `wanted`,
    /// or what comes nearest to it of what leaves no light of either surface negative. If nothing does so in all channels,
    /// it is what lies in the middle between those that ask for the most and for the least.
    fn rest_to_front(&self, [a, b]: [f32; 2], wanted: f32, rest: [f32; 4]) -> f32 {
        if a <= 0.0 || b <= 0.0 {
            return wanted;
        }
        let (mut least, mut most) = (0.0f32, 1.0 / a);
        for c in (0..self.frame.lights).filter(|&c| rest[c] < 0.0 && self.color[c] >= 0.0) {
            most = most.min(self.front[c].max(0.0) / -rest[c]);
            least = least.max((1.0 - b * self.back[c].max(0.0) / -rest[c]) / a);
        }
        if least > most { 0.5 * (least + most) } else { wanted.clamp(least, most) }
    }

    /// Least squares for `a` in `C = a F + (1 - a) B`, regularised towards the prior where the colours say little.
    /// The residual is distributed over the two colours by their variances, so that they reproduce `C` exactly.
    fn split(&self, front_variance: f32, back_variance: f32) -> Split {
        let contrast = sub(self.front, self.back);
        let light = sub(self.color, self.back).into_iter().zip(contrast).take(self.frame.lights);
        let along: f32 = light.map(|(c, d)| c * d).sum();
        // The standard deviation of the prior is a third, and a channel's variance is a third of the sum: (1/3) /
        // (1/3)^2.
        let trust = 3.0 * (front_variance + back_variance);
        let coverage = ((along + trust * self.prior) / (self.frame.norm2(contrast) + trust)).clamp(0.0, 1.0);
        let coverage = if coverage < PURE {
            0.0
        } else if coverage > 1.0 - PURE {
            1.0
        } else {
            coverage
        };

        let (a, b) = (coverage, 1.0 - coverage);
        let share = 1.0 / (a * a * front_variance + b * b * back_variance);
        let rest = self.rest(coverage);
        let rest_to_front = self.rest_to_front([a, b], a * front_variance * share, rest);
        let mut split = Split { coverage, front: self.front, back: self.back, rest_to_front };
        for c in 0..4 {
            split.front[c] += a * front_variance * share * rest[c];
            split.back[c] += b * back_variance * share * rest[c];
            // Light is not negative: if one side would become negative, the other side takes up the difference.
            if self.color[c] >= 0.0 && split.back[c] < 0.0 && a > 0.0 {
                (split.back[c], split.front[c]) = (0.0, self.color[c] / a);
            } else if self.color[c] >= 0.0 && split.front[c] < 0.0 && b > 0.0 {
                (split.front[c], split.back[c]) = (0.0, self.color[c] / b);
            }
        }
        // Nor is coverage more than all. Where one side would be, or less than nothing, the other side takes up the
        // difference.
        for c in self.frame.lights..self.frame.size.channels {
            let both = [split.front[c], split.back[c]];
            if a > 0.0 && b > 0.0 && both.iter().any(|v| !(0.0..=1.0).contains(v)) {
                let bounded = |v: f32| v.clamp(0.0, 1.0);
                let least = bounded((self.color[c] - b) / a);
                split.front[c] = split.front[c].max(least).min(bounded(self.color[c] / a));
                split.back[c] = bounded((self.color[c] - a * split.front[c]) / b);
            }
        }
        split
    }
}

/// The edge pixels that are to be separated and could be, in scan order.
pub fn unmix(frame: &FrontLayer, separated: Separated, cancel: &Cancel) -> Result<Vec<MixedPixel>> {
    let Size { width, height, .. } = frame.size;
    let bright = separated.bright_blocks(frame);
    // Pure colours are means of what is no farther than the longest ring.
    let blocks_around = |v: usize, n: usize| {
        let ring = MAX_RING as usize;
        v.saturating_sub(ring) / BLOCK..=(v + ring).min(n - 1) / BLOCK
    };
    let may_be_bright = |x: usize, y: usize| {
        bright.as_ref().is_none_or(|bright| {
            let in_row =
                |by: usize| blocks_around(x, width).any(|bx| bright[by * width.div_ceil(BLOCK) + bx]);
            blocks_around(y, height).any(in_row)
        })
    };
    let row = |y: usize| {
        cancel.check()?;
        let edges = (0..width).filter(|x| frame.connectivity[y * width + x] & EDGE != 0);
        let edges = edges.filter(|x| may_be_bright(*x, y));
        Ok(edges.filter_map(|x| unmix_pixel(frame, separated, x, y)).collect::<Vec<_>>())
    };
    let rows =
        (0..height).into_par_iter().with_max_len(ITEMS_PER_TASK).map(row).collect::<Result<Vec<_>>>()?;
    Ok(rows.concat())
}

#[cfg(test)]
mod tests {
    use super::super::colors::Colors;
    use super::super::layer::Role;
    use super::*;
    use std::sync::Arc;

    /// The pixels of a frame of 12 x 7 pixels, the first channel of which is light; of one column, all have one shift.
    fn unmixed(color: &[f32], s: impl Fn(usize) -> f32, behind: &[SceneLayer]) -> Vec<MixedPixel> {
        let size = Size { width: 12, height: 7, channels: color.len() / 84 };
        let s: Vec<f32> = (0..84).map(|i| s(i % 12)).collect();
        let connectivity = edges::connectivity(&s, 12, 7);
        let frame = FrontLayer { behind, ..FrontLayer::new(size, 1, color, &s, &connectivity) };
        unmix(&frame, Separated::All, &Cancel::default()).unwrap()
    }

    #[test]
    fn a_mixed_column_is_taken_apart() {
        // Columns 0..5 are a surface of colour 2 in front, columns 6.. a surface of colour 1 behind; column 5 is 30 %
        // front.
        let color: Vec<f32> = (0..84)
            .map(|i| match i % 12 {
                0..5 => 2.0,
                5 => 1.3,
                _ => 1.0,
            })
            .collect();
        let mixed = unmixed(&color, |x| if x < 5 { 8.0 } else { 0.0 }, &[]);
        for m in &mixed {
            let expected = match m.index % 12 {
                5 => 0.3,
                x => f32::from(x < 5),
            };
            assert!((m.coverage - expected).abs() < 2e-3, "column {}: {}", m.index % 12, m.coverage);
            assert!((m.front[0] - 2.0).abs() < 5e-3 && (m.back[0] - 1.0).abs() < 5e-3);
        }
        assert_eq!(mixed.len(), 2 * 7);
    }

    #[test]
    fn a_pixels_own_surface_is_one_of_the_two_that_it_mixes() {
        let at = |x: usize| match x {
            0..5 => (4.0, 24.0),
            5 => (2.0, 8.0),
            _ => (1.0, 0.0),
        };
        let color: Vec<f32> = (0..84).map(|i| at(i % 12).0).collect();
        let mixed = unmixed(&color, |x| at(x).1, &[]);
        let middle: Vec<_> = mixed.iter().filter(|m| m.index % 12 == 5).collect();
        assert_eq!(middle.len(), 7);
        for m in middle {
            assert!(m.s_front == 8.0 || m.s_back == 8.0, "{} before {}", m.s_front, m.s_back);
        }
    }

    #[test]
    fn what_is_known_to_be_behind_is_not_guessed() {
        // A surface of colour 2 covers 60 % of column 4; behind it the colour is 0.5, beside it 1.
        let at = |x: usize| match x {
            0..4 => (2.0, 8.0),
            4 => (0.6 * 2.0 + 0.4 * 0.5, 8.0),
            _ => (1.0, 0.0),
        };
        let color: Vec<f32> = (0..84).map(|i| at(i % 12).0).collect();
        let size = Size { width: 12, height: 7, channels: 1 };
        let hidden = |i: usize| if i % 12 < 5 { 0.0 } else { f32::NAN };
        let behind = [SceneLayer {
            role: Role::Surface,
            s: Arc::new((0..84).map(hidden).collect()),
            colors: Colors::new(size, Arc::new((0..84).map(|_| 0.5).collect())),
            partial: Arc::default(),
            connectivity: Arc::default(),
            carried: Vec::new(),
        }];
        let mixed = unmixed(&color, |x| at(x).1, &behind);
        let column: Vec<_> = mixed.iter().filter(|m| m.index % 12 == 4).collect();
        assert_eq!(column.len(), 7);
        for m in column {
            assert!((m.coverage - 0.6).abs() < 2e-3, "{}", m.coverage);
            assert!((m.back[0] - 0.5).abs() < 5e-3 && (m.front[0] - 2.0).abs() < 5e-3);
        }
    }

    /// Pixels of a picture of one column of light and coverage each, beside a straight silhouette.
    fn unmixed_beside_an_edge(pixels: [[f32; 2]; 12]) -> Vec<MixedPixel> {
        let color: Vec<f32> = (0..2 * 84).map(|i| pixels[i % 12][i / 84]).collect();
        unmixed(&color, |x| if x < 5 { 8.0 } else { 0.0 }, &[])
    }

    #[test]
    fn coverage_does_not_tell_what_is_in_front_and_stays_coverage() {
        let light = [2.0, 2.0, 2.0, 2.1, 2.0, 1.3, 1.0, 0.9, 1.0, 1.0, 1.0, 1.0];
        let of =
            |coverage: [f32; 12]| unmixed_beside_an_edge(std::array::from_fn(|x| [light[x], coverage[x]]));
        let plain = of([0.0; 12]);
        for coverage in [
            [1.0; 12],
            [0.9, 0.8, 1.0, 0.7, 1.0, 0.1, 0.0, 0.3, 0.2, 0.1, 0.0, 0.1],
            [0.0, 0.1, 0.0, 0.2, 0.0, 1.0, 1.0, 0.9, 0.8, 1.0, 1.0, 1.0],
        ] {
            let mixed = of(coverage);
            assert_eq!(mixed.len(), plain.len());
            for (m, plain) in mixed.iter().zip(&plain) {
                assert_eq!(
                    (m.coverage, m.front[0], m.back[0]),
                    (plain.coverage, plain.front[0], plain.back[0])
                );
                let [front, back] = [m.front[1], m.back[1]];
                assert!((0.0..=1.0).contains(&front) && (0.0..=1.0).contains(&back), "{front} {back}");
                let all = m.coverage * front + (1.0 - m.coverage) * back;
                assert!((all - coverage[m.index % 12]).abs() < 1e-6, "{all}");
                if coverage == [1.0; 12] {
                    assert_eq!([front, back], [1.0; 2]);
                }
            }
        }
    }
}
