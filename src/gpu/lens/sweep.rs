//! Tiles in which visibility has to be resolved for every lens sample.

use super::frame::{GROUP_ROWS, LensFrame, MAX_LOOPS, Target, origin, units};
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, pixels};
use crate::gpu::shader::{Shader, shader, shared};
use crate::picture::{ChannelGroup, Size};
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::ray::Ray;
use crate::plan::lens::tiles::Work;
use crate::plan::lens::{Plan, lens_samples, padded_bounds, tiles};
use crate::scene::depth_bounds::DepthBits;
use crate::scene::depth_codes::DepthCodes;
use crate::scene::grid::{BLOCK, TILE};
use rayon::prelude::*;
use std::collections::BTreeMap;

pub const SWEEP: Shader = shader!(
    "lens/sweep",
    ["mirror", "interleaved", "lens/depth_spans", "lens/half_planes"],
    [SweepParams, Tile, LensSample, Segment]
);

/// Rows of a tile that one workgroup sweeps.
pub const ROWS: usize = 16;
/// The number of workgroups of a tile.
const GROUPS: u32 = TILE.1.div_ceil(ROWS) as u32;
/// Number of lens samples whose segments a workgroup tests together.
pub const BATCH: usize = 64;
/// The segments of a sample that are picked at most.
pub const CAPACITY: usize = 16;
/// Rows that one invocation sweeps, and words of a set of depths.
const ROWS_EACH: usize = ROWS / GROUP_ROWS;
const WORDS: usize = size_of::<DepthBits>() / size_of::<u32>();
/// A typical number of a sample's segments that contain cells near a tile.
const FOLLOWED: usize = 20;

shared! {
    struct SweepParams {
        size: [u32; 2],
        pad: [u32; 2],
        last: [u32; 2],
        blocks_across: u32,
        block: u32,
        layers: u32,
        missed: u32,
        first_sample: u32,
        end_sample: u32,
        front: u32,
        first_tile: u32,
    }
}

shared! {
    struct Tile {
        origin: [u32; 2],
        first_sample: u32,
        samples: u32,
        occupied: [u32; WORDS],
    }
}

shared! {
    struct LensSample {
        in_front: [f32; 2],
        behind: [f32; 2],
        first: u32,
        focus: u32,
        end: u32,
        columns: u32,
    }
}

shared! {
    struct Segment {
        cell: u32,
        codes: u32,
        base: [f32; 2],
    }
}

/// A set of depths as words of 32 bits.
fn depth_words(bits: &DepthBits) -> [u32; WORDS] {
    std::array::from_fn(|i| (bits[i / 2] >> (32 * (i % 2))) as u32)
}

/// The segments of a ray through all depths, near to far. While its shift stays within one pixel, the ray meets cells
/// at the same offset from the pixel where it starts.
struct Trace {
    /// Number of cells that the ray passes per depth code, in front of the focus and behind it.
    slopes: [[f32; 2]; 2],
    /// The segments in front of the focus, then those behind it.
    segments: Vec<Segment>,
    /// Number of segments in front of the focus.
    in_front: usize,
}

impl Trace {
    fn new(codes: &DepthCodes, s_focus: f64, sample: &lens_samples::LensSample) -> Trace {
        let rays = [sample.in_front, sample.behind].map(|lens| Ray::new(codes, s_focus, lens, sample.start));
        let mut segments = Vec::new();
        let mut traverse = |ray: &Ray, near: usize, far: usize| {
            ray.traverse(near, far, |cell, from, to| {
                let offset = cell.map(|v| (v as i16).cast_unsigned());
                segments.push(Segment {
                    cell: u32::from(offset[0]) | u32::from(offset[1]) << 16,
                    codes: from as u32 | (to as u32) << 16,
                    base: ray.base_from(cell),
                });
            });
            segments.len()
        };
        let (nearest, farthest) = (usize::from(u16::MAX), 1);
        // At the focus all rays are where they started, so a ray through one lens point can continue as another.
        let one_ray = sample.in_front == sample.behind;
        let focus = if one_ray { farthest as f64 } else { codes.place(s_focus).round() };
        let focus = focus.clamp(farthest as f64, nearest as f64) as usize;
        let in_front = traverse(&rays[0], nearest, focus);
        traverse(&rays[1], focus, farthest);
        Trace { slopes: rays.map(|ray| ray.slope.map(|v| v as f32)), segments, in_front }
    }
}

