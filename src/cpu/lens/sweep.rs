//! The sweep: for every view, the nearest cell that each pixel's ray meets.
//!
//! While the shift of a view stays within one pixel, all rays of a tile meet the cells at one and the same
//! offset. So a ray's way into the scene is a list of segments, near to far, each "look at the cells at this
//! offset, take those whose depth lies in this interval": contiguous loads, no z-buffer, no gather.

use super::barrel::{Clip, Seen};
use super::blocks::{BLOCK, DepthBits, any_bin};
use super::lanes::{HalfPlaneRow, Lanes, Portable, Ray};
use super::line::Line;
use super::pack::{Packed, PackedSheet, PartialPlanes, TILE};
use super::patches::{Need, PART, Patches};
use crate::cpu::simd::Simd;
use crate::views::View;

/// Rows of a tile swept together.
const ROWS: usize = 2;
/// The most cells of a row that a face handles at once.
const MOST: usize = PART.0;

/// A stretch of depth over which a view's rays stay at one offset.
#[derive(Debug, Clone, Copy, Default)]
struct Segment {
    /// From an output pixel to the cell, in padded cells.
    offset: i32,
    /// Codes `from .. to`.
    from: u16,
    to: u16,
    sheet: u32,
    /// Its own number.
    number: u32,
}

/// A segment of a ray.
#[derive(Debug, Clone, Copy)]
struct Traced {
    segment: Segment,
    /// What makes it worth while to look at it.
    need: Need,
    ray: Ray,
}

/// The segments of all views over one tile.
#[derive(Default)]
pub struct Segments {
    traced: Vec<Traced>,
    /// End of each view's segments.
    ends: Vec<u32>,
    /// For each view, the pixels of each row of the tile that see it; empty where all see all.
    seen: Vec<Seen>,
    /// Where every ray of the part at hand meets the nearest cell, for the views of which that is known.
    met: Vec<Segment>,
    /// What the part at hand looks at to find that out for the others.
    looks: Vec<Segment>,
    /// Their numbers, and the ends of their looks.
    unknown: Vec<(u32, u32)>,
}

/// Runs of set bits, as `first .. end`.
fn runs(occupied: &DepthBits) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for bin in (0..256).filter(|bin| occupied[bin / 64] >> (bin % 64) & 1 != 0) {
        match runs.last_mut() {
            Some(run) if run.1 == bin => run.1 = bin + 1,
            _ => runs.push((bin, bin + 1)),
        }
    }
    runs
}

/// The tile that rays start from, and what they may meet.
pub struct Start<'a> {
    pub packed: &'a Packed,
    pub s_focus: f64,
    pub origin: (usize, usize),
    /// The depths that occur anywhere within reach.
    pub occupied: &'a DepthBits,
    /// What the barrel hides from pixels, if anything.
    pub clip: Option<&'a Clip>,
}

impl Start<'_> {
    /// The depths of each sheet that occur where the tile lies when it is moved by `cell`.
    #[inline(always)]
    fn depths_at(&self, cell: [i32; 2]) -> &[DepthBits] {
        let (pad, blocks) = (self.packed.padding.pad, &self.packed.blocks);
        let block = |origin: usize, cell: i32| (origin + pad).wrapping_add_signed(cell as isize) / BLOCK;
        let b = block(self.origin.1, cell[1]) * blocks.across + block(self.origin.0, cell[0]);
        &self.packed.windows[b * blocks.sheets..][..blocks.sheets]
    }
}

impl Segments {
    /// How many views a pixel of the tile sees.
    fn seen_from(&self, x: usize, y: usize) -> usize {
        if self.seen.is_empty() {
            return self.ends.len();
        }
        self.seen.iter().filter(|rows| rows[y] >> x & 1 != 0).count()
    }

    /// Which of the pixels of `ROWS` rows from `(x, y)` on see view number `view`, if not all see all.
    #[inline(always)]
    fn seen_by(&self, view: usize, (x, y): (usize, usize)) -> [u32; ROWS] {
        std::array::from_fn(|row| (self.seen[view][y + row] >> x) as u32)
    }

