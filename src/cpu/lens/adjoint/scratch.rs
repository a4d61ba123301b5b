//! What tiles are worked on with, one after another.

use super::around::{Around, Asked};
use super::gather::{self, Gather};
use super::highlights::{self, Light};
use super::views::Views;
use super::waves::{Beyond, read};
use super::window::Window;
use super::{disc, in_focus};
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::segments::Segments;
use crate::cpu::lens::tile_color::TileColor;
use crate::picture::Size;
use crate::plan::lens::tiles::{Tile, Work};
use crate::rows::with_channels;

/// The memory that they share.
pub struct Scratch {
    segments: Segments,
    views: Views,
    around: Around,
    given: TileColor,
    exact: TileColor,
}

impl Scratch {
    pub fn new(frame: &Frame, size: Size, asked: Asked) -> Scratch {
        Scratch {
            segments: Segments::default(),
            views: Views::new(size.channels),
            around: Around::new(frame, size.channels, asked),
            given: TileColor::new(size.channels),
            exact: TileColor::new(size.channels),
        }
    }

    /// What a tile adds to pixels and cells, and to highlights.
    pub fn colors(
        &mut self,
        frame: &Frame,
        size: Size,
        (number, tile): (usize, &Tile),
        cotangent: &[f32],
    ) -> (Vec<Window>, Vec<Light>) {
        let (layers, padding) = (&frame.scene.layers, &frame.padded.padding);
        read(size, cotangent, tile.origin, &mut self.given);
        let lights = highlights::adjoint(frame, number, tile, &self.given);
        let windows = match &tile.work {
            Work::InFocus => {
                vec![in_focus::adjoint(layers, size, padding, &frame.in_focus, tile.origin, &self.given)]
            }
            Work::Disc => vec![disc::adjoint(frame, size, tile, &self.given)],
            Work::Sweep { samples, disc, .. } => {
                let mut windows = Vec::new();
                if *disc > 0.0 {
                    scaled(&self.given, *disc, &mut self.exact);
                    windows.push(disc::adjoint(frame, size, tile, &self.exact));
                    scaled(&self.given, 1.0 - *disc, &mut self.exact);
                    std::mem::swap(&mut self.given, &mut self.exact);
                }
                self.look(frame, tile, *samples, &Beyond::read(size, cotangent, tile.origin));
                with_channels!(size.channels, C => {
                    gather::visit(&mut self.views, &mut self.around, |gather: &mut Gather<C>, _, view| {
                        gather.add(frame.simd, view, None);
                    });
                });
                windows.extend(self.around.added());
                windows
            }
        };
        (windows, lights)
    }

    /// What a tile adds to the shifts and colours of cells, and to highlights.
    pub fn shifts(
        &mut self,
        frame: &Frame,
        size: Size,
        (number, tile): (usize, &Tile),
        cotangent: &[f32],
    ) -> (Vec<Window>, Vec<Light>) {
        let Work::Sweep { samples, .. } = tile.work else { return (Vec::new(), Vec::new()) };
        read(size, cotangent, tile.origin, &mut self.given);
        let lights = highlights::adjoint(frame, number, tile, &self.given);
        self.look(frame, tile, samples, &Beyond::read(size, cotangent, tile.origin));
        let samples = frame.samples(samples);
        with_channels!(size.channels, C => {
            gather::visit(&mut self.views, &mut self.around, |gather: &mut Gather<C>, sample, view| {
                gather.add(frame.simd, view, Some(&samples[sample]));
            });
        });
        (self.around.added().collect(), lights)
    }

    /// Finds what the samples of a tile that is swept with so many meet.
    fn look(&mut self, frame: &Frame, tile: &Tile, samples: usize, beyond: &Beyond) {
        let Scratch { segments, views, around, given, .. } = self;
        let Work::Sweep { occupied, .. } = &tile.work else { unreachable!("the tile is swept") };
        frame.trace(segments, tile, samples, occupied);
        // SAFETY: the segments have just been traced there.
        unsafe { views.look(frame, segments, tile.origin, given, beyond) };
        around.take(frame, tile.origin, views.reach);
    }
}

fn scaled(from: &TileColor, by: f32, into: &mut TileColor) {
    for (from, into) in from.planes.iter().zip(&mut into.planes) {
        into.iter_mut().zip(from).for_each(|(into, from)| *into = by * from);
    }
}
