//! An open adapter: its buffers, pipelines and errors.

use super::adapters::{self, Adapter, Kind};
use super::pace::{Measured, Pace, SUBMISSION, Submissions};
use super::traffic;
use crate::error::{Error, Result};
use bytemuck::Pod;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The open devices by process and adapter.
type Open = HashMap<(u32, usize), Arc<Gpu>>;

/// Pipelines by the name of the shader and the number of channels.
type Pipelines = HashMap<(&'static str, usize), Arc<wgpu::ComputePipeline>>;

/// An adapter that has been opened. Each process has one for each adapter, until it fails.
pub struct Gpu {
    adapter: usize,
    name: String,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) limits: wgpu::Limits,
    /// The memory that it has, or is said to have.
    memory_bytes: Option<u64>,
    /// The memory that it lets be used, in tests of what happens without.
    room_bytes: Option<u64>,
    /// The turns after which an invocation silently leaves all loops, if it does: software rasterisers do so.
    pub(super) most_turns: Option<usize>,
    /// The time that a submission should take.
    pub(super) submission: Duration,
    pub(super) pace: Mutex<Pace>,
    pub(super) submissions: Mutex<Submissions>,
    /// When it was last used, and whether a thread looks at that.
    last_used: Mutex<Instant>,
    pub(super) is_watched: AtomicBool,
    pub(super) pipelines: Mutex<Pipelines>,
    /// Buffers of the last job that the next job may reuse.
    pub(super) spare: Mutex<Vec<wgpu::Buffer>>,
    /// The same for the buffers in which pictures are transferred back.
    pub(super) spare_back: Mutex<Vec<wgpu::Buffer>>,
    /// The error that occurred outside of any call, if there was one.
    fault: Arc<Mutex<Option<String>>>,
}

/// The adapters that are open. Those of a parent process stay in the map, because a forked child must not free them.
static OPEN: Mutex<Option<Open>> = Mutex::new(None);

/// Limits that are imposed on devices.
#[derive(Debug, Clone, Copy)]
pub struct Restrictions {
    /// The size of the largest buffer that a pass can bind.
    pub most_bytes: u64,
    /// The memory for which bands are planned.
    pub memory_bytes: Option<u64>,
    /// The memory beyond which nothing can be allocated.
    pub room_bytes: Option<u64>,
    /// The time that a submission should take.
    pub submission: Duration,
    /// The factor by which all quotients of shaders are off.
    #[cfg(feature = "test-shaders")]
    pub quotient: f32,
}

impl Restrictions {
    /// No restriction.
    pub const NONE: Restrictions = Restrictions {
        most_bytes: u64::MAX,
        memory_bytes: None,
        room_bytes: None,
        submission: SUBMISSION,
        #[cfg(feature = "test-shaders")]
        quotient: 1.0,
    };
}

static RESTRICTIONS: Mutex<Restrictions> = Mutex::new(Restrictions::NONE);

/// Reopens the devices of this process with these restrictions, for tests of smaller devices.
pub fn restrict(restrictions: Restrictions) {
    *lock(&RESTRICTIONS) = restrictions;
    let process = std::process::id();
    if let Some(open) = lock(&OPEN).as_mut() {
        open.retain(|(of, _), _| *of != process);
    }
}

/// The devices of this process that are open.
fn open() -> Vec<Arc<Gpu>> {
    let process = std::process::id();
    let open = lock(&OPEN);
    open.iter().flatten().filter(|((of, _), _)| *of == process).map(|(_, gpu)| Arc::clone(gpu)).collect()
}

/// Gives back the memory of all devices of this process that nothing is kept in.
pub fn release() {
    open().iter().for_each(|gpu| gpu.release());
}

/// The memory of all devices of this process that is allocated, as far as their drivers are asked through Vulkan or
/// Direct3D 12.
pub fn allocated_bytes() -> u64 {
    open().iter().map(|gpu| gpu.allocated_bytes()).sum()
}

