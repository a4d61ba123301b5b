//! Channels that a picture carries: any number of them, of any meaning.
//!
//! The picture's own colours decide how surfaces are found, mixed pixels taken apart, hidden surfaces filled and
//! highlights drawn. Every carried channel is then the same linear map of its own values, so that it depends on no other
//! channel, and the result of a sum is the sum of the results.

use crate::memory::Buffer;
use crate::picture::Size;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// What a carried channel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ChannelKind {
    /// Light.
    Light,
    /// Coverage: as light, but no lens darkens it.
    Matte,
    /// Numbers that mean nothing when they are added up: they are averaged.
    Data,
    /// Data of three channels that are brought back to unit length.
    Normal,
}

impl ChannelKind {
    /// Every kind with the name users give it.
    pub const NAMES: [(&'static str, ChannelKind); 4] = [
        ("light", ChannelKind::Light),
        ("matte", ChannelKind::Matte),
        ("data", ChannelKind::Data),
        ("normal", ChannelKind::Normal),
    ];

    fn weighting(self) -> Weighting {
        match self {
            ChannelKind::Light | ChannelKind::Matte => Weighting::Light,
            ChannelKind::Data | ChannelKind::Normal => Weighting::Mean,
        }
    }
}

/// How the values of a channel are put together from those of its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weighting {
    /// As light: mixed pixels are taken apart so that both parts add up to them, and the blur of drawing at fractions of
    /// a pixel is undone. Some weights are negative.
    Light,
    /// As a mean: no weight is negative.
    Mean,
}

/// Up to four channels that are rendered together. None of them knows of another one.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// The frame, with the channels of this group.
    pub size: Size,
    /// How their values are put together.
    pub weighting: Weighting,
    /// One plane for each channel.
    pub planes: Arc<Buffer<f32>>,
}

impl Group {
    /// The most channels of a group.
    pub const MOST: usize = 4;

    /// The values of a pixel; zero for channels that the group does not have.
    pub fn at(&self, index: usize) -> [f32; 4] {
        let n = self.size.pixels();
        std::array::from_fn(|c| if c < self.size.channels { self.planes[c * n + index] } else { 0.0 })
    }
}

/// The values of data where the picture does not cover its pixel wholly, as they were given.
#[derive(Debug, Default, PartialEq)]
pub struct Uncovered {
    /// The pixels, in order.
    pub pixels: Vec<usize>,
    /// For each channel of data, one value for each of the pixels.
    pub values: Vec<Vec<f32>>,
}

/// All channels that a picture carries, in the order in which they are rendered: light, mattes, data and normals, and
/// last the coverage by which data are weighted, if the picture has any.
#[derive(Debug, Clone, PartialEq)]
pub struct Carried {
    /// The channels themselves.
    pub groups: Arc<Vec<Group>>,
    /// The kind of each of them, and its place in the output. The coverage that weights data is not among them.
    channels: Vec<(ChannelKind, usize)>,
    /// Whether data are multiplied by coverage, which is then the last channel.
    weighted: bool,
    uncovered: Arc<Uncovered>,
}

impl Carried {
    /// The order in which channels of these kinds are rendered.
    pub fn order(kinds: &[ChannelKind]) -> Vec<(ChannelKind, usize)> {
        let mut channels: Vec<_> = kinds.iter().copied().zip(0..).collect();
        channels.sort();
        channels
    }

    /// The sizes and the weightings of the groups into which channels in this order fall.
    pub fn groups_of(
        size: Size,
        channels: &[(ChannelKind, usize)],
        weighted: bool,
    ) -> Vec<(Size, Weighting)> {
        let mut all: Vec<Weighting> = channels.iter().map(|(kind, _)| kind.weighting()).collect();
        all.extend(weighted.then_some(Weighting::Mean));
        let alike = all.chunk_by(|a, b| a == b).flat_map(|alike| alike.chunks(Group::MOST));
        alike.map(|group| (Size { channels: group.len(), ..size }, group[0])).collect()
    }

    /// These groups of channels, as [`Carried::groups_of`] gives their sizes. Data are multiplied by coverage if they
    /// are `weighted`.
    pub fn new(
        groups: Vec<Group>,
        channels: Vec<(ChannelKind, usize)>,
        weighted: bool,
        uncovered: Uncovered,
    ) -> Carried {
        Carried { groups: Arc::new(groups), channels, weighted, uncovered: Arc::new(uncovered) }
    }

    /// Number of channels that are rendered.
    pub fn rendered(&self) -> usize {
        self.channels.len() + usize::from(self.weighted)
    }

    /// Number of channels of the output.
    pub fn outputs(&self) -> usize {
        self.channels.len()
    }

