//! The rays of a tile as segments, near to far, and which of them can meet a cell.

use super::culling::{PART, PatchBounds, Query};
use super::lanes::CellRay;
use super::padded::Padded;
use super::parts::Parts;
use crate::plan::lens::lens_samples::LensSample;
use crate::plan::lens::optical_vignetting::{PupilClip, Seen};
use crate::plan::lens::ray::Ray;
use crate::scene::depth_bounds::{DepthBits, any_bin};
use crate::scene::grid::{BLOCK, TILE};

/// Rows of a tile that are swept together.
pub const ROWS: usize = 2;

/// The largest number of cells of a row that any instruction set processes together.
pub const MOST: usize = PART.0;

/// An interval of depth over which a sample's rays stay at one offset.
#[derive(Debug, Clone, Copy, Default)]
pub struct Segment {
    /// Offset from an output pixel to the cell, in padded cells.
    pub offset: i32,
    /// Depth codes `from .. to`.
    pub from: u16,
    pub to: u16,
    pub layer: u32,
    /// The segment's own number.
    pub number: u32,
}

/// A segment of a ray, as traced.
#[derive(Debug, Clone, Copy)]
pub struct Traced {
    pub segment: Segment,
    /// The query whether any cell is there.
    query: Query,
    pub ray: CellRay,
    /// The number of its [`Step`]; 0 if there are none.
    step: u32,
}

/// The interval of depth over which a ray stays in a pixel, whatever is there.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    pub offset: i32,
    from: u16,
    pub to: u16,
}

/// The segments of all samples over one tile.
#[derive(Default)]
pub struct Segments {
    /// The parts of the tile that are swept.
    pub parts: Parts,
    pub traced: Vec<Traced>,
    /// The steps of each sample's ray, `None` before its first one. Known only if light passes through something.
    steps: Vec<Option<Step>>,
    /// The end of each sample's segments.
    ends: Vec<u32>,
    /// For each sample, the pixels of each row of the tile that see it. Empty if all pixels see all samples.
    pub seen: Vec<Seen>,
    /// For the samples for which it is known: the segment in which every ray of the current part meets its nearest
    /// cell.
    pub met: Vec<Segment>,
    /// The segments of the other samples that could not be culled for the current part.
    pub kept: Vec<Segment>,
    /// The numbers of those samples, and the ends of their kept segments.
    pub unknown: Vec<(u32, u32)>,
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

/// The tile from which rays start, and the depths and the second stop that they may meet.
pub struct Start<'a> {
    pub padded: &'a Padded,
    pub s_focus: f64,
    pub origin: (usize, usize),
    /// The depths that occur anywhere within reach.
    pub occupied: &'a DepthBits,
    /// The clipping by the second stop, if there is one.
    pub clip: Option<&'a PupilClip>,
}

impl Start<'_> {
    /// The depths of each layer that occur in the tile when it is moved by `cell`.
    #[inline(always)]
    fn depths_at(&self, cell: [i32; 2]) -> &[DepthBits] {
        let (pad, bounds) = (self.padded.padding.pad, &self.padded.bounds);
        let block = |first: usize, cell: i32| first.wrapping_add_signed(cell as isize) / BLOCK;
        let (bx, by) = (block(self.origin.0 + pad[0], cell[0]), block(self.origin.1 + pad[1], cell[1]));
        let b = by * bounds.across + bx;
        &self.padded.windows[b * bounds.layers..][..bounds.layers]
    }
}

impl Segments {
    /// The number of samples that a pixel of the tile sees.
    pub fn seen_from(&self, x: usize, y: usize) -> usize {
        if self.seen.is_empty() {
            return self.samples();
        }
        self.seen.iter().filter(|rows| rows[y] >> x & 1 != 0).count()
    }

    /// The number of samples.
    pub fn samples(&self) -> usize {
        self.ends.len()
    }

    /// The number behind that of a sample's last segment.
    pub fn end(&self, sample: usize) -> u32 {
        self.ends[sample]
    }

    /// The sample to which a segment belongs.
    pub fn sample_of(&self, segment: u32) -> usize {
        self.ends.partition_point(|end| *end <= segment)
    }

    /// The pixels of `ROWS` rows from `(x, y)` on that see sample number `sample`; only for tiles in which not all
    /// see all.
    #[inline(always)]
    pub fn seen_by(&self, sample: usize, (x, y): (usize, usize)) -> [u32; ROWS] {
        std::array::from_fn(|row| (self.seen[sample][y + row] >> x) as u32)
    }

    /// The steps before and after that of a segment, where the ray comes from and goes to a pixel beside its own.
    #[inline(always)]
    pub fn steps_beside(&self, traced: &Traced) -> (Option<&Step>, Option<&Step>) {
        let step = |number: usize| self.steps.get(number).and_then(Option::as_ref);
        let Segment { from, to, .. } = traced.segment;
        let number = traced.step as usize;
        (step(number - 1).filter(|step| step.from == to), step(number + 1).filter(|step| step.to == from))
    }

