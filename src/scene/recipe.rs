//! How the values of a cell are made of those of pixels: what the colours of a picture decide, for channels that it carries.

use crate::picture::{ChannelGroup, Weighting};
use crate::rows::mix;

/// Where the pure colour of a surface is taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PureSource {
    /// From the pixels around that show nothing but this surface.
    Around,
    /// From one pixel.
    Pixel(u32),
}

/// How the colours of both surfaces of a mixed pixel are made of those of pixels: for channels that are carried, which
/// are all taken apart alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    pub front: PureSource,
    pub back: PureSource,
    /// How much of what the pure colours leave unexplained of the pixel is added to the surface in front.
    pub rest_to_front: f32,
    /// How far the pixel is separated.
    pub strength: f32,
    /// The part of the light behind that stays there; see [`lamp_ends`](super::lamp_ends).
    pub back_light: f32,
}

impl Recipe {
    /// The values in front and behind of a pixel of which `coverage` is in front, from its own and the two pure ones.
    pub fn apply(
        &self,
        coverage: f32,
        weighting: Weighting,
        own: [f32; 4],
        [front, back]: [[f32; 4]; 2],
    ) -> [[f32; 4]; 2] {
        let (a, b) = (coverage, 1.0 - coverage);
        let to_front = self.rest_to_front;
        let to_back = if b > 0.0 { (1.0 - a * to_front) / b } else { 0.0 };
        let ends: [[f32; 4]; 2] = match weighting {
            // A pixel that one surface covers by more than half tells of that one, the more the wholer it is covered.
            Weighting::Mean => {
                let of_own = [(2.0 * a - 1.0).max(0.0), (2.0 * b - 1.0).max(0.0)];
                let mixed = |end: [f32; 4], part: f32| std::array::from_fn(|c| mix(end[c], own[c], part));
                [mixed(front, of_own[0]), mixed(back, of_own[1])]
            }
            Weighting::Light => {
                let rest: [f32; 4] = std::array::from_fn(|c| own[c] - a * front[c] - b * back[c]);
                [
                    std::array::from_fn(|c| front[c] + to_front * rest[c]),
                    std::array::from_fn(|c| back[c] + to_back * rest[c]),
                ]
            }
        };
        let ends = ends.map(|end| std::array::from_fn(|c| toward(self.strength, own[c], end[c])));
        match weighting {
            Weighting::Mean => ends,
            Weighting::Light => self.end(coverage, ends),
        }
    }

    /// The light in front and behind, without what does not stay behind. What the pixel shows of that is in front instead, so
    /// that both surfaces together look as they did.
    pub fn end(&self, coverage: f32, [front, back]: [[f32; 4]; 2]) -> [[f32; 4]; 2] {
        if self.back_light == 1.0 {
            return [front, back];
        }
        let moved = (1.0 - self.back_light) * (1.0 - coverage) / coverage;
        [std::array::from_fn(|c| front[c] + moved * back[c]), back.map(|v| self.back_light * v)]
    }
}

/// What `v` becomes where a pixel is separated so far, and entirely `end`.
pub fn toward(strength: f32, v: f32, end: f32) -> f32 {
    if strength < 1.0 { v + strength * (end - v) } else { end }
}

/// The pixel whose colour a ray brings along.
#[derive(Clone, Copy)]
pub enum Source {
    Pixel(usize),
    /// The surface behind the mixed pixel of this number.
    Behind(usize),
}

/// What rays bring along from their sources, beside colours, by the weights of the colours.
pub trait Cargo: Sync {
    /// A weighted sum of what has been brought along.
    type Load: Clone + Send + Sync;

    /// A load to which nothing has been added.
    fn nothing(&self) -> Self::Load;

    /// Adds a source; of its light this part.
    fn add(&self, sum: &mut Self::Load, weight: f32, light: f32, source: Source);

    /// Adds what others have brought.
    fn add_load(sum: &mut Self::Load, weight: f32, load: &Self::Load);
}

/// The values of channels.
#[derive(Clone, Copy)]
pub struct Channels<'a> {
    pub groups: &'a [ChannelGroup],
    /// The values of both surfaces of the mixed pixels; see [`of_mixed`](super::carried::of_mixed).
    pub mixed: &'a [[[f32; 4]; 2]],
}

impl Cargo for Channels<'_> {
    type Load = Vec<[f32; 4]>;

    fn nothing(&self) -> Vec<[f32; 4]> {
        vec![[0.0; 4]; self.groups.len()]
    }

    fn add(&self, sum: &mut Vec<[f32; 4]>, weight: f32, light: f32, source: Source) {
        for (g, (sum, group)) in sum.iter_mut().zip(self.groups).enumerate() {
            let values = match source {
                Source::Pixel(q) => group.at(q),
                Source::Behind(i) => self.mixed[i * self.groups.len() + g][1],
            };
            let weight = match group.weighting {
                Weighting::Light => weight * light,
                Weighting::Mean => weight,
            };
            sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight * v);
        }
    }

    fn add_load(sum: &mut Vec<[f32; 4]>, weight: f32, load: &Vec<[f32; 4]>) {
        for (sum, values) in sum.iter_mut().zip(load) {
            sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight * v);
        }
    }
}