/// For each row of a frame, the columns that see a sample: the first column in the low half, and the one after the
/// last in the high half. The rows are padded to whole words of four.
fn columns(clip: &PupilClip, sample: &lens_samples::LensSample, size: Size) -> Vec<u32> {
    let of_row = |y: usize| {
        let inside = |v: f64| v.clamp(0.0, size.width as f64) as u32;
        clip.columns(sample.pupil, y).map_or(0, |[first, end]| inside(first) | inside(end) << 16)
    };
    (0..size.height.next_multiple_of(4)).map(of_row).collect()
}

/// The traces of all samples.
struct Traces {
    /// Lens samples, then segments, then the columns that see each sample.
    words: Vec<[u32; 4]>,
    /// The index of the first sample for each number of samples.
    first_samples: BTreeMap<usize, u32>,
    /// The largest number of segments of a sample.
    longest: usize,
}

impl Traces {
    fn new(codes: &DepthCodes, plan: &Plan, clip: Option<&PupilClip>, size: Size) -> Traces {
        const OF_SAMPLE: usize = size_of::<LensSample>() / size_of::<[u32; 4]>();
        let total = OF_SAMPLE * plan.sample_sets.values().map(Vec::len).sum::<usize>();
        let (mut samples, mut segments) = (Vec::new(), Vec::new());
        let (mut first_samples, mut longest) = (BTreeMap::new(), 0);
        for (&count, set) in &plan.sample_sets {
            first_samples.insert(count, samples.len() as u32);
            let traces: Vec<_> =
                set.par_iter().map(|sample| Trace::new(codes, plan.s_focus, sample)).collect();
            for Trace { slopes: [in_front, behind], segments: trace, in_front: nearer } in traces {
                longest = longest.max(trace.len());
                let first = (total + segments.len()) as u32;
                let (focus, end) = (first + nearer as u32, first + trace.len() as u32);
                segments.extend(trace);
                samples.push(LensSample { in_front, behind, first, focus, end, columns: 0 });
            }
        }
        let seen: Vec<Vec<u32>> = clip.map_or(Vec::new(), |clip| {
            let all: Vec<_> = plan.sample_sets.values().flatten().collect();
            all.into_par_iter().map(|sample| columns(clip, sample, size)).collect()
        });
        let first_columns = total + segments.len();
        for (i, (sample, columns)) in samples.iter_mut().zip(&seen).enumerate() {
            sample.columns = (first_columns + i * columns.len() / 4) as u32;
        }
        let samples = bytemuck::cast_slice::<LensSample, [u32; 4]>(&samples);
        let segments = bytemuck::cast_slice::<Segment, [u32; 4]>(&segments);
        let seen = seen.concat();
        let seen = bytemuck::cast_slice::<u32, [u32; 4]>(&seen);
        Traces { words: [samples, segments, seen].concat(), first_samples, longest }
    }
}

/// The tiles that are swept, and the traces of all samples.
pub struct Sweep<'a> {
    frame: LensFrame<'a>,
    params: SweepParams,
    traces: wgpu::Buffer,
    tiles: wgpu::Buffer,
    /// The number of samples of each tile.
    samples: Vec<usize>,
    windows: wgpu::Buffer,
    left_out: wgpu::Buffer,
    /// The largest number of segments of a sample.
    longest: usize,
}

