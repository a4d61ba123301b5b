//! Channels that are rendered together: those of a picture, or some of those that it carries.

use crate::picture::{ChannelGroup, Picture, Size, Weighting};
use crate::plan::lens::carried::CarriedLight;
use crate::plan::lens::footprint::Sharpening;
use crate::plan::lens::highlights::Highlights;
use crate::scene::colors::{CellColor, Colors};
use crate::scene::contrast::light_channels;
use crate::scene::layered::LayeredScene;

/// The input of a render.
pub struct Input<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// The layered scene made from it.
    pub scene: &'a LayeredScene,
    /// The output averages this many pixels along each axis, so correspondingly fewer samples are enough.
    pub supersample: usize,
}

/// Up to four channels.
pub struct Group<'a> {
    /// The frame with these channels.
    pub size: Size,
    /// Planes of each layer, as they were given; behind holdouts those of what the pinhole sees.
    pub planes: Vec<&'a [f32]>,
    /// The coverage of each of these layers; one layer covers all.
    pub coverage: Vec<&'a [f32]>,
    /// The colours of each layer without the light of highlights.
    pub dimmed: Vec<Colors>,
    /// The same with the light of highlights that is swept, if some is.
    pub swept: Option<Vec<Colors>>,
    /// The light of each highlight.
    pub excess: Vec<[f32; 4]>,
    /// In how many channels, the first ones, highlights are drawn.
    pub lights: usize,
    pub sharpening: Sharpening,
}

/// The colours of some layers with these cells changed.
fn changed<'a>(of_layers: impl Iterator<Item = &'a Colors>, changes: &[Vec<CellColor>]) -> Vec<Colors> {
    let of_layer = |(i, colors): (usize, &Colors)| match changes.get(i) {
        Some(changes) if !changes.is_empty() => colors.with(changes.clone()),
        _ => colors.clone(),
    };
    of_layers.enumerate().map(of_layer).collect()
}

impl<'a> Group<'a> {
    /// The channels of the picture itself.
    pub fn of_picture(input: &Input<'a>, highlights: &Highlights) -> Group<'a> {
        let Input { picture, scene, .. } = *input;
        let colors = |changes: &[Vec<CellColor>]| changed(scene.layers.iter().map(|l| &l.colors), changes);
        let (planes, coverage) = match &scene.held {
            Some(held) => (vec![&held.own[..]], Vec::new()),
            None => (picture.layers.iter().map(|layer| &layer.color[..]).collect(), picture.coverage()),
        };
        Group {
            size: picture.size,
            planes,
            coverage,
            dimmed: colors(&highlights.dimmed),
            swept: highlights.swept.as_deref().map(colors),
            excess: highlights.all.iter().map(|highlight| highlight.excess).collect(),
            lights: light_channels(picture.size),
            sharpening: Sharpening::Own,
        }
    }

    /// The groups of channels that the picture carries. Of each cell's light, the part is a highlight that the picture has
    /// found.
    pub fn carried(input: &Input<'a>, highlights: &Highlights) -> Vec<Group<'a>> {
        let Input { picture, scene, .. } = *input;
        let group = |(g, group): (usize, &'a ChannelGroup)| {
            let layers = scene.layers.iter().map(|layer| &layer.carried[g]);
            let (planes, coverage) = match &scene.held {
                Some(held) => (vec![&held.carried[g][..]], Vec::new()),
                None => (group.layers.iter().map(|planes| &planes[..]).collect(), picture.coverage()),
            };
            let plain = Group {
                size: group.size,
                planes,
                coverage,
                dimmed: Vec::new(),
                swept: None,
                excess: Vec::new(),
                lights: 0,
                sharpening: Sharpening::of_carried(group.weighting),
            };
            match group.weighting {
                Weighting::Mean => Group { dimmed: layers.cloned().collect(), ..plain },
                Weighting::Light => {
                    let light = CarriedLight::new(scene, highlights, g);
                    Group {
                        dimmed: changed(layers.clone(), &light.dimmed),
                        swept: light.swept.map(|swept| changed(layers, &swept)),
                        excess: light.excess,
                        lights: group.size.channels,
                        ..plain
                    }
                }
            }
        };
        picture.carried.iter().enumerate().map(group).collect()
    }

    /// The colours of each layer with which cells are swept.
    pub fn swept(&self) -> &[Colors] {
        self.swept.as_ref().unwrap_or(&self.dimmed)
    }
}
