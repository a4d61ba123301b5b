//! Compute passes over buffers, run in sequence, and the transfer of the result.

use super::device::{Gpu, lock};
use super::idle;
use super::pace::{Submission, Work};
use super::pipelines::PipelineKey;
use super::recorded::{Command, Pass, encoded};
use super::shader::Shader;
use super::traffic;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::picture::Size;
use bytemuck::Pod;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;
use wgpu::BufferUsages;

/// The largest number of passes that are timed; further passes run without timing.
const MAX_TIMED: u32 = 1024;
/// Number of values that one worker copies at a time.
const COPIED: usize = 1 << 18;
/// Number of transfer buffers that are kept for pictures: while one is read, the next is filled.
const MAX_SPARE_BACK: usize = 2;
/// Side of the workgroups of passes over frames, in pixels.
pub const GROUP: usize = 16;
/// Number of invocations of a workgroup.
const INVOCATIONS: f64 = 256.0;

/// How long one pass took on a GPU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassTime {
    /// The name of its shader.
    pub name: &'static str,
    /// Its time on the device, in seconds.
    pub seconds: f64,
}

/// A buffer, and how a pass uses it.
#[derive(Clone, Copy)]
pub enum Bound<'a> {
    /// It is read only.
    Read(&'a wgpu::Buffer),
    /// It is written to.
    Write(&'a wgpu::Buffer),
}

/// Takes a buffer of this size and usage from a list.
fn take(spare: &mut Vec<wgpu::Buffer>, bytes: usize, usage: BufferUsages) -> Option<wgpu::Buffer> {
    let fits = |buffer: &wgpu::Buffer| buffer.size() == bytes as u64 && buffer.usage() == usage;
    let fits = spare.iter().position(fits)?;
    Some(spare.swap_remove(fits))
}

/// The size of a frame in the form that shaders use.
pub fn pixels(size: Size) -> [u32; 2] {
    [size.width as u32, size.height as u32]
}

/// The number of workgroups that cover a frame.
pub fn groups(width: usize, height: usize) -> [u32; 3] {
    [width.div_ceil(GROUP) as u32, height.div_ceil(GROUP) as u32, 1]
}

/// A sequence of passes that is being recorded. It is submitted in pieces: see [`pace`](super::pace). The pipelines of a
/// piece are compiled together, which takes long the first time.
pub struct Commands<'a> {
    pub gpu: &'a Arc<Gpu>,
    cancel: &'a Cancel,
    /// What has been recorded since the last submission.
    recorded: Vec<Command>,
    work: Work,
    /// The times of the beginning and the end of every pass, if the device can measure them.
    stamps: Option<wgpu::QuerySet>,
    passes: Vec<&'static str>,
    /// Buffers that the next job may reuse.
    taken: Vec<wgpu::Buffer>,
    /// Those that later passes of this job may reuse. Another job may not: its passes may run between two pieces of
    /// this one.
    spare: Vec<wgpu::Buffer>,
}

