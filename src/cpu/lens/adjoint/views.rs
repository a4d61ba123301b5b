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
use crate::plan::lens::lens_samples::LensSample;
use crate::scene::grid::TILE;

/// From the shares of one row to those of the next. Behind the last column and row are those of the pixels beyond the tile.
pub const SHARES: usize = TILE.0 + FLOATS;
/// Where the share of a pixel is.
#[inline(always)]
pub fn of_share(pixel: usize) -> usize {
    pixel / TILE.0 * SHARES + pixel % TILE.0
}

/// Groups of pixels in a row of a tile, and all of them.
pub const ACROSS: usize = TILE.0 / FLOATS;
pub const GROUPS: usize = ACROSS * TILE.1;
/// Parts of a tile beside each other, and all of them.
const PARTS_ACROSS: usize = TILE.0 / PART.0;
const PARTS: usize = PARTS_ACROSS * (TILE.1 / PART.1);
const _: () = assert!(PART.0.is_multiple_of(FLOATS));

/// A lens point as seen from behind the focus, and from in front of it.
pub type LensPoint = [[f32; 2]; 2];

/// What every sample of a tile sees.
pub struct Views {
    /// The samples by their height, so that what one after the other sees lies in the same rows; and the rank of each.
    pub lens: Vec<LensPoint>,
    ranks: Vec<usize>,
    /// For each part of the tile and each rank: what all of its pixels meet, if it is the same.
    of_part: Vec<Met>,
    /// For each group of pixels and each rank: what each of the pixels meets, where that is not the same for a whole part.
    codes: Buffer<u32>,
    /// What each pixel gives to each of its samples, in each channel; and the channels of each pixel together.
    shares: PlaneSet,
    of_pixels: Vec<[f32; 4]>,
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

/// What some pixels beside each other see, by rank.
#[derive(Clone, Copy)]
pub struct GroupViews<'a> {
    of_part: &'a [Met],
    codes: &'a [u32],
}

impl GroupViews<'_> {
    /// The codes of what the pixels meet through the lens point of a rank.
    #[inline(always)]
    pub fn at(&self, rank: usize) -> [u32; FLOATS] {
        match self.of_part[rank] {
            Met::NOTHING => {
                *self.codes[rank * FLOATS..].first_chunk().expect("there are codes for each rank")
            }
            met => [met.code(); FLOATS],
        }
    }

    /// What all pixels of their part meet through the lens point of a rank, if it is the same.
    #[inline(always)]
    pub fn whole(&self, rank: usize) -> Option<Met> {
        let met = self.of_part[rank];
        (met != Met::NOTHING).then_some(met)
    }

    /// The code of what the first of them meets.
    #[inline(always)]
    pub fn first(&self, rank: usize) -> u32 {
        match self.of_part[rank] {
            Met::NOTHING => self.codes[rank * FLOATS],
            met => met.code(),
        }
    }
}

impl Views {
    pub fn new(channels: usize) -> Views {
        let shares = PlaneSet::zeros(channels, SHARES * (TILE.1 + 1));
        Views {
            lens: Vec::new(),
            ranks: Vec::new(),
            of_part: Vec::new(),
            codes: Buffer::unset(0),
            shares,
            of_pixels: vec![[0.0; 4]; SHARES * (TILE.1 + 1)],
            blind: Vec::new(),
            reach: Reach::default(),
        }
    }

    /// Looks at the tile at `origin` through samples, of which each pixel gives `cotangent`. The pixels beyond its last column
    /// and row are taken to give to as many samples as the tile has.
    ///
    /// # Safety
    ///
    /// The segments of these samples were traced in the frame's padded arrays, from the tile at `origin`.
    pub unsafe fn look(
        &mut self,
        frame: &Frame,
        segments: &mut Segments,
        (origin, samples): ((usize, usize), &[LensSample]),
        cotangent: &TileColor,
        beyond: &Beyond,
    ) {
        let count = segments.samples();
        self.rank(&samples[..count]);
        self.of_part.clear();
        self.of_part.resize(PARTS * count, Met::NOTHING);
        let len = GROUPS * self.stride();
        if self.codes.len() < len {
            self.codes = Buffer::full(len, Met::NOTHING.code());
        } else if !segments.seen.is_empty() {
            // A part of a tile leaves out the samples that none of its pixels sees.
            self.codes[..len].fill(Met::NOTHING.code());
        }
        self.blind.clear();
        // Pixels that meet nothing see their own cells of the first layer.
        self.reach = Reach { cells: 0, layers: 1 };
        for (c, beyond) in beyond.channels.iter().enumerate() {
            let shares = self.shares.plane_mut(c);
            let share = 1.0 / count as f32;
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
        for c in 0..cotangent.planes.len() {
            let given = self.of_pixels.iter_mut().zip(self.shares.plane(c));
            given.for_each(|(given, share)| given[c] = *share);
        }
    }

    /// Ranks samples by their height.
    fn rank(&mut self, samples: &[LensSample]) {
        let mut order: Vec<usize> = (0..samples.len()).collect();
        order.sort_by(|a, b| samples[*a].behind[1].total_cmp(&samples[*b].behind[1]));
        self.ranks.resize(samples.len(), 0);
        order.iter().enumerate().for_each(|(rank, number)| self.ranks[*number] = rank);
        let point =
            |sample: &LensSample| [sample.behind, sample.in_front].map(|point| point.map(|v| v as f32));
        self.lens.clear();
        self.lens.extend(order.iter().map(|number| point(&samples[*number])));
    }

    /// From the codes of one group of pixels to those of the next. A power of two would put the same sample of all groups into
    /// the same few lines of the cache.
    fn stride(&self) -> usize {
        (self.ranks.len() + 1) * FLOATS
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
        let part = y / PART.1 * PARTS_ACROSS + x / PART.0;
        for segment in &segments.met {
            let met = self.reaching(Met::new(segment.layer, segment.offset, stride));
            let rank = self.ranks[segments.sample_of(segment.number)];
            self.of_part[part * self.ranks.len() + rank] = met;
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
            let of_rank = self.ranks[sample as usize] * FLOATS;
            for (row, mets) in mets.iter().enumerate() {
                for (i, mets) in mets[..count].chunks(FLOATS).enumerate() {
                    let x = x + i * FLOATS;
                    let group = (y + row) * ACROSS + x / FLOATS;
                    let at = group * self.stride() + of_rank + x % FLOATS;
                    self.codes[at..at + mets.len()].copy_from_slice(mets);
                }
            }
        }
    }

    /// What each pixel gives to each of its samples, and those that have met nothing.
    pub fn given(&self) -> (&PlaneSet, &[Blind]) {
        (&self.shares, &self.blind)
    }

    /// What a pixel gives to each of its samples.
    #[inline(always)]
    pub fn of_pixel(&self, share: usize) -> [f32; 4] {
        self.of_pixels[share]
    }

    /// What the pixels of a group see.
    pub fn of_group(&self, group: usize) -> GroupViews<'_> {
        let samples = self.ranks.len();
        let (x, y) = (group % ACROSS * FLOATS, group / ACROSS);
        let part = y / PART.1 * PARTS_ACROSS + x / PART.0;
        GroupViews {
            of_part: &self.of_part[part * samples..][..samples],
            codes: &self.codes[group * self.stride()..][..samples * FLOATS],
        }
    }
}