/// What was submitted to the devices of this process so far.
pub fn submissions() -> Measured {
    let all = open().into_iter().map(|gpu| lock(&gpu.pace).measured());
    all.fold(Measured::default(), |a, b| Measured {
        submissions: a.submissions + b.submissions,
        longest_s: a.longest_s.max(b.longest_s),
    })
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // The content of a poisoned lock is either whole or absent.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn mebibytes(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}

/// The limit of llvmpipe.
const SOFTWARE_TURNS: usize = 65_535;

/// Number of bytes that one worker copies at a time.
const COPIED: usize = 1 << 20;

/// Copies bytes to as many others.
fn copy(bytes: &[u8], to: wgpu::WriteOnly<[u8]>) {
    let (parts, rest) = bytes.as_chunks::<COPIED>();
    let (to_parts, mut to_rest) = to.into_chunks::<COPIED>();
    let pairs: Vec<_> = parts.iter().zip(to_parts).collect();
    pairs.into_par_iter().for_each(|(part, to)| wgpu::WriteOnly::<[u8]>::from(to).copy_from_slice(part));
    to_rest.copy_from_slice(rest);
}

/// The factor by which all quotients of shaders are off.
#[cfg(feature = "test-shaders")]
pub(super) fn quotient() -> f32 {
    lock(&RESTRICTIONS).quotient
}

impl Gpu {
    /// The adapter with index `adapter` in [`adapters::all`]. It is opened if it is not open yet or has failed.
    pub fn open(adapter: usize) -> Result<Arc<Gpu>> {
        let key = (std::process::id(), adapter);
        let at_hand = lock(&OPEN).as_ref().and_then(|open| open.get(&key)).map(Arc::clone);
        if let Some(gpu) = at_hand {
            if lock(&gpu.fault).is_none() {
                return Ok(gpu);
            }
            gpu.retire();
        }
        let adapters = adapters::all();
        let found = adapters.get(adapter).ok_or_else(|| {
            Error::Device(format!("there is no adapter {adapter}; dofsim.devices() lists what there is"))
        })?;
        let gpu = Arc::new(Gpu::new(adapter, found)?);
        let mut open = lock(&OPEN);
        Ok(Arc::clone(open.get_or_insert_with(HashMap::new).entry(key).or_insert(gpu)))
    }

    fn new(index: usize, adapter: &Adapter) -> Result<Gpu> {
        let Restrictions { most_bytes, memory_bytes, room_bytes, submission, .. } = *lock(&RESTRICTIONS);
        let mut limits = adapter.handle.limits();
        limits.max_storage_buffer_binding_size = limits.max_storage_buffer_binding_size.min(most_bytes);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("dofsim"),
            required_features: adapter.handle.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: limits.clone(),
            ..Default::default()
        };
        let refused = |error| Error::Device(format!("{}: cannot be opened: {error}", adapter.name));
        let (device, queue) =
            pollster::block_on(adapter.handle.request_device(&descriptor)).map_err(refused)?;
        let fault = Arc::new(Mutex::new(None));
        // Without a handler, an error that no scope catches would be a panic.
        let uncaught = Arc::clone(&fault);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            lock(&uncaught).get_or_insert(error.to_string());
        }));
        let lost = Arc::clone(&fault);
        device.set_device_lost_callback(move |_, reason| {
            lock(&lost).get_or_insert(format!("the device was lost: {reason}"));
        });
        let name = adapter.name.clone();
        Ok(Gpu {
            adapter: index,
            name,
            device,
            queue,
            limits,
            memory_bytes: memory_bytes.or(adapter.memory_bytes),
            room_bytes,
            most_turns: (adapter.kind == Kind::Software).then_some(SOFTWARE_TURNS),
            submission,
            pace: Mutex::default(),
            submissions: Mutex::default(),
            last_used: Mutex::new(Instant::now()),
            is_watched: AtomicBool::new(false),
            pipelines: Mutex::default(),
            spare: Mutex::default(),
            spare_back: Mutex::default(),
            fault,
        })
    }

    /// Makes the next call reopen the adapter.
    pub fn retire(&self) {
        let mut open = lock(&OPEN);
        let key = (std::process::id(), self.adapter);
        let is_this = |gpu: &Arc<Gpu>| std::ptr::eq(Arc::as_ptr(gpu), self);
        if let Some(open) = open.as_mut().filter(|open| open.get(&key).is_some_and(is_this)) {
            open.remove(&key);
        }
    }

    /// An error that names this device.
    pub(super) fn error(&self, what: impl std::fmt::Display) -> Error {
        Error::Device(format!("{}: {what}", self.name))
    }

    /// Returns an error if something went wrong outside of any call.
    pub(super) fn check(&self) -> Result<()> {
        lock(&self.fault).as_ref().map_or(Ok(()), |fault| Err(self.error(fault)))
    }

    /// Runs work that may fail on the device, for example for lack of memory, and returns the error.
    pub(super) fn guarded<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        use wgpu::ErrorFilter::{Internal, OutOfMemory, Validation};
        let scopes = [Internal, Validation, OutOfMemory].map(|filter| self.device.push_error_scope(filter));
        let result = work();
        // Scopes are popped in reverse order.
        let errors = scopes.into_iter().rev().map(|scope| pollster::block_on(scope.pop()));
        let errors: Vec<wgpu::Error> = errors.collect::<Vec<_>>().into_iter().flatten().collect();
        // What is not there for lack of memory leads to other errors.
        if matches!(errors.first(), Some(wgpu::Error::OutOfMemory { .. })) {
            return Err(self.out_of_memory());
        }
        let value = result?;
        self.check()?;
        errors.first().map_or(Ok(value), |error| Err(self.error(error)))
    }

    fn out_of_memory(&self) -> Error {
        Error::Memory(format!(
            "{}: not enough memory on the device; use a smaller picture, or device=\"cpu\"",
            self.name
        ))
    }

    /// The error for a frame that needs more memory than there is.
    pub(super) fn out_of_memory_for(&self, what: &str, bytes: u64) -> Error {
        let of = self.memory_bytes.map_or(String::new(), |own| format!(" of {} MiB", mebibytes(own)));
        Error::Memory(format!(
            "{}: {what} would need {} MiB of the device's memory{of}, which are not to be had; use a smaller picture, or \
             device=\"cpu\"",
            self.name,
            mebibytes(bytes)
        ))
    }

    /// The memory for all buffers of a frame. A part is left for tables, for the driver and for other programs.
    pub(super) fn memory_for_frames(&self) -> u64 {
        self.memory_bytes.map_or(u64::MAX, |bytes| bytes / 10 * 8)
    }

    /// The memory that is allocated, if the driver can be asked.
    fn allocated_bytes(&self) -> u64 {
        self.device.generate_allocator_report().map_or(0, |report| report.total_allocated_bytes)
    }

    /// Notes that the device is used.
    pub(super) fn used(&self) {
        *lock(&self.last_used) = Instant::now();
    }

    /// The time since the device was used.
    pub(super) fn idle_for(&self) -> Duration {
        lock(&self.last_used).elapsed()
    }

    /// Gives back the memory that is kept for the next job.
    pub(super) fn release(&self) {
        drop((std::mem::take(&mut *lock(&self.spare)), std::mem::take(&mut *lock(&self.spare_back))));
        // The memory of buffers goes back when the device is asked for what has ended. An error shows at the next job.
        drop(self.device.poll(wgpu::PollType::Poll));
    }

    /// The size of the largest buffer that a pass can bind.
    pub(super) fn most_bytes(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// The error for a buffer that is larger than that.
    pub(super) fn too_large(&self, what: &str, bytes: u64) -> Error {
        self.error(format!(
            "{what} would need {} MiB in one piece, and the device allows {} MiB; use a smaller picture, or \
             device=\"cpu\"",
            mebibytes(bytes),
            mebibytes(self.most_bytes())
        ))
    }

    /// A buffer of `bytes` bytes; `what` describes it in errors.
    pub(super) fn buffer(
        &self,
        what: &'static str,
        bytes: usize,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer> {
        // Bindings must not be empty, and uploads end with a whole word.
        let size = (bytes as u64).max(4).next_multiple_of(4);
        let is_bound = usage.contains(wgpu::BufferUsages::STORAGE);
        if size > if is_bound { self.most_bytes() } else { self.limits.max_buffer_size } {
            return Err(self.too_large(what, size));
        }
        if self.room_bytes.is_some_and(|room| self.allocated_bytes() + size > room) {
            return Err(self.out_of_memory());
        }
        let descriptor = wgpu::BufferDescriptor { label: Some(what), size, usage, mapped_at_creation: false };
        Ok(self.device.create_buffer(&descriptor))
    }

    /// A storage buffer of `values`.
    pub(super) fn upload<T: Pod>(&self, what: &'static str, values: &[T]) -> Result<wgpu::Buffer> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        self.filled(what, bytemuck::cast_slice(values), usage)
    }

    /// A buffer with these bytes.
    pub(super) fn filled(
        &self,
        what: &'static str,
        bytes: &[u8],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer> {
        let buffer = self.buffer(what, bytes.len(), usage | wgpu::BufferUsages::COPY_DST)?;
        self.write(what, &buffer, 0, bytes)?;
        Ok(buffer)
    }

    /// Writes these bytes to a buffer, beginning with its byte `first`. The rest of their last word is filled with zeros.
    pub(super) fn write(
        &self,
        what: &'static str,
        buffer: &wgpu::Buffer,
        first: usize,
        bytes: &[u8],
    ) -> Result<()> {
        let (own, end) = (bytes.len(), bytes.len().next_multiple_of(4));
        let Some(size) = wgpu::BufferSize::new(end as u64) else { return Ok(()) };
        traffic::count_upload(own);
        // Mapped at its creation, a buffer would be filled with zeros first. The bytes are there before the next
        // submission runs.
        let staged = self.queue.write_buffer_with(buffer, first as u64, size);
        let mut staged = staged.ok_or_else(|| self.error(format_args!("{what} cannot be uploaded")))?;
        copy(bytes, staged.slice(..own));
        staged.slice(own..end).fill(0);
        Ok(())
    }
}
