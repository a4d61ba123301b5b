//! What the lens samples of a tile see: the cell that the ray of each pixel meets.

use super::met::Met;
use super::plane_set::PlaneSet;
use super::waves::Beyond;
use crate::cpu::lens::culling::PART;
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::lanes::FLOATS;
use crate::cpu::lens::segments::{ROWS, Segments};
use crate::cpu::lens::sweep::visit_tile;
use crate::cpu::lens::sweep_rows::Hit;
use crate::cpu::lens::sweep_tiles::Pixels;
use crate::cpu::lens::tile_color::TileColor;
use crate::memory::Buffer;
use crate::scene::grid::TILE;

/// Pixels of a tile.
pub const PIXELS: usize = TILE.0 * TILE.1;
/// From the pixels of one sample to those of the next. A power of two would put the same pixel of all samples into the same
/// few lines of the cache.
const STEP: usize = PIXELS + 16;
/// From the shares of one row to those of the next. Behind the last column and row are those of the pixels beyond the tile.
pub const SHARES: usize = TILE.0 + FLOATS;
/// Parts of a tile beside each other, and all of them.
const ACROSS: usize = TILE.0 / PART.0;
const PARTS: usize = ACROSS * (TILE.1 / PART.1);

/// What every sample of a tile sees.
pub struct Views {
    /// For each sample and part of the tile: what all of its pixels meet, if it is the same.
    of_part: Vec<[Met; PARTS]>,
    /// What each pixel of each sample meets, where it is not the same for a whole part.
    codes: Buffer<u32>,
    /// What each pixel gives to each of its samples, in each channel.
    shares: PlaneSet,
    blind: Vec<Blind>,
    pub reach: Reach,
}

/// How far what is met is away.
#[derive(Debug, Clone, Copy, Default)]
pub struct Reach {
    /// The most columns or rows.
    pub cells: usize,
    /// A bit for each layer that is met.
    pub layers: u64,
}

/// A pixel whose samples have all met nothing, and what it gives.
pub struct Blind {
    pub pixel: usize,
    pub given: [f32; 4],
}

/// What one sample of a tile sees.
pub enum View<'a> {
    /// All pixels meet the same.
    Even(Met),
    /// The codes of what each pixel meets.
    Uneven(&'a [u32]),
}

impl Views {
    pub fn new(channels: usize) -> Views {
        let shares = PlaneSet::zeros(channels, SHARES * (TILE.1 + 1));
        let reach = Reach::default();
        Views { of_part: Vec::new(), codes: Buffer::unset(0), shares, blind: Vec::new(), reach }
    }

    /// Looks at the tile at `origin`, of which each pixel gives `cotangent`. The pixels beyond its last column and row are
    /// taken to give to as many samples as the tile has.
    ///
    /// # Safety
    ///
    /// The segments were traced in the frame's padded arrays, from the tile at `origin`.
    pub unsafe fn look(
        &mut self,
        frame: &Frame,
        segments: &mut Segments,
        origin: (usize, usize),
        cotangent: &TileColor,
        beyond: &Beyond,
    ) {
        let samples = segments.samples();
        self.of_part.clear();
        self.of_part.resize(samples, [Met::NOTHING; PARTS]);
        if self.codes.len() < samples * STEP {
            self.codes = Buffer::full(samples * STEP, Met::NOTHING.code());
        } else if !segments.seen.is_empty() {
            // A part of a tile leaves out the samples that none of its pixels sees.
            self.codes[..samples * STEP].fill(Met::NOTHING.code());
        }
        self.blind.clear();
        // Pixels that meet nothing see their own cells of the first layer.
        self.reach = Reach { cells: 0, layers: 1 };
        for (c, beyond) in beyond.channels.iter().enumerate() {
            let shares = self.shares.plane_mut(c);
            let share = 1.0 / samples as f32;
            (0..TILE.1).for_each(|y| shares[y * SHARES + TILE.0] = share * beyond.column[y]);
            (0..TILE.0).for_each(|x| shares[TILE.1 * SHARES + x] = share * beyond.row[x]);
        }
        // SAFETY: per the function's contract.
        unsafe {
            visit_tile(
                frame.simd,
                &frame.padded,
                segments,
                origin,
                frame.missed,
                #[inline(always)]
                |pixels, segments, hits| {
                    self.share(cotangent, pixels);
                    self.note(frame.padded.padding.stride, pixels, segments, &hits.all);
                },
            );
        }
    }

