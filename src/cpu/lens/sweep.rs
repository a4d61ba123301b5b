//! The sweep: for every view, the nearest cell that each pixel's ray meets.
//!
//! While the shift of a view stays within one pixel, all rays of a tile meet the cells at one and the same
//! offset. So a ray's way into the scene is a list of segments, near to far, each "look at the cells at this
//! offset, take those whose depth lies in this interval": contiguous loads, no z-buffer, no gather.

use super::barrel::{Clip, Seen};
use super::blocks::{BLOCK, DepthBits, any_bin};
use super::lanes::{HalfPlaneRow, LANES, Lanes, Portable, Ray};
use super::line::Line;
use super::pack::{Packed, TILE};
use super::patches::{Need, PART, Patches};
use crate::cpu::simd::Simd;
use crate::views::View;

/// Rows of a tile swept together.
const ROWS: usize = 2;

/// A stretch of depth over which a view's rays stay at one offset.
#[derive(Debug, Clone, Copy, Default)]
struct Segment {
    /// From an output pixel to the cell, in padded cells.
    offset: i32,
    /// Codes `from .. to`.
    from: u16,
    to: u16,
    sheet: u32,
    /// Which of the tile's rays.
    ray: u32,
}

/// The segments of all views over one tile.
#[derive(Default)]
pub struct Segments {
    segments: Vec<Segment>,
    /// What makes it worth while to look at each.
    needs: Vec<Need>,
    rays: Vec<Ray>,
    /// End of each view's segments.
    ends: Vec<u32>,
    /// For each view, the pixels of each row of the tile that see it; empty where all see all.
    seen: Vec<Seen>,
    /// The segments that the part at hand has to look at.
    looks: Vec<Segment>,
    /// End of each view's looks.
    look_ends: Vec<u32>,
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
    fn depths_at(&self, cell: [f64; 2]) -> &[DepthBits] {
        let (pad, blocks) = (self.packed.padding.pad as i64, &self.packed.blocks);
        let block = |origin: usize, cell: f64| (origin as i64 + pad + cell as i64) as usize / BLOCK;
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

    /// Which of the `LANES` x `ROWS` pixels from `(x, y)` see view number `view`.
    #[inline(always)]
    fn waiting(&self, view: usize, (x, y): (usize, usize)) -> [u32; ROWS] {
        match self.seen.get(view) {
            None => [u32::MAX; ROWS],
            Some(rows) => std::array::from_fn(|row| (rows[y + row] >> x) as u32),
        }
    }

    /// Chooses the looks of the part of the tile that begins at `place` of the padded frame.
    fn choose(&mut self, patches: &Patches, place: (usize, usize)) {
        let Segments { segments, needs, ends, looks, look_ends, .. } = self;
        let entry = patches.entry(place);
        // Room for all, so that to keep one is to count it.
        if looks.len() < segments.len() {
            looks.resize(segments.len(), Segment::default());
        }
        look_ends.clear();
        let (mut start, mut n) = (0, 0);
        for &end in ends.iter() {
            for (segment, need) in segments[start..end as usize].iter().zip(&needs[start..end as usize]) {
                looks[n] = *segment;
                n += usize::from(patches.may_have(entry, need));
            }
            start = end as usize;
            look_ends.push(n as u32);
        }
    }

    /// Follows every view through the depths that occur, near to far.
    pub fn trace(&mut self, start: &Start, views: &[View]) {
        self.segments.clear();
        self.needs.clear();
        self.rays.clear();
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
            self.ends.push(self.segments.len() as u32);
        }
    }

