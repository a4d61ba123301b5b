//! The traces of lens samples through the depths, as the shaders follow them: see `shaders/lens/traces.wgsl`.

use super::frame::{LensFrame, origin};
use crate::error::Result;
use crate::gpu::commands::Commands;
use crate::gpu::shader::shared;
use crate::picture::Size;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::ray::Ray;
use crate::plan::lens::tiles::Work;
use crate::plan::lens::{Plan, lens_samples, padded_bounds, tiles};
use crate::scene::depth_bounds::DepthBits;
use crate::scene::depth_codes::DepthCodes;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Number of lens samples whose segments a workgroup tests together.
pub const BATCH: usize = 64;

shared! {
    pub struct Tile {
        origin: [u32; 2],
        first_sample: u32,
        samples: u32,
        occupied: [u32; 8],
    }
}

shared! {
    pub struct LensSample {
        in_front: [f32; 2],
        behind: [f32; 2],
        first: u32,
        focus: u32,
        end: u32,
        columns: u32,
    }
}

shared! {
    pub struct Segment {
        cell: u32,
        codes: u32,
        base: [f32; 2],
    }
}

/// A set of depths as words of 32 bits.
fn depth_words(bits: &DepthBits) -> [u32; 8] {
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

/// The traces of a frame on the device, and what they are followed through.
pub struct TraceBuffers {
    pub traces: wgpu::Buffer,
    /// For each block of the padded frame, then each layer: the depths of a tile that begins there.
    pub windows: wgpu::Buffer,
    /// The index of the first sample for each number of samples.
    first_samples: BTreeMap<usize, u32>,
    /// The largest number of segments of a sample.
    pub longest: usize,
    /// The largest number of samples of a tile.
    pub most_samples: usize,
}

impl TraceBuffers {
    pub fn new(commands: &Commands, frame: &LensFrame) -> Result<TraceBuffers> {
        let LensFrame { cells, codes, plan, clip, .. } = *frame;
        let Traces { words, first_samples, longest } = Traces::new(codes, plan, clip, cells.size);
        let windows: Vec<[u32; 8]> =
            padded_bounds::windows(&plan.bounds).par_iter().map(depth_words).collect();
        Ok(TraceBuffers {
            traces: commands.gpu.upload("the traces of the samples", &words)?,
            windows: commands.gpu.upload("the depths around tiles", &windows)?,
            first_samples,
            longest,
            most_samples: plan.sample_sets.keys().copied().max().unwrap_or(0),
        })
    }

    /// The tile for the shaders, if it is swept.
    pub fn tile(&self, tile: &tiles::Tile) -> Option<Tile> {
        match &tile.work {
            Work::Sweep { samples, occupied } => Some(Tile {
                origin: origin(tile.origin),
                first_sample: self.first_samples[samples],
                samples: *samples as u32,
                occupied: depth_words(occupied),
            }),
            Work::Copy | Work::Disc => None,
        }
    }

    /// The passes that follow all samples, as first sample and end, if an invocation follows `at_once` in one pass.
    pub fn passes(&self, at_once: usize) -> impl Iterator<Item = [u32; 2]> + use<> {
        (0..self.most_samples).step_by(at_once).map(move |first| [first, first + at_once].map(|v| v as u32))
    }
}