impl<'a> Commands<'a> {
    pub fn new(gpu: &'a Arc<Gpu>, cancel: &'a Cancel) -> Commands<'a> {
        let keeps_time = gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let stamps = keeps_time.then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MAX_TIMED,
            })
        });
        let (recorded, work, passes, taken, spare) = Default::default();
        Commands { gpu, cancel, recorded, work, stamps, passes, taken, spare }
    }

    /// A buffer of `len` values that passes write and read. It may hold values of an earlier job; the device has
    /// finished that job before it begins this one.
    pub fn scratch<T: Pod>(&mut self, what: &'static str, len: usize) -> Result<wgpu::Buffer> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let bytes = len * size_of::<T>();
        let own = take(&mut self.spare, bytes, usage);
        let spare = own.or_else(|| take(&mut lock(&self.gpu.spare), bytes, usage));
        let buffer = spare.map_or_else(|| self.gpu.buffer(what, bytes, usage), Ok)?;
        self.taken.push(buffer.clone());
        Ok(buffer)
    }

    /// A buffer for an interleaved picture of this size.
    pub fn output(&mut self, size: Size) -> Result<wgpu::Buffer> {
        self.scratch::<f32>("the result", size.pixels() * size.channels)
    }

    /// Runs a shader on `groups` workgroups. Binding 0 is `params`, the following ones are `buffers`.
    pub fn pass<P: Pod>(
        &mut self,
        shader: &Shader,
        channels: usize,
        params: &P,
        buffers: &[Bound],
        groups: [u32; 3],
    ) -> Result<()> {
        let units = groups.into_iter().map(f64::from).product::<f64>() * INVOCATIONS;
        self.long_pass(shader, channels, params, buffers, (groups, units))
    }

    /// The same for a pass of more units of work than it has invocations.
    pub fn long_pass<P: Pod>(
        &mut self,
        shader: &Shader,
        channels: usize,
        params: &P,
        buffers: &[Bound],
        (groups, units): ([u32; 3], f64),
    ) -> Result<()> {
        self.begin(shader.name, units)?;
        let (layout, bind_group) = self.bindings(shader.name, params, buffers)?;
        let (pipeline, stamps) = (PipelineKey { shader: *shader, channels, layout }, self.stamps());
        self.recorded.push(Command::Pass(Pass { pipeline, bind_group, groups, stamps }));
        self.passes.push(shader.name);
        Ok(())
    }

    /// Runs a shader on tiles, in as many passes as keep submissions short. `units` is the work for each tile, and
    /// `params` makes the parameters of a pass that begins with a tile; each tile has `rows` workgroups.
    pub fn tiles<P: Pod>(
        &mut self,
        shader: &Shader,
        channels: usize,
        params: impl Fn(u32) -> P,
        buffers: &[Bound],
        (units, rows): (&[f64], u32),
    ) -> Result<()> {
        let mut first = 0;
        while first < units.len() {
            let count = self.next_part(shader, &units[first..]);
            let work = ([count as u32, rows, 1], units[first..first + count].iter().sum());
            self.long_pass(shader, channels, &params(first as u32), buffers, work)?;
            first += count;
        }
        Ok(())
    }

    /// The same for the rows of a frame: its width and height, and the work for each pixel. `params` makes the
    /// parameters of a pass that begins with a row.
    pub fn rows<P: Pod>(
        &mut self,
        shader: &Shader,
        channels: usize,
        params: impl Fn(u32) -> P,
        buffers: &[Bound],
        (width, height, per_px): (usize, usize, usize),
    ) -> Result<()> {
        let [across, down, _] = groups(width, height);
        let units = f64::from(across) * INVOCATIONS * per_px as f64;
        let units = vec![units; down as usize];
        let mut first = 0;
        while first < units.len() {
            let count = self.next_part(shader, &units[first..]);
            let work = ([across, count as u32, 1], units[first..first + count].iter().sum());
            self.long_pass(shader, channels, &params((GROUP * first) as u32), buffers, work)?;
            first += count;
        }
        Ok(())
    }

    /// The number of items that the next pass works on, by what is known by then.
    fn next_part(&self, shader: &Shader, units: &[f64]) -> usize {
        lock(&self.gpu.pace).items(shader.name, units, self.gpu.submission)
    }

    /// Makes room for a pass, and counts its work.
    fn begin(&mut self, shader: &'static str, units: f64) -> Result<()> {
        if !lock(&self.gpu.pace).fits(&self.work, shader, units, self.gpu.submission) {
            self.flush()?;
        }
        lock(&self.gpu.pace).add(&mut self.work, shader, units);
        Ok(())
    }

    /// Submits what has been recorded so far.
    pub fn flush(&mut self) -> Result<()> {
        let encoder = self.encoder();
        let work = std::mem::take(&mut self.work);
        self.gpu.submit(encoder, work, self.cancel)?;
        Ok(())
    }

    /// What has been recorded since the last submission, in the form that is submitted.
    fn encoder(&mut self) -> wgpu::CommandEncoder {
        encoded(self.gpu, &std::mem::take(&mut self.recorded))
    }

    /// The bindings of a pass.
    fn bindings<P: Pod>(
        &self,
        name: &'static str,
        params: &P,
        buffers: &[Bound],
    ) -> Result<(wgpu::BindGroupLayout, wgpu::BindGroup)> {
        let device = &self.gpu.device;
        // WGSL rounds the size of a structure up to its alignment, which is 16 bytes at most.
        let mut bytes = bytemuck::bytes_of(params).to_vec();
        bytes.resize(bytes.len().next_multiple_of(16), 0);
        let params = self.gpu.filled("parameters", &bytes, BufferUsages::UNIFORM)?;
        let kind =
            |bound: &Bound| wgpu::BufferBindingType::Storage { read_only: matches!(bound, Bound::Read(_)) };
        let kinds = std::iter::once(wgpu::BufferBindingType::Uniform).chain(buffers.iter().map(kind));
        let entry = |(binding, ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let entries: Vec<_> = (0..).zip(kinds).map(entry).collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(name),
            entries: &entries,
        });
        let bound = buffers.iter().map(|(Bound::Read(buffer) | Bound::Write(buffer))| *buffer);
        let entries: Vec<_> = (0..)
            .zip(std::iter::once(&params).chain(bound))
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(name),
            layout: &layout,
            entries: &entries,
        });
        Ok((layout, bind_group))
    }

    /// The query set and the first query index for the times of the next pass, if it is timed.
    fn stamps(&self) -> Option<(wgpu::QuerySet, u32)> {
        let first = 2 * self.passes.len() as u32;
        self.stamps.clone().filter(|_| first < 2 * MAX_TIMED).map(|stamps| (stamps, first))
    }

    /// Copies a whole buffer.
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer) {
        self.copy_part(from, 0, to, 0, from.size() as usize);
    }

    /// Copies a number of bytes between buffers.
    pub fn copy_part(
        &mut self,
        from: &wgpu::Buffer,
        from_byte: usize,
        to: &wgpu::Buffer,
        to_byte: usize,
        bytes: usize,
    ) {
        let [from_byte, to_byte, bytes] = [from_byte, to_byte, bytes].map(|v| v as u64);
        let (from, to) = (from.clone(), to.clone());
        self.recorded.push(Command::Copy { from, from_byte, to, to_byte, bytes });
    }

    /// The number of buffers that have been handed out.
    pub fn mark(&self) -> usize {
        self.taken.len()
    }

    /// Lets later passes reuse the buffers that were handed out since a mark. This is safe because passes run in
    /// sequence.
    pub fn recycle(&mut self, mark: usize) {
        self.spare.extend(self.taken.drain(mark..));
    }

    /// Submits the passes. Afterwards `output` is transferred back.
    pub fn submit(mut self, output: &wgpu::Buffer) -> Result<Pending> {
        let gpu = self.gpu;
        let bytes = output.size();
        let back = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let spare = take(&mut lock(&gpu.spare_back), bytes as usize, back);
        let values =
            spare.map_or_else(|| gpu.buffer("the picture that comes back", bytes as usize, back), Ok)?;
        self.copy(output, &values);
        let mut encoder = self.encoder();
        let timed = self.passes.len().min(MAX_TIMED as usize);
        let stamps = match &self.stamps {
            Some(stamps) if timed > 0 => {
                let bytes = 2 * timed * size_of::<u64>();
                let resolve = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
                let resolved = gpu.buffer("timestamps", bytes, resolve)?;
                let stamps_back = gpu.buffer("timestamps that come back", bytes, back)?;
                encoder.resolve_query_set(stamps, 0..2 * timed as u32, &resolved, 0);
                encoder.copy_buffer_to_buffer(&resolved, 0, &stamps_back, 0, bytes as u64);
                Some(stamps_back)
            }
            _ => None,
        };
        let submission = gpu.submit(encoder, self.work, self.cancel)?;
        traffic::count_readback(bytes + stamps.as_ref().map_or(0, wgpu::Buffer::size));
        self.taken.append(&mut self.spare);
        *lock(&gpu.spare) = self.taken;
        idle::watch(gpu);
        Ok(Pending {
            gpu: Arc::clone(gpu),
            submission,
            values: Mapped::new(values),
            stamps: stamps.map(Mapped::new),
            passes: self.passes,
        })
    }
}