    /// Chooses the looks of the part of the tile that begins at `place` of the padded frame.
    fn choose(&mut self, patches: &Patches, place: (usize, usize)) {
        let Segments { traced, ends, met, looks, unknown, seen } = self;
        let entry = patches.entry(place);
        // Room for all, so that to keep one is to count it.
        if looks.len() < traced.len() {
            looks.resize(traced.len(), Segment::default());
        }
        met.clear();
        unknown.clear();
        let (mut start, mut n) = (0, 0);
        for (view, &end) in ends.iter().enumerate() {
            let (first, mut all) = (n, false);
            for Traced { segment, need, .. } in &traced[start..end as usize] {
                let finds = patches.finds(entry, need);
                looks[n] = *segment;
                n += usize::from(finds.any);
                if finds.all {
                    // Whatever lies behind is hidden.
                    all = true;
                    break;
                }
            }
            start = end as usize;
            if all && n == first + 1 && seen.is_empty() {
                met.push(looks[first]);
                n = first;
            } else {
                unknown.push((view as u32, n as u32));
            }
        }
    }

    /// Follows every view through the depths that occur, near to far.
    #[inline(always)]
    pub fn trace(&mut self, start: &Start, views: &[View]) {
        self.traced.clear();
        self.ends.clear();
        self.seen.clear();
        let runs = runs(start.occupied);
        for view in views {
            if let Some(clip) = start.clip {
                let Some(seen) = clip.view(view.pupil, start.origin) else { continue };
                self.seen.push(seen);
            }
            for &(first_bin, end_bin) in runs.iter().rev() {
                let (near, far) = ((end_bin * 256).min(usize::from(u16::MAX)), (first_bin * 256).max(1));
                if view.in_front == view.behind {
                    self.trace_run(start, view.in_front, view.start, near, far);
                } else {
                    // At the focus all rays are where they start, so that one may go on as another.
                    let focus = start.packed.codes.place(start.s_focus).round();
                    let focus = focus.clamp(far as f64, near as f64) as usize;
                    self.trace_run(start, view.in_front, view.start, near, focus);
                    self.trace_run(start, view.behind, view.start, focus, far);
                }
            }
            self.ends.push(self.traced.len() as u32);
        }
    }

    /// The segments of a ray from `ray_start` and through lens point `lens`, between two depths.
    #[inline(always)]
    fn trace_run(&mut self, start: &Start, lens: [f64; 2], ray_start: [f64; 2], near: usize, far: usize) {
        let Start { packed, s_focus, .. } = *start;
        let line = Line::new(&packed.codes, s_focus, lens, ray_start);
        line.follow(
            near,
            far,
            #[inline(always)]
            |cell, from, to| {
                for (sheet, bits) in start.depths_at(cell).iter().enumerate() {
                    if any_bin(bits, from >> 8, (to - 1) >> 8) {
                        let offset = cell[1] * packed.padding.stride as i32 + cell[0];
                        let [bx, by] = line.base_from(cell);
                        let (from, to, sheet_number) = (from as u16, to as u16, sheet as u32);
                        let number = self.traced.len() as u32;
                        self.traced.push(Traced {
                            segment: Segment { offset, from, to, sheet: sheet_number, number },
                            need: packed.patches.need(cell, sheet, from, to),
                            ray: Ray { ax: line.slope[0] as f32, bx, ay: line.slope[1] as f32, by },
                        });
                    }
                }
            },
        );
    }
}

/// Where the colour of rays that met nothing comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Missed {
    /// The other rays of the pixel speak for them.
    Unknown = 0,
    /// They are transparent.
    Nothing = 1,
}

/// A tile's picture: planes of `TILE` pixels.
pub struct TileColor {
    pub planes: Vec<Vec<f32>>,
}

impl TileColor {
    pub fn new(channels: usize) -> TileColor {
        TileColor { planes: vec![vec![0.0; TILE.0 * TILE.1]; channels] }
    }

    /// Row `y` of every channel.
    pub fn row<const C: usize>(&self, y: usize) -> [&[f32; TILE.0]; C] {
        let row = |c: usize| self.planes[c][y * TILE.0..].first_chunk();
        std::array::from_fn(|c| row(c).expect("planes hold whole tiles"))
    }
}

/// A sheet as it is swept.
struct Planes<'a, const C: usize> {
    lo: *const u16,
    hi: *const u16,
    color: [*const f32; C],
    partial: &'a PartialPlanes,
}

