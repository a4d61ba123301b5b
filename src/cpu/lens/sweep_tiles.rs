//! The sweep of a tile: the pixels that are swept together, one after another.

use super::culling::PART;
use super::dimming::Weights;
use super::lanes::Lanes;
use super::padded::Padded;
use super::padded_layer::PaddedLayer;
use super::planes::Planes;
use super::segments::{MOST, ROWS, Segment, Segments};
use super::sweep_rows::{Hits, Swept, add_hits, sweep_rows};
use super::tile_color::TileColor;
use crate::picture::ChannelGroup;
use crate::plan::lens::Missed;
use crate::rows::with_channels;
use crate::scene::grid::TILE;

/// Pixels that were swept together.
pub struct Pixels {
    /// The number of samples by which the sums of each are divided.
    met: [[f32; MOST]; ROWS],
    /// The first of them in the tile, and how many there are in a row.
    pub at: (usize, usize),
    pub cells: usize,
}

impl Pixels {
    #[inline(always)]
    fn new(
        segments: &Segments,
        missed: &[[f32; MOST]; ROWS],
        missed_rule: Missed,
        at: (usize, usize),
        cells: usize,
    ) -> Pixels {
        let mut met = [[0.0; MOST]; ROWS];
        for row in 0..ROWS {
            for lane in 0..cells {
                let samples = segments.seen_from(at.0 + lane, at.1 + row) as f32;
                met[row][lane] = match missed_rule {
                    Missed::Nothing => samples,
                    Missed::Unknown => samples - missed[row][lane],
                };
            }
        }
        Pixels { met, at, cells }
    }

    /// The number of samples by which the sum of a pixel is divided.
    #[inline(always)]
    pub fn met(&self, row: usize, lane: usize) -> f32 {
        self.met[row][lane]
    }

    /// Divides sums by the number of samples. If no sample met a cell, a pixel keeps the colour of its `own` cell.
    #[inline(always)]
    fn divide<const C: usize>(
        &self,
        sums: &[[[f32; MOST]; C]; ROWS],
        own: [&[f32]; C],
        stride: usize,
        out: &mut TileColor,
    ) {
        for row in 0..ROWS {
            for lane in 0..self.cells {
                let met = self.met[row][lane];
                let at = (self.at.1 + row) * TILE.0 + self.at.0 + lane;
                for c in 0..C {
                    out.planes[c][at] =
                        if met > 0.0 { sums[row][c][lane] / met } else { own[c][row * stride + lane] };
                }
            }
        }
    }
}

/// Sweeps a whole tile.
///
/// # Safety
///
/// As for [`sweep_rows`].
#[inline(always)]
pub unsafe fn sweep_tile<L: Lanes, const C: usize>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed_rule: Missed,
    out: &mut TileColor,
) {
    let layers: Vec<Planes<C>> = padded.layers.iter().map(Planes::of).collect();
    let stride = padded.padding.stride;
    visit_pixels::<L>(
        padded,
        segments,
        origin,
        #[inline(always)]
        |segments, (x, y), base| {
            let mut swept = Swept::<C>::NOTHING;
            // SAFETY: per the function's contract.
            unsafe {
                sweep_rows::<L, C>(&layers, stride, segments, (x, y), base, &mut swept, |_, _, _| {});
            }
            let own = std::array::from_fn(|c| &padded.layers[padded.front].color[c][base..]);
            let pixels = Pixels::new(segments, &swept.missed, missed_rule, (x, y), L::CELLS);
            pixels.divide(&swept.sums, own, stride, out);
        },
    );
}

/// Sweeps a whole tile for all groups of channels: what is met is found once, and then added up in every group.
///
/// # Safety
///
/// As for [`sweep_rows`].
#[inline(always)]
pub unsafe fn sweep_tile_of_groups<L: Lanes>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed_rule: Missed,
    out: &mut [TileColor],
) {
    let stride = padded.padding.stride;
    let firsts = out.iter().scan(0, |end, group| {
        let first = *end;
        *end += group.planes.len();
        Some(first)
    });
    let firsts: Vec<usize> = firsts.collect();
    // Channels that a group does not have are not read.
    let planes = |first: usize, n: usize| {
        let of =
            move |layer: &PaddedLayer| std::array::from_fn(|c| layer.color[first + c.min(n - 1)].as_ptr());
        padded.layers.iter().map(of).collect()
    };
    let colors = firsts.iter().zip(&*out).map(|(first, out)| planes(*first, out.planes.len()));
    let colors: Vec<Vec<[*const f32; ChannelGroup::MOST]>> = colors.collect();
    // SAFETY: per the function's contract.
    unsafe {
        visit_hits::<L>(
            padded,
            segments,
            origin,
            missed_rule,
            #[inline(always)]
            |pixels, segments, hits| {
                let base = padded.padding.index(origin.0 + pixels.at.0, origin.1 + pixels.at.1);
                for ((out, color), first) in out.iter_mut().zip(&colors).zip(&firsts) {
                    with_channels!(out.planes.len(), C => {
                        let mut sums = [[[0.0; MOST]; C]; ROWS];
                        add_hits::<L, C>(color, stride, (&segments.met, hits), base, &mut sums);
                        let own = std::array::from_fn(|c| &padded.layers[padded.front].color[first + c][base..]);
                        pixels.divide(&sums, own, stride, out);
                    });
                }
            },
        );
    }
}

/// Finds what a whole tile meets, and visits its pixels, as many as are swept together, with the segments that all of them
/// have met and with what some of them have.
///
/// # Safety
///
/// As for [`sweep_rows`].
#[inline(always)]
pub unsafe fn visit_hits<L: Lanes>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    missed_rule: Missed,
    mut visit: impl FnMut(&Pixels, &Segments, &Hits),
) {
    let layers: Vec<Planes<0>> = padded.layers.iter().map(Planes::of).collect();
    let stride = padded.padding.stride;
    let mut hits = Hits::default();
    visit_pixels::<L>(
        padded,
        segments,
        origin,
        #[inline(always)]
        |segments, (x, y), base| {
            let mut swept = Swept::<0>::NOTHING;
            hits.clear();
            // SAFETY: per the function's contract.
            unsafe {
                let hit = |segment: &Segment, cells: [L::Mask; ROWS], weights: Option<&Weights>| {
                    hits.push(segment, cells.map(|cells| L::bits(cells)), weights);
                };
                sweep_rows::<L, 0>(&layers, stride, segments, (x, y), base, &mut swept, hit);
            }
            let pixels = Pixels::new(segments, &swept.missed, missed_rule, (x, y), L::CELLS);
            visit(&pixels, segments, &hits);
        },
    );
}

/// Culls the segments for each part of a tile, and visits its pixels, as many as are swept together: the place of the first
/// of them in the tile, and its cell in the padded frame.
#[inline(always)]
fn visit_pixels<L: Lanes>(
    padded: &Padded,
    segments: &mut Segments,
    origin: (usize, usize),
    mut visit: impl FnMut(&Segments, (usize, usize), usize),
) {
    for (x, part_y) in segments.parts.origins() {
        let place = (origin.0 + padded.padding.pad[0] + x, origin.1 + padded.padding.pad[1] + part_y);
        segments.cull(&padded.patches, place, (x, part_y));
        let columns = || (x..x + PART.0).step_by(L::CELLS);
        let rows = (part_y..part_y + PART.1).step_by(ROWS);
        for (x, y) in rows.flat_map(|y| columns().map(move |x| (x, y))) {
            visit(segments, (x, y), padded.padding.index(origin.0 + x, origin.1 + y));
        }
    }
}