    /// Whether some pixel of the part of the tile that begins at `(x, y)` sees sample number `sample`.
    fn is_seen(seen: &[Seen], sample: usize, (x, y): (usize, usize)) -> bool {
        let Some(rows) = seen.get(sample) else { return true };
        rows[y..y + PART.1].iter().any(|row| (row >> x) as u32 != 0)
    }

    /// Culls the segments for the part of the tile that begins at `place` in the padded frame and at `at_tile` in the
    /// tile.
    pub fn cull(&mut self, patches: &PatchBounds, place: (usize, usize), at_tile: (usize, usize)) {
        let Segments { traced, ends, met, kept, unknown, seen, .. } = self;
        let entry = patches.entry(place);
        // There is room for all segments, so keeping one only increments a counter.
        if kept.len() < traced.len() {
            kept.resize(traced.len(), Segment::default());
        }
        met.clear();
        unknown.clear();
        let (mut start, mut n) = (0, 0);
        for (sample, &end) in ends.iter().enumerate() {
            if !Self::is_seen(seen, sample, at_tile) {
                start = end as usize;
                continue;
            }
            let (first, mut all) = (n, false);
            for Traced { segment, query, .. } in &traced[start..end as usize] {
                let occupancy = patches.occupancy(entry, query);
                kept[n] = *segment;
                n += usize::from(occupancy.any);
                if occupancy.all {
                    // All segments behind this one are hidden.
                    all = true;
                    break;
                }
            }
            start = end as usize;
            if all && n == first + 1 && seen.is_empty() {
                met.push(kept[first]);
                n = first;
            } else {
                unknown.push((sample as u32, n as u32));
            }
        }
    }

    /// Traces every sample through the depths that occur, near to far. `seen` has the pixels that follow each sample, and
    /// is empty if all do.
    #[inline(always)]
    pub fn trace(&mut self, start: &Start, samples: &[LensSample], seen: &[Seen]) {
        self.traced.clear();
        self.ends.clear();
        self.seen.clear();
        self.steps.clear();
        let runs = runs(start.occupied);
        for (i, sample) in samples.iter().enumerate() {
            self.steps.push(None);
            let followed = seen.get(i).copied();
            if let Some(clip) = start.clip {
                let Some(unclipped) = clip.pixels_seeing(sample.pupil, start.origin) else { continue };
                let followed = followed.unwrap_or([u64::MAX; TILE.1]);
                self.seen.push(std::array::from_fn(|y| unclipped[y] & followed[y]));
            } else if let Some(followed) = followed {
                self.seen.push(followed);
            }
            for &(first_bin, end_bin) in runs.iter().rev() {
                let (near, far) = ((end_bin * 256).min(usize::from(u16::MAX)), (first_bin * 256).max(1));
                if sample.in_front == sample.behind {
                    self.trace_run(start, sample.in_front, sample.start, near, far);
                } else {
                    // At the focus all rays are where they started, so a ray through one lens point can continue as
                    // another.
                    let focus = start.padded.codes.place(start.s_focus).round();
                    let focus = focus.clamp(far as f64, near as f64) as usize;
                    self.trace_run(start, sample.in_front, sample.start, near, focus);
                    self.trace_run(start, sample.behind, sample.start, focus, far);
                }
            }
            self.ends.push(self.traced.len() as u32);
        }
    }

    /// Traces a ray from `ray_start` through lens point `lens`, between two depths.
    #[inline(always)]
    fn trace_run(&mut self, start: &Start, lens: [f64; 2], ray_start: [f64; 2], near: usize, far: usize) {
        let Start { padded, s_focus, .. } = *start;
        let ray = Ray::new(&padded.codes, s_focus, lens, ray_start);
        ray.traverse(
            near,
            far,
            #[inline(always)]
            |passed, from, to| {
                let cell = padded.padding.inside(start.origin, passed);
                let offset = cell[1] * padded.padding.stride as i32 + cell[0];
                if padded.translucent {
                    self.steps.push(Some(Step { offset, from: from as u16, to: to as u16 }));
                }
                for (layer, bits) in start.depths_at(cell).iter().enumerate() {
                    if any_bin(bits, from >> 8, (to - 1) >> 8) {
                        let [bx, by] = ray.base_from(passed);
                        let (from, to, layer_number) = (from as u16, to as u16, layer as u32);
                        let number = self.traced.len() as u32;
                        self.traced.push(Traced {
                            segment: Segment { offset, from, to, layer: layer_number, number },
                            query: padded.patches.query(cell, layer, from, to),
                            ray: CellRay { ax: ray.slope[0] as f32, bx, ay: ray.slope[1] as f32, by },
                            step: self.steps.len() as u32 - 1,
                        });
                    }
                }
            },
        );
    }
}
