//! Channels that a picture carries: any number of them, of any meaning.
//!
//! The picture's own colours decide how surfaces are found, mixed pixels taken apart, hidden surfaces filled and
//! highlights drawn. Every carried channel is then the same linear map of its own values, so that it depends on no other
//! channel, and the result of a sum is the sum of the results.

use crate::picture::{ChannelGroup, Size, Weighting};
use rayon::prelude::*;
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

/// One channel of the output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channel {
    /// What it holds.
    pub kind: ChannelKind,
    /// Its place in the output.
    pub place: usize,
    /// The rendered channel by which it is divided, if its values have been multiplied by weights.
    pub weight: Option<usize>,
}

/// All channels that a picture carries, in the order in which they are rendered: light, mattes, data and normals, and
/// last the weights of data.
#[derive(Debug, Clone, PartialEq)]
pub struct Carried {
    /// The channels themselves, and the weights.
    pub groups: Arc<Vec<ChannelGroup>>,
    channels: Vec<Channel>,
    /// For each channel of data, the pixels whose weight is not 1, in order, with their values as they were given.
    given: Arc<Vec<Vec<(u32, f32)>>>,
}

impl Carried {
    /// The order in which channels of these kinds are rendered, with their places in the output.
    pub fn order(kinds: &[ChannelKind]) -> Vec<(ChannelKind, usize)> {
        let mut channels: Vec<_> = kinds.iter().copied().zip(0..).collect();
        channels.sort();
        channels
    }

    /// The sizes and the weightings of the groups into which channels in this order fall.
    pub fn groups_of(size: Size, channels: &[(ChannelKind, usize)]) -> Vec<(Size, Weighting)> {
        let all: Vec<Weighting> = channels.iter().map(|(kind, _)| kind.weighting()).collect();
        let alike = all.chunk_by(|a, b| a == b).flat_map(|alike| alike.chunks(ChannelGroup::MOST));
        alike.map(|group| (Size { channels: group.len(), ..size }, group[0])).collect()
    }

    /// Channels in their order, in groups of the sizes that [`Carried::groups_of`] gives, followed by groups of weights.
    /// `given` has, for each channel of data, the pixels whose weight is not 1.
    pub fn new(groups: Vec<ChannelGroup>, channels: Vec<Channel>, given: Vec<Vec<(u32, f32)>>) -> Carried {
        Carried { groups: Arc::new(groups), channels, given: Arc::new(given) }
    }

    /// Number of channels that are rendered.
    pub fn rendered(&self) -> usize {
        self.groups.iter().map(|group| group.size.channels).sum()
    }

    /// Number of channels of the output.
    pub fn outputs(&self) -> usize {
        self.channels.len()
    }

    /// Number of channels that hold light; they are the first.
    pub fn lights(&self) -> usize {
        self.channels.iter().take_while(|channel| channel.kind == ChannelKind::Light).count()
    }

    /// Puts rendered channels, interleaved, in the order of the output, and divides data by their weight. `own` says that
    /// the output has the pixels of a picture of one layer: a pixel of data that is rendered as it was then comes back bit for bit.
    pub fn finish(&self, rendered: &[f32], own: bool, out: &mut [f32]) {
        const PIXELS: usize = 1 << 12;
        let (channels, outputs) = (self.rendered(), self.outputs());
        let planes = self.groups.iter().flat_map(|group| group.layers[0].chunks_exact(group.size.pixels()));
        let planes: Vec<&[f32]> = planes.collect();
        let data = self.channels.partition_point(|channel| channel.kind.weighting() == Weighting::Light);
        let parts = out.par_chunks_mut(PIXELS * outputs).zip(rendered.par_chunks(PIXELS * channels));
        parts.enumerate().for_each(|(part, (out, rendered))| {
            let pixels = out.chunks_exact_mut(outputs).zip(rendered.chunks_exact(channels));
            for (index, (out, pixel)) in (part * PIXELS..).zip(pixels) {
                for (channel, v) in self.channels[..data].iter().zip(pixel) {
                    out[channel.place] = *v;
                }
                let is_own = |c: usize| own && planes[c][index] == pixel[c];
                let mut c = data;
                while c < outputs {
                    let together =
                        if self.channels[c].kind == ChannelKind::Normal { c..c + 3 } else { c..c + 1 };
                    c = together.end;
                    let stayed = |c: usize| is_own(c) && self.channels[c].weight.is_none_or(is_own);
                    if together.clone().all(stayed) {
                        for c in together {
                            out[self.channels[c].place] = self.given(c - data, index, pixel[c]);
                        }
                        continue;
                    }
                    let square: f32 = pixel[together.clone()].iter().map(|v| v * v).sum();
                    for channel in together {
                        let Channel { kind, place, weight } = self.channels[channel];
                        let divisor = match kind {
                            ChannelKind::Normal => square.sqrt(),
                            _ => weight.map_or(1.0, |weight| pixel[weight]),
                        };
                        out[place] = if divisor > 0.0 { pixel[channel] / divisor } else { 0.0 };
                    }
                }
            }
        });
    }

    /// The value of a channel of data as it was given, where it is rendered as `rendered` from its pixel alone.
    fn given(&self, data: usize, index: usize, rendered: f32) -> f32 {
        let given = &self.given[data];
        given.binary_search_by_key(&index, |(pixel, _)| *pixel as usize).map_or(rendered, |i| given[i].1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::Buffer;
    use ChannelKind::{Data, Light, Matte, Normal};

    #[test]
    fn groups_hold_up_to_four_channels_of_one_weighting() {
        let size = Size { width: 2, height: 1, channels: 3 };
        let channels = Carried::order(&[Data, Light, Matte, Light, Light, Light, Normal, Normal, Normal]);
        assert_eq!(channels[..2], [(Light, 1), (Light, 3)]);
        assert_eq!(channels[5..], [(Data, 0), (Normal, 6), (Normal, 7), (Normal, 8)]);
        let groups = Carried::groups_of(size, &channels);
        let sizes: Vec<_> = groups.iter().map(|(size, weighting)| (size.channels, *weighting)).collect();
        assert_eq!(sizes, [(4, Weighting::Light), (1, Weighting::Light), (4, Weighting::Mean)]);
    }

    #[test]
    fn data_are_divided_by_their_weight_and_an_own_pixel_comes_back_as_it_was() {
        let size = Size { width: 2, height: 1, channels: 1 };
        let group = |values: [f32; 2]| {
            let planes = Arc::new(values.into_iter().collect::<Buffer<f32>>());
            ChannelGroup { size, weighting: Weighting::Mean, layers: vec![planes] }
        };
        let groups = vec![group([0.7 * 0.3, 0.0]), group([0.3, 0.0])];
        let channels = vec![Channel { kind: Data, place: 0, weight: Some(1) }];
        let carried = Carried::new(groups, channels, vec![vec![(0, 0.7), (1, f32::INFINITY)]]);
        let mut out = [0.0; 2];
        carried.finish(&[0.7 * 0.3, 0.3, 0.0, 0.0], true, &mut out);
        assert_eq!(out, [0.7, f32::INFINITY]);
        carried.finish(&[1.0, 0.5, 0.0, 0.0], false, &mut out);
        assert_eq!(out, [2.0, 0.0]);
    }
}