/// The time after the end of its work within which a device must report that a buffer is readable.
const MAP_TIMEOUT: Duration = Duration::from_secs(10);

/// A buffer that will become readable.
struct Mapped {
    buffer: wgpu::Buffer,
    mapped: Receiver<std::result::Result<(), wgpu::BufferAsyncError>>,
}

impl Mapped {
    fn new(buffer: wgpu::Buffer) -> Mapped {
        let (sender, mapped) = channel();
        // If the render was interrupted, nobody receives this message any more.
        buffer.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
        Mapped { buffer, mapped }
    }

    /// Reads the transferred buffer, once the work has ended.
    ///
    /// A thread that polls runs the callbacks of all buffers, so this waits: another thread may be about to run its
    /// callback.
    fn read<T>(&self, gpu: &Gpu, read: impl FnOnce(&[u8]) -> T) -> Result<T> {
        match self.mapped.recv_timeout(MAP_TIMEOUT) {
            Ok(Ok(())) => {
                let view = self.buffer.get_mapped_range(..).map_err(|error| gpu.error(error))?;
                Ok(read(&view))
            }
            Ok(Err(error)) => {
                gpu.check()?;
                Err(gpu.error(error))
            }
            Err(_) => {
                gpu.check()?;
                Err(gpu.error("the device stopped before the picture was done"))
            }
        }
    }
}

/// Submitted passes that are running.
pub struct Pending {
    gpu: Arc<Gpu>,
    submission: Submission,
    values: Mapped,
    stamps: Option<Mapped>,
    passes: Vec<&'static str>,
}

impl Pending {
    /// Waits for the passes to end. The result is written to `out`, which has its size.
    pub fn wait(self, cancel: &Cancel, out: &mut [f32]) -> Result<Vec<PassTime>> {
        let gpu = &self.gpu;
        gpu.wait(&self.submission, cancel)?;
        self.values.read(gpu, |bytes| {
            let source: &[f32] = bytemuck::cast_slice(bytes);
            out.par_chunks_mut(COPIED)
                .zip(source.par_chunks(COPIED))
                .for_each(|(out, source)| out.copy_from_slice(source));
        })?;
        let passes = self.stamps.as_ref().map_or(Ok(Vec::new()), |stamps| {
            let seconds_per_tick = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
            stamps.read(gpu, |bytes| {
                let ticks: &[u64] = bytemuck::cast_slice(bytes);
                let seconds = ticks.as_chunks::<2>().0.iter();
                let seconds =
                    seconds.map(|[begin, end]| end.saturating_sub(*begin) as f64 * seconds_per_tick);
                self.passes.iter().zip(seconds).map(|(&name, seconds)| PassTime { name, seconds }).collect()
            })
        })?;
        gpu.check()?;
        self.values.buffer.unmap();
        let mut spare = lock(&gpu.spare_back);
        spare.truncate(MAX_SPARE_BACK - 1);
        spare.insert(0, self.values.buffer);
        drop(spare);
        // The device was busy until now.
        idle::watch(gpu);
        Ok(passes)
    }
}