impl<const C: usize> Planes<'_, C> {
    fn of(sheet: &PackedSheet) -> Planes<'_, C> {
        let color = std::array::from_fn(|c| sheet.color[c].as_ptr());
        Planes { lo: sheet.lo.as_ptr(), hi: sheet.hi.as_ptr(), color, partial: &sheet.partial }
    }

    /// Which of a row of cells, from `at` on, cover their pixel in part.
    ///
    /// # Safety
    ///
    /// The cells lie inside the padded arrays.
    #[inline(always)]
    unsafe fn partial(&self, at: usize) -> u32 {
        // SAFETY: per the function's contract; there are some bytes more than cells.
        let word = unsafe { self.partial.bits.as_ptr().add(at / 8).cast::<u64>().read_unaligned() };
        (u64::from_le(word) >> (at % 8)) as u32
    }

    /// Those of some cells, in a row from `at` on, that a ray meets where they cover their pixel.
    ///
    /// # Safety
    ///
    /// The instructions of `L` have been detected, and the cells lie inside the padded arrays.
    #[inline(always)]
    unsafe fn covering<L: Lanes>(&self, cells: L::Mask, at: usize, ray: Ray) -> L::Mask {
        let PartialPlanes { normal_x, normal_y, cut, .. } = self.partial;
        // SAFETY: per the function's contract.
        unsafe {
            let doubtful = self.partial(at) & L::bits(cells);
            if doubtful == 0 {
                return cells;
            }
            let row = HalfPlaneRow {
                normal_x: normal_x.as_ptr().add(at),
                normal_y: normal_y.as_ptr().add(at),
                cut: cut.as_ptr().add(at),
                code: self.lo.add(at),
                ray,
            };
            L::without(cells, L::mask(doubtful & !L::covered(&row)))
        }
    }
}