impl<'a> Sweep<'a> {
    /// Uploads what is needed to sweep; `None` if nothing is swept.
    pub fn new(commands: &mut Commands, frame: &LensFrame<'a>) -> Result<Option<Sweep<'a>>> {
        let LensFrame { cells, codes, plan, clip } = *frame;
        if plan.sample_sets.is_empty() {
            return Ok(None);
        }
        let gpu = commands.gpu;
        let Traces { words: traces, first_samples, longest } = Traces::new(codes, plan, clip, cells.size);
        let tile = |tile: &tiles::Tile| match &tile.work {
            Work::Sweep { samples, occupied, .. } => Some(Tile {
                origin: origin(tile.origin),
                first_sample: first_samples[samples],
                samples: *samples as u32,
                occupied: depth_words(occupied),
            }),
            Work::InFocus | Work::Disc => None,
        };
        let tiles: Vec<Tile> = plan.tiles.iter().filter_map(tile).collect();
        let windows = padded_bounds::windows(&plan.bounds);
        let windows: Vec<[u32; WORDS]> = windows.par_iter().map(depth_words).collect();
        let params = SweepParams {
            size: pixels(cells.size),
            pad: plan.padding.pad.map(|pad| pad as u32),
            last: [plan.padding.stride - TILE.0, plan.padding.rows - TILE.1].map(|last| last as u32),
            blocks_across: plan.bounds.across as u32,
            block: BLOCK as u32,
            layers: cells.layers as u32,
            missed: plan.missed as u32,
            first_sample: 0,
            end_sample: 0,
            front: (cells.front * cells.size.pixels()) as u32,
            first_tile: 0,
        };
        Ok(Some(Sweep {
            frame: *frame,
            params,
            samples: tiles.iter().map(|tile| tile.samples as usize).collect(),
            traces: gpu.upload("the traces of the samples", &traces)?,
            tiles: gpu.upload("the tiles that are swept", &tiles)?,
            windows: gpu.upload("the depths around tiles", &windows)?,
            left_out: commands.scratch::<f32>("the samples that do not count", cells.size.pixels())?,
            longest,
        }))
    }

    /// Sweeps the tiles with the colours `drawn`.
    pub fn pass(&self, commands: &mut Commands, target: Target, drawn: &wgpu::Buffer) -> Result<()> {
        let LensFrame { cells, plan, .. } = self.frame;
        let buffers = [
            Read(&cells.codes),
            Read(drawn),
            Read(&cells.half_planes),
            Read(&self.traces),
            Read(&self.tiles),
            Read(&self.windows),
            Write(&self.left_out),
            Write(target.picture),
        ];
        let at_once = self.samples_at_once(commands.gpu.most_turns);
        let most = plan.sample_sets.keys().copied().max().unwrap_or(0);
        for first_sample in (0..most).step_by(at_once) {
            let of_pass =
                |samples: &usize| units(samples.saturating_sub(first_sample).min(at_once) * cells.layers);
            let work: Vec<f64> = self.samples.iter().map(of_pass).collect();
            let params = |first_tile| SweepParams {
                first_sample: first_sample as u32,
                end_sample: (first_sample + at_once) as u32,
                first_tile,
                ..self.params
            };
            commands.tiles(&SWEEP, target.channels, params, &buffers, (&work, GROUPS))?;
        }
        Ok(())
    }

    /// The number of a tile's samples that one pass follows. `most_turns` are those after which an invocation leaves all loops,
    /// if it does.
    fn samples_at_once(&self, most_turns: Option<usize>) -> usize {
        let (longest, layers) = (self.longest, self.frame.cells.layers);
        // An invocation tests all segments of one sample of each batch, and follows the picked segments of all its
        // samples.
        let tested = longest * (2 + 2 * layers);
        let batches = MAX_LOOPS / (tested + BATCH * FOLLOWED * (1 + layers));
        let typical = batches.max(1) * BATCH;
        most_turns.map_or(typical, |most| {
            // At worst a sample meets more segments than can be picked, and all others are tested and followed in each layer.
            // Together its segments have a word of depths each, and one more where a word ends.
            let followed = 1 + ROWS_EACH + CAPACITY + longest * (2 + layers) + WORDS;
            let tested = tested + WORDS * (1 + layers);
            // The same turns for every sample, those of a batch that is begun, and those that write the sums.
            let turns = most.saturating_sub(tested + ROWS_EACH * ChannelGroup::MOST);
            (turns / (followed + tested.div_ceil(BATCH))).clamp(1, typical)
        })
    }
}
