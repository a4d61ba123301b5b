//! What tiles are worked on with, one after another.

use super::around::Around;
use super::gather::Gather;
use super::highlights::{self, Light};
use super::job::Job;
use super::pairs::Pair;
use super::views::Views;
use super::waves::{Beyond, read};
use super::window::Window;
use super::{disc, in_focus, own_shifts, through};
use crate::cpu::lens::disc::RunningSums;
use crate::cpu::lens::in_focus::{Composite, first_of};
use crate::cpu::lens::segments::Segments;
use crate::cpu::lens::tile_color::TileColor;
use crate::error::Result;
use crate::picture::Size;
use crate::plan::lens::tiles::{Tile, Work};
use crate::rows::with_channels;
use crate::scene::grid::TILE;

/// The memory that they share.
pub struct Scratch {
    segments: Segments,
    views: Views,
    around: Around,
    pairs: Vec<Pair>,
    sums: RunningSums,
    composite: Composite,
    given: TileColor,
    /// The part of it that is given to what is not swept, and how that changes with shifts.
    exact: TileColor,
    slopes: TileColor,
}

impl Scratch {
    pub fn new(job: &Job) -> Scratch {
        let channels = job.size.channels;
        let tile = || TileColor::new(channels);
        Scratch {
            segments: Segments::default(),
            views: Views::new(channels),
            around: Around::new(job.frame, channels, job.asked),
            pairs: Vec::new(),
            sums: RunningSums::default(),
            composite: Composite::default(),
            given: tile(),
            exact: tile(),
            slopes: tile(),
        }
    }

    /// What a tile adds to pixels and cells, and to highlights.
    pub fn tile(&mut self, job: &Job, (number, tile): (usize, &Tile)) -> Result<(Vec<Window>, Vec<Light>)> {
        read(job.size, job.cotangent, tile.origin, &mut self.given);
        let lights = highlights::adjoint(job.frame, number, tile, &self.given);
        let windows = match &tile.work {
            Work::InFocus => self.in_focus(job, tile),
            Work::Disc => self.disc(job, tile, 1.0)?,
            Work::Sweep { samples, disc, .. } => {
                let mut windows = Vec::new();
                if *disc > 0.0 {
                    windows = self.disc(job, tile, *disc)?;
                    scaled(&self.given, 1.0 - *disc, &mut self.exact);
                    std::mem::swap(&mut self.given, &mut self.exact);
                }
                self.sweep(job, tile, *samples);
                windows.extend(self.around.added());
                windows
            }
        };
        Ok((windows, lights))
    }

    /// What a tile in focus adds.
    fn in_focus(&mut self, job: &Job, tile: &Tile) -> Vec<Window> {
        let &Job { frame, size, asked, group, .. } = job;
        let (layers, padding) = (&frame.scene.layers, &frame.padded.padding);
        let mut windows = Vec::new();
        if asked.colors() {
            let window = in_focus::adjoint(layers, size, padding, &frame.in_focus, tile.origin, &self.given);
            windows.push(window);
        }
        if asked.shifts() {
            self.composite.slopes(group, layers, &frame.in_focus, tile.origin, &mut self.slopes);
            let cell = |pixel| first_of(layers, pixel);
            windows.extend(own_shifts::adjoint(job, tile.origin, cell, &self.given, &self.slopes));
        }
        windows
    }

    /// What a tile adds of which so much is exact discs.
    fn disc(&mut self, job: &Job, tile: &Tile, share: f32) -> Result<Vec<Window>> {
        let &Job { frame, size, asked, .. } = job;
        scaled(&self.given, share, &mut self.exact);
        let mut windows = Vec::new();
        if asked.colors() {
            windows.push(disc::adjoint(frame, size, tile, &self.exact));
        }
        if asked.shifts() {
            job.discs.slopes(&job.beside, tile.origin, &mut self.sums, &mut self.slopes)?;
            let front = frame.scene.front;
            windows.extend(own_shifts::adjoint(job, tile.origin, |_| Some(front), &self.exact, &self.slopes));
        }
        Ok(windows)
    }

    /// Adds what a tile takes that is swept with so many samples to the cells around it.
    fn sweep(&mut self, job: &Job, tile: &Tile, samples: usize) {
        let &Job { frame, size, asked, .. } = job;
        let Scratch { segments, views, around, pairs, given, .. } = self;
        let Work::Sweep { occupied, .. } = &tile.work else { unreachable!("the tile is swept") };
        frame.trace(segments, tile, samples, occupied);
        if frame.padded.translucent {
            around.take(frame, (tile.origin, [true; 2]), through::reach(frame, tile));
            // SAFETY: the segments have just been traced there.
            unsafe { through::add(frame, segments, tile, given, around) };
            return;
        }
        let (x, y) = tile.origin;
        let (right, below) = (swept(job, x + TILE.0, y), swept(job, x, y + TILE.1));
        let beyond = Beyond::read(size, job.cotangent, tile.origin, [right, below]);
        // SAFETY: the segments have just been traced there.
        unsafe { views.look(frame, segments, (tile.origin, frame.samples(samples)), given, &beyond) };
        let is_swept =
            |x: Option<usize>, y: Option<usize>| x.zip(y).is_some_and(|(x, y)| swept(job, x, y) > 0.0);
        let is_first = [!is_swept(x.checked_sub(TILE.0), Some(y)), !is_swept(Some(x), y.checked_sub(TILE.1))];
        around.take(frame, (tile.origin, is_first), views.reach);
        with_channels!(size.channels, C => {
            Gather::<C> { padded: &frame.padded, around, views, of_shifts: asked.shifts(), pairs }.add(frame.simd);
        });
    }
}

/// How much of the tile at a place is swept: nothing beyond the frame.
fn swept(job: &Job, x: usize, y: usize) -> f32 {
    let Size { width, height, .. } = job.size;
    let number = y / TILE.1 * width.div_ceil(TILE.0) + x / TILE.0;
    if x < width && y < height { job.frame.tiles[number].swept_share() } else { 0.0 }
}

fn scaled(from: &TileColor, by: f32, into: &mut TileColor) {
    for (from, into) in from.planes.iter().zip(&mut into.planes) {
        into.iter_mut().zip(from).for_each(|(into, from)| *into = by * from);
    }
}