/// Sweeps `CELLS` x `ROWS` pixels whose first is at `at_tile` in the tile and at `base` in the padded frame, adding up
/// every view.
///
/// # Safety
///
/// The instructions of `L` have been detected, looks have been chosen, and every segment's cells lie inside the padded
/// arrays.
#[inline(always)]
unsafe fn sweep_rows<L: Lanes, const C: usize>(
    sheets: &[Planes<C>],
    stride: usize,
    segments: &Segments,
    at_tile: (usize, usize),
    base: usize,
    sums: &mut [[[f32; MOST]; C]; ROWS],
    missed: &mut [[u16; MOST]; ROWS],
) {
    // SAFETY: per the function's contract.
    unsafe {
        let mut sum = [[L::zero(); C]; ROWS];
        for met in &segments.met {
            let sheet = sheets.get_unchecked(met.sheet as usize);
            let first = base.wrapping_add_signed(met.offset as isize);
            for row in 0..ROWS {
                for c in 0..C {
                    L::add_all(&mut sum[row][c], sheet.color[c].add(first + row * stride));
                }
            }
        }
        let everywhere = L::mask(u32::MAX);
        let mut start = 0;
        'views: for &(view, end) in &segments.unknown {
            let looks = segments.looks.get_unchecked(start..end as usize);
            start = end as usize;
            let mut waiting = [everywhere; ROWS];
            if !segments.seen.is_empty() {
                let seen = segments.seen_by(view as usize, at_tile);
                waiting = [L::mask(seen[0]), L::mask(seen[1])];
            }
            for look in looks {
                let sheet = sheets.get_unchecked(look.sheet as usize);
                let first = base.wrapping_add_signed(look.offset as isize);
                let mut hits = waiting;
                for row in 0..ROWS {
                    let at = first + row * stride;
                    hits[row] = L::hits(waiting[row], sheet.lo.add(at), sheet.hi.add(at), look.from, look.to);
                }
                let any = L::bits(L::union(hits[0], hits[1]));
                if any == 0 {
                    continue;
                }
                if (sheet.partial(first) | sheet.partial(first + stride)) & any != 0 {
                    let ray = segments.traced.get_unchecked(look.number as usize).ray;
                    for row in 0..ROWS {
                        hits[row] = sheet.covering::<L>(hits[row], first + row * stride, ray);
                    }
                }
                for row in 0..ROWS {
                    for c in 0..C {
                        let color = sheet.color[c].add(first + row * stride);
                        L::add(&mut sum[row][c], color, hits[row]);
                    }
                    waiting[row] = L::without(waiting[row], hits[row]);
                }
                if L::is_none(L::union(waiting[0], waiting[1])) {
                    continue 'views;
                }
            }
            for row in 0..ROWS {
                let mut left = L::bits(waiting[row]);
                while left != 0 {
                    missed[row][left.trailing_zeros() as usize] += 1;
                    left &= left - 1;
                }
            }
        }
        for row in 0..ROWS {
            for c in 0..C {
                L::store(sum[row][c], sums[row][c].as_mut_ptr());
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
unsafe fn sweep_tile<L: Lanes, const C: usize>(
    packed: &Packed,
    segments: &mut Segments,
    origin: (usize, usize),
    missed_rule: Missed,
    out: &mut TileColor,
) {
    let sheets: Vec<Planes<C>> = packed.sheets.iter().map(Planes::of).collect();
    let stride = packed.padding.stride;
    for (x, part_y) in parts() {
        let place = (origin.0 + packed.padding.pad + x, origin.1 + packed.padding.pad + part_y);
        segments.choose(&packed.patches, place);
        let columns = || (x..x + PART.0).step_by(L::CELLS);
        let rows = (part_y..part_y + PART.1).step_by(ROWS);
        for (x, y) in rows.flat_map(|y| columns().map(move |x| (x, y))) {
            let base = packed.padding.index(origin.0 + x, origin.1 + y);
            let mut sums = [[[0.0; MOST]; C]; ROWS];
            let mut missed = [[0u16; MOST]; ROWS];
            // SAFETY: per the function's contract.
            unsafe { sweep_rows::<L, C>(&sheets, stride, segments, (x, y), base, &mut sums, &mut missed) };
            for row in 0..ROWS {
                for lane in 0..L::CELLS {
                    let views = segments.seen_from(x + lane, y + row) as f32;
                    let met = match missed_rule {
                        Missed::Nothing => views,
                        Missed::Unknown => views - f32::from(missed[row][lane]),
                    };
                    let at = (y + row) * TILE.0 + x + lane;
                    for c in 0..C {
                        // Where nothing at all was met, the pixel keeps what it saw itself.
                        out.planes[c][at] = if met > 0.0 {
                            sums[row][c][lane] / met
                        } else {
                            packed.sheets[0].color[c][base + row * stride + lane]
                        };
                    }
                }
            }
        }
    }
}

/// The parts of a tile, by their first column and row.
fn parts() -> impl Iterator<Item = (usize, usize)> {
    let rows = (0..TILE.1).step_by(PART.1);
    rows.flat_map(|y| (0..TILE.0).step_by(PART.0).map(move |x| (x, y)))
}

/// One compiled sweep: an instruction set and a number of channels.
type SweepFn = unsafe fn(&Packed, &mut Segments, (usize, usize), Missed, &mut TileColor);

macro_rules! faces {
    ($($name:ident, $lanes:ty, $($feature:literal)?;)*) => {
        $(
            /// # Safety
            ///
            /// As for [`sweep_tile`].
            $(#[target_feature(enable = $feature)])?
            unsafe fn $name<const C: usize>(
                packed: &Packed,
                segments: &mut Segments,
                origin: (usize, usize),
                missed: Missed,
                out: &mut TileColor,
            ) {
                // SAFETY: per the function's contract.
                unsafe { sweep_tile::<$lanes, C>(packed, segments, origin, missed, out) }
            }
        )*
    };
}

faces! {
    portable, Portable, ;
}
#[cfg(target_arch = "x86_64")]
faces! {
    avx2, super::lanes::Avx2, "avx2";
    avx512, super::lanes::Avx512, "avx512f,avx512bw";
}

macro_rules! by_channels {
    ($name:ident) => {
        [$name::<1>, $name::<2>, $name::<3>, $name::<4>]
    };
}

/// The sweep for an instruction set and a number of channels.
fn face(simd: Simd, channels: usize) -> SweepFn {
    let faces: [SweepFn; 4] = match simd {
        Simd::Portable => by_channels!(portable),
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2 => by_channels!(avx2),
        #[cfg(target_arch = "x86_64")]
        Simd::Avx512 => by_channels!(avx512),
    };
    faces[channels - 1]
}

/// Sweeps the tile at `origin` over all views of `segments`.
pub fn sweep(
    simd: Simd,
    packed: &Packed,
    segments: &mut Segments,
    origin: (usize, usize),
    missed: Missed,
    out: &mut TileColor,
) {
    let sweep = face(simd, out.planes.len());
    // SAFETY: `Simd` values come from `available`, which detects the instructions; the padding is at least as wide
    // as the largest shift plus the half pixel of a ray's start, so that every segment stays inside.
    unsafe { sweep(packed, segments, origin, missed, out) }
}