    /// The segments of a ray from `ray_start` and through lens point `lens`, between two depths.
    fn trace_run(&mut self, start: &Start, lens: [f64; 2], ray_start: [f64; 2], near: usize, far: usize) {
        let Start { packed, s_focus, .. } = *start;
        let line = Line::new(&packed.codes, s_focus, lens, ray_start);
        line.follow(near, far, |cell, from, to| {
            let place = cell.map(|v| v as i32);
            let offset = place[1] * packed.padding.stride as i32 + place[0];
            let [bx, by] = line.base_from(cell);
            let ray = Ray { ax: line.slope[0] as f32, bx, ay: line.slope[1] as f32, by };
            for (sheet, bits) in start.depths_at(cell).iter().enumerate() {
                if any_bin(bits, from >> 8, (to - 1) >> 8) {
                    let (from, to, ray_number) = (from as u16, to as u16, self.rays.len() as u32);
                    self.needs.push(packed.patches.need(place, sheet, from, to));
                    self.segments.push(Segment { offset, from, to, sheet: sheet as u32, ray: ray_number });
                    self.rays.push(ray);
                }
            }
        });
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

/// Sweeps `LANES` x `ROWS` pixels whose first is at `at_tile` in the tile and at `base` in the padded frame, adding up
/// every view.
///
/// # Safety
///
/// The instructions of `L` have been detected, and every segment's cells lie inside the padded arrays.
#[inline(always)]
unsafe fn sweep_rows<L: Lanes, const C: usize>(
    packed: &Packed,
    segments: &Segments,
    at_tile: (usize, usize),
    base: usize,
    sums: &mut [[[f32; LANES]; C]; ROWS],
    missed: &mut [[u16; LANES]; ROWS],
) {
    let stride = packed.padding.stride;
    // SAFETY: per the function's contract.
    unsafe {
        let mut sum = [[L::zero(); C]; ROWS];
        let mut start = 0;
        for (view, &end) in segments.look_ends.iter().enumerate() {
            let end = end as usize;
            let mut waiting = segments.waiting(view, at_tile);
            for look in &segments.looks[start..end] {
                let sheet = &packed.sheets[look.sheet as usize];
                let first = base.wrapping_add_signed(look.offset as isize);
                let mut hits = [0u32; ROWS];
                for row in 0..ROWS {
                    let at = first + row * stride;
                    hits[row] = waiting[row]
                        & L::hits(sheet.lo.as_ptr().add(at), sheet.hi.as_ptr().add(at), look.from, look.to);
                }
                if hits.iter().all(|&h| h == 0) {
                    continue;
                }
                if let Some(partial) = &sheet.partial {
                    for row in 0..ROWS {
                        let at = first + row * stride;
                        let word = partial.bits.as_ptr().add(at / 8).cast::<u64>().read_unaligned();
                        let doubtful = (u64::from_le(word) >> (at % 8)) as u32 & hits[row];
                        if doubtful != 0 {
                            let covered = L::covered(&HalfPlaneRow {
                                normal_x: partial.normal_x.as_ptr().add(at),
                                normal_y: partial.normal_y.as_ptr().add(at),
                                cut: partial.cut.as_ptr().add(at),
                                code: sheet.lo.as_ptr().add(at),
                                ray: segments.rays[look.ray as usize],
                            });
                            hits[row] &= !doubtful | covered;
                        }
                    }
                }
                for row in 0..ROWS {
                    let at = first + row * stride;
                    for c in 0..C {
                        L::add(&mut sum[row][c], sheet.color[c].as_ptr().add(at), hits[row]);
                    }
                    waiting[row] &= !hits[row];
                }
                if waiting.iter().all(|&w| w == 0) {
                    break;
                }
            }
            for row in 0..ROWS {
                let mut left = waiting[row];
                while left != 0 {
                    missed[row][left.trailing_zeros() as usize] += 1;
                    left &= left - 1;
                }
            }
            start = end;
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
    for (x, part_y) in parts() {
        let place = (origin.0 + packed.padding.pad + x, origin.1 + packed.padding.pad + part_y);
        segments.choose(&packed.patches, place);
        for y in (part_y..part_y + PART.1).step_by(ROWS) {
            let base = packed.padding.index(origin.0 + x, origin.1 + y);
            let mut sums = [[[0.0; LANES]; C]; ROWS];
            let mut missed = [[0u16; LANES]; ROWS];
            // SAFETY: per the function's contract.
            unsafe { sweep_rows::<L, C>(packed, segments, (x, y), base, &mut sums, &mut missed) };
            for row in 0..ROWS {
                for lane in 0..LANES {
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
                            packed.sheets[0].color[c][base + row * packed.padding.stride + lane]
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
