//! The discs of a frame as words: see `shaders/lens/kernels.wgsl`.

use crate::aperture::{Aperture, Kernel};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::plan::lens::disc::{APART, Surface};
use crate::plan::lens::highlights::Highlights;
use crate::plan::lens::tiles::Tile;
use crate::plan::lens::{Plan, kernels};
use crate::scene::layered::LayeredScene;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Number of words of a head, of a row and of a single pixel.
const HEAD: usize = 4;
const ROW: usize = 4;
const PARTIAL: usize = 2;

/// The disc of one tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Disc {
    /// All pixels have this kernel.
    Same(usize),
    /// The kernel of each pixel depends on its depth.
    PerPixel,
}

/// All kernels of a frame.
pub struct Kernels {
    pub words: Vec<u32>,
    /// The largest number of rows of a kernel.
    pub most_rows: usize,
    /// The largest number of single pixels of a row.
    pub widest_row: usize,
    /// The disc of kernel 0, in steps of [`APART`]; the following kernels are the discs of the next steps.
    pub first_step: i32,
    /// The tiles that are rendered as discs: their first pixels, their discs, and the share of these in the result.
    pub tiles: Vec<((usize, usize), Disc, f32)>,
    /// The two kernels of each highlight.
    pub of_highlights: Vec<[usize; 2]>,
}

impl Kernels {
    pub fn new(
        scene: &LayeredScene,
        plan: &Plan,
        highlights: &Highlights,
        aperture: &Aperture,
        cancel: &Cancel,
    ) -> Result<Kernels> {
        let s = &scene.layers[scene.front].s;
        // A tile of one depth has exactly its own disc. Other tiles share discs, quantised to radius steps.
        let discs = plan.tiles.par_iter().filter(|tile| tile.disc_share() > 0.0);
        let of = |tile: &Tile| {
            let surface = Surface::new(s, scene.size, plan.s_focus, tile.origin);
            (tile.origin, surface, tile.disc_share())
        };
        let discs: Vec<_> = discs.map(of).collect();
        let surfaces = || discs.iter().map(|(_, surface, _)| surface);
        let gathered: BTreeSet<i32> = surfaces().flat_map(Surface::keys).collect();

        let steps = gathered.iter().copied().chain(highlights.keys()).collect();
        let level = surfaces().filter_map(Surface::level);
        let kernels = kernels::Kernels::new(aperture, plan.s_focus, steps, level, cancel)?;
        let nothing = Kernel { reach: 0, run_weight: 0.0, rows: Vec::new() };
        let first_step = gathered.first().map_or(0, |key| key / APART);
        let last_step = gathered.last().map_or(-1, |key| key / APART);
        let mut all: Vec<&Kernel> = (first_step..=last_step)
            .map(|step| if gathered.contains(&(step * APART)) { kernels.get(step * APART) } else { &nothing })
            .collect();
        let of_key: BTreeMap<i32, usize> = kernels.of_steps().map(|(key, _)| key).zip(all.len()..).collect();
        all.extend(kernels.of_steps().map(|(_, kernel)| kernel));

        let of_shift: BTreeMap<u32, usize> =
            kernels.of_shifts().map(|(s, _)| s.to_bits()).zip(all.len()..).collect();
        all.extend(kernels.of_shifts().map(|(_, kernel)| kernel));

        let disc = |surface: &Surface| match surface {
            Surface::Level(s) => Disc::Same(of_shift[&s.to_bits()]),
            Surface::Tilted(_) => Disc::PerPixel,
        };
        Ok(Kernels {
            words: words(&all),
            most_rows: all.iter().map(|kernel| kernel.rows.len()).max().unwrap_or(0),
            widest_row: all
                .iter()
                .flat_map(|kernel| &kernel.rows)
                .map(|row| row.partial.len())
                .max()
                .unwrap_or(0),
            first_step,
            tiles: discs.iter().map(|(origin, surface, share)| (*origin, disc(surface), *share)).collect(),
            of_highlights: highlights
                .all
                .iter()
                .map(|h| h.steps.map(|step| of_key[&(step * APART)]))
                .collect(),
        })
    }
}

/// The words of all kernels: heads, then rows, then single pixels. Each points to the index of its own words.
fn words(kernels: &[&Kernel]) -> Vec<u32> {
    let rows = kernels.iter().map(|kernel| kernel.rows.len()).sum::<usize>();
    let (first_row, first_partial) = (HEAD * kernels.len(), HEAD * kernels.len() + ROW * rows);
    let (mut heads, mut rows, mut partials) = (Vec::new(), Vec::new(), Vec::new());
    for kernel in kernels {
        let first_dy = kernel.rows.first().map_or(0, |row| row.dy);
        heads.extend([
            (first_row + rows.len()) as u32,
            kernel.rows.len() as u32,
            first_dy.cast_unsigned(),
            kernel.run_weight.to_bits(),
        ]);
        for row in &kernel.rows {
            rows.extend([
                row.run.0.cast_unsigned(),
                row.run.1.cast_unsigned(),
                (first_partial + partials.len()) as u32,
                row.partial.len() as u32,
            ]);
            partials
                .extend(row.partial.iter().flat_map(|&(dx, weight)| [dx.cast_unsigned(), weight.to_bits()]));
        }
    }
    debug_assert!(partials.len() % PARTIAL == 0);
    [heads, rows, partials].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_point_to_the_rows_and_pixels_of_each_kernel() {
        let kernels = [2.3, 0.0, 5.1].map(|t| Aperture::DISC.kernel(t));
        let words = words(&kernels.each_ref());
        for (i, kernel) in kernels.iter().enumerate() {
            let head = &words[HEAD * i..][..HEAD];
            assert_eq!(head[1] as usize, kernel.rows.len());
            assert_eq!(head[3], kernel.run_weight.to_bits());
            for (j, row) in kernel.rows.iter().enumerate() {
                // The rows are consecutive, without a gap.
                assert_eq!(head[2].cast_signed() + j as i32, row.dy);
                let own = &words[head[0] as usize + ROW * j..][..ROW];
                assert_eq!((own[0].cast_signed(), own[1].cast_signed()), row.run);
                let partial = words[own[2] as usize..][..PARTIAL * own[3] as usize].chunks(PARTIAL);
                let partial: Vec<_> =
                    partial.map(|pair| (pair[0].cast_signed(), f32::from_bits(pair[1]))).collect();
                assert_eq!(partial, row.partial);
            }
        }
    }
}