    /// Divides what some pixels give among the samples that have met something.
    #[inline(always)]
    fn share(&mut self, cotangent: &TileColor, pixels: &Pixels) {
        let ((x, y), count) = (pixels.at, pixels.cells);
        for row in 0..ROWS {
            let first = (y + row) * TILE.0 + x;
            for lane in 0..count {
                let met = pixels.met(row, lane);
                let share = if met > 0.0 { 1.0 / met } else { 0.0 };
                for (c, given) in cotangent.planes.iter().enumerate() {
                    self.shares.plane_mut(c)[(y + row) * SHARES + x + lane] = share * given[first + lane];
                }
                if met <= 0.0 {
                    let mut of_pixel = [0.0; 4];
                    for (v, given) in of_pixel.iter_mut().zip(&cotangent.planes) {
                        *v = given[first + lane];
                    }
                    self.blind.push(Blind { pixel: first + lane, given: of_pixel });
                }
            }
        }
    }

    /// Notes how far away a cell is.
    #[inline(always)]
    fn reaching(&mut self, met: Met) -> Met {
        let [across, down] = met.away();
        let Reach { cells, layers } = &mut self.reach;
        *cells = (*cells).max(across.unsigned_abs() as usize).max(down.unsigned_abs() as usize);
        *layers |= 1 << met.layer();
        met
    }

    /// Notes what the samples of some pixels see.
    #[inline(always)]
    fn note(&mut self, stride: usize, pixels: &Pixels, segments: &Segments, hits: &[Hit]) {
        let ((x, y), count) = (pixels.at, pixels.cells);
        let part = y / PART.1 * ACROSS + x / PART.0;
        for segment in &segments.met {
            let met = self.reaching(Met::new(segment.layer, segment.offset, stride));
            self.of_part[segments.sample_of(segment.number)][part] = met;
        }
        let mut hits = hits.iter().peekable();
        for &(sample, _) in &segments.unknown {
            let mut mets = [[Met::NOTHING.code(); PART.0]; ROWS];
            let end = segments.end(sample as usize);
            while let Some(hit) = hits.next_if(|hit| hit.number < end) {
                let met = self.reaching(Met::new(hit.layer, hit.offset, stride)).code();
                for (mets, cells) in mets.iter_mut().zip(hit.cells) {
                    for lane in 0..PART.0 {
                        // All ones where the bit is set. There are no branches, since nothing predicts them.
                        let is_hit = 0u32.wrapping_sub(cells >> lane & 1);
                        mets[lane] = mets[lane] & !is_hit | met & is_hit;
                    }
                }
            }
            let view = &mut self.codes[sample as usize * STEP..][..PIXELS];
            for row in 0..ROWS {
                view[(y + row) * TILE.0 + x..][..count].copy_from_slice(&mets[row][..count]);
            }
        }
    }

    /// What each pixel gives to each of its samples, those that have met nothing, and what each sample sees.
    pub fn seen(&mut self) -> (&PlaneSet, &[Blind], Vec<View<'_>>) {
        let Views { of_part, codes, shares, blind, .. } = self;
        let views = of_part.iter().zip(codes.chunks_exact_mut(STEP));
        (shares, blind, views.map(|(of_part, codes)| View::new(of_part, codes)).collect())
    }
}

impl View<'_> {
    /// What one sample sees, of what it sees in whole parts and elsewhere.
    fn new<'a>(of_part: &[Met; PARTS], codes: &'a mut [u32]) -> View<'a> {
        if of_part[0] != Met::NOTHING && of_part.iter().all(|met| *met == of_part[0]) {
            return View::Even(of_part[0]);
        }
        for (part, met) in of_part.iter().enumerate().filter(|(_, met)| **met != Met::NOTHING) {
            let (x, y) = (part % ACROSS * PART.0, part / ACROSS * PART.1);
            (y..y + PART.1).for_each(|y| codes[y * TILE.0 + x..][..PART.0].fill(met.code()));
        }
        View::Uneven(codes)
    }
}
