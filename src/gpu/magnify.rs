//! Carries out [`plan::magnify`](crate::plan::magnify).

use super::bands::Band;
use super::commands::Bound::{Read, Write};
use super::commands::{Commands, groups, pixels};
use super::shader::{Shader, shader, shared};
use crate::error::Result;
use crate::optics::Imaging;
use crate::picture::{ChannelGroup, Size};
use crate::plan::magnify::{self as plan, Interpolation, sources};
use std::ops::Range;

pub const MAGNIFY: Shader = shader!("magnify", [], [Params, Source]);

shared! {
    struct Params {
        size: [u32; 2],
    }
}

shared! {
    struct Source {
        places: [u32; 4],
        weights: [f32; 4],
    }
}

impl Source {
    fn new(source: &plan::Source, first: usize) -> Source {
        Source { places: source.places.map(|place| (place - first) as u32), weights: source.weights }
    }
}

/// The source pixels of all channels.
pub struct Sources {
    columns: Vec<Vec<plan::Source>>,
    rows: Vec<Vec<plan::Source>>,
}

impl Sources {
    /// The source pixels for a lens, if it changes the size of the picture: of all channels that may be rendered together.
    pub fn new(imaging: &Imaging, size: Size, interpolation: Interpolation) -> Option<Sources> {
        let along = |n: usize, centre: f64| {
            (0..ChannelGroup::MOST)
                .map(|c| sources(n, centre, imaging.magnification_of(c), interpolation))
                .collect()
        };
        let [x, y] = imaging.surface.centre;
        imaging.is_magnified().then(|| Sources { columns: along(size.width, x), rows: along(size.height, y) })
    }

    /// The rows of the source from which some rows are made.
    pub fn of_rows(&self, rows: Range<usize>) -> Range<usize> {
        let places = self.rows.iter().flat_map(|of_channel| &of_channel[rows.clone()]).flat_map(|s| s.places);
        let (first, last) = places.fold((usize::MAX, 0), |(lo, hi), place| (lo.min(place), hi.max(place)));
        first..last + 1
    }
}

/// Magnifies a band of the picture from the rows that were rendered for it.
pub fn render(
    commands: &mut Commands,
    rendered: &wgpu::Buffer,
    size: Size,
    band: &Band,
    sources: &Sources,
) -> Result<wgpu::Buffer> {
    let output = Size { height: band.rows.len(), ..size };
    let table: Vec<Source> = (0..size.channels)
        .flat_map(|c| {
            let columns = sources.columns[c].iter().map(|source| Source::new(source, 0));
            let rows = sources.rows[c][band.rows.clone()].iter();
            columns.chain(rows.map(|source| Source::new(source, band.read.start)))
        })
        .collect();
    let table = commands.gpu.upload("the table of sources", &table)?;
    let picture = commands.output(output)?;
    let params = Params { size: pixels(output) };
    let buffers = [Read(rendered), Read(&table), Write(&picture)];
    commands.pass(&MAGNIFY, size.channels, &params, &buffers, groups(output.width, output.height))?;
    Ok(picture)
}