    /// Number of channels that hold light; they are the first.
    pub fn lights(&self) -> usize {
        self.channels.iter().take_while(|(kind, _)| *kind == ChannelKind::Light).count()
    }

    /// The channels that hold data.
    fn data(&self) -> Range<usize> {
        let is_data = |(kind, _): &(ChannelKind, usize)| kind.weighting() == Weighting::Mean;
        let first = self.channels.iter().position(is_data).unwrap_or(self.channels.len());
        first..self.channels.len()
    }

    /// Puts rendered channels, interleaved, in the order of the output, and divides data by their weight. `own` says that
    /// the output has the pixels of the picture: a pixel of data that is rendered as it was then comes back bit for bit.
    pub fn finish(&self, rendered: &[f32], own: bool, out: &mut [f32]) {
        const PIXELS: usize = 1 << 12;
        let (channels, outputs) = (self.rendered(), self.outputs());
        let planes: Vec<(&[f32], usize)> = self
            .groups
            .iter()
            .flat_map(|group| (0..group.size.channels).map(|c| (&group.planes[..], c * group.size.pixels())))
            .collect();
        let data = self.data();
        let parts = out.par_chunks_mut(PIXELS * outputs).zip(rendered.par_chunks(PIXELS * channels));
        parts.enumerate().for_each(|(part, (out, rendered))| {
            for (i, (out, pixel)) in
                out.chunks_exact_mut(outputs).zip(rendered.chunks_exact(channels)).enumerate()
            {
                let index = part * PIXELS + i;
                for (&(_, place), v) in self.channels[..data.start].iter().zip(pixel) {
                    out[place] = *v;
                }
                let is_own = |c: usize| own && planes[c].0[planes[c].1 + index] == pixel[c];
                let weight_is_own = !self.weighted || is_own(channels - 1);
                let mut c = data.start;
                while c < data.end {
                    let (kind, _) = self.channels[c];
                    let together = if kind == ChannelKind::Normal { 3 } else { 1 };
                    let all = c..c + together;
                    if weight_is_own && all.clone().all(is_own) {
                        all.clone().for_each(|c| out[self.channels[c].1] = self.given(c, index, pixel[c]));
                    } else {
                        let weight = if self.weighted { pixel[channels - 1] } else { 1.0 };
                        let square: f32 = pixel[all.clone()].iter().map(|v| v * v).sum();
                        let divisor = if kind == ChannelKind::Normal { square.sqrt() } else { weight };
                        for c in all.clone() {
                            out[self.channels[c].1] = if divisor > 0.0 { pixel[c] / divisor } else { 0.0 };
                        }
                    }
                    c = all.end;
                }
            }
        });
    }

    /// The value of channel `c` as it was given, where it is rendered as `rendered` from its pixel alone.
    fn given(&self, c: usize, index: usize, rendered: f32) -> f32 {
        match self.uncovered.pixels.binary_search(&index) {
            Ok(i) => self.uncovered.values[c - self.data().start][i],
            Err(_) => rendered,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ChannelKind::{Data, Light, Matte, Normal};

    #[test]
    fn groups_hold_up_to_four_channels_of_one_weighting() {
        let size = Size { width: 2, height: 1, channels: 3 };
        let channels = Carried::order(&[Data, Light, Matte, Light, Light, Light, Normal, Normal, Normal]);
        assert_eq!(channels[..2], [(Light, 1), (Light, 3)]);
        assert_eq!(channels[5..], [(Data, 0), (Normal, 6), (Normal, 7), (Normal, 8)]);
        let groups = Carried::groups_of(size, &channels, true);
        let sizes: Vec<_> = groups.iter().map(|(size, weighting)| (size.channels, *weighting)).collect();
        use Weighting::Mean;
        assert_eq!(sizes, [(4, Weighting::Light), (1, Weighting::Light), (4, Mean), (1, Mean)]);
    }

    #[test]
    fn data_are_divided_by_their_weight_and_an_own_pixel_comes_back_as_it_was() {
        let size = Size { width: 2, height: 1, channels: 2 };
        let planes = Arc::new([0.7f32 * 0.3, 0.0, 0.3, 0.0].into_iter().collect::<Buffer<f32>>());
        let groups = vec![Group { size, weighting: Weighting::Mean, planes }];
        let uncovered = Uncovered { pixels: vec![0, 1], values: vec![vec![0.7, 9.0]] };
        let carried = Carried::new(groups, Carried::order(&[Data]), true, uncovered);
        let mut out = [0.0; 2];
        carried.finish(&[0.7 * 0.3, 0.3, 0.0, 0.0], true, &mut out);
        assert_eq!(out, [0.7, 9.0]);
        carried.finish(&[1.0, 0.5, 0.0, 0.0], false, &mut out);
        assert_eq!(out, [2.0, 0.0]);
    }
}
