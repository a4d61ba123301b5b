//! The GPU adapters of this machine.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// The type of an adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A program that emulates a GPU on the CPU.
    Software,
    /// Unknown: its driver does not say.
    Other,
    /// A share of a GPU in a virtual machine.
    Virtual,
    /// A GPU that shares the memory of the CPU.
    Integrated,
    /// A GPU with memory of its own.
    Discrete,
}

impl Kind {
    /// The name of the type.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Software => "software",
            Kind::Other => "other",
            Kind::Virtual => "virtual",
            Kind::Integrated => "integrated",
            Kind::Discrete => "discrete",
        }
    }
}

/// An adapter and its properties.
pub struct Adapter {
    /// Its name.
    pub name: String,
    /// Its type.
    pub kind: Kind,
    /// The interface through which it is reached, such as `vulkan`.
    pub backend: String,
    /// The name and version of its driver.
    pub driver: String,
    /// The size of the largest buffer that it can allocate.
    pub max_buffer_bytes: u64,
    /// The size of the largest part of a buffer that one pass can bind.
    pub max_binding_bytes: u64,
    pub(super) handle: wgpu::Adapter,
}

impl Adapter {
    fn new(handle: wgpu::Adapter) -> Adapter {
        let (info, limits) = (handle.get_info(), handle.limits());
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => Kind::Discrete,
            wgpu::DeviceType::IntegratedGpu => Kind::Integrated,
            wgpu::DeviceType::VirtualGpu => Kind::Virtual,
            wgpu::DeviceType::Cpu => Kind::Software,
            wgpu::DeviceType::Other => Kind::Other,
        };
        Adapter {
            name: info.name,
            kind,
            backend: info.backend.to_string(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            max_buffer_bytes: limits.max_buffer_size,
            max_binding_bytes: limits.max_storage_buffer_binding_size,
            handle,
        }
    }
}

/// All adapters, in the order in which their drivers list them. They are searched once per process.
pub fn all() -> Arc<Vec<Adapter>> {
    // The adapters that another process found are kept, because a forked child must not free them.
    static FOUND: Mutex<Option<HashMap<u32, Arc<Vec<Adapter>>>>> = Mutex::new(None);
    let found = || FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some(adapters) = found().as_ref().and_then(|found| found.get(&process)) {
        return Arc::clone(adapters);
    }
    let adapters = Arc::new(find());
    let mut found = found();
    Arc::clone(found.get_or_insert_with(HashMap::new).entry(process).or_insert(adapters))
}

fn find() -> Vec<Adapter> {
    let backends = wgpu::Backends::PRIMARY;
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    // Memory that was promised but is not available makes later calls fail in ways that are hard to handle, so a
    // share of it is left to others.
    descriptor.memory_budget_thresholds.for_resource_creation = Some(95);
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(backends)).into_iter().map(Adapter::new).collect()
}

/// Whether there may be a GPU. To be certain, all drivers have to be loaded, which takes long if the only one is a
/// software rasteriser.
pub fn may_have_gpu() -> bool {
    // Linux has a device file for every GPU, and for the devices that a virtual machine is lent.
    if !cfg!(target_os = "linux") {
        return true;
    }
    let exists = |path: &str| std::path::Path::new(path).exists();
    let renders = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| entry.file_name().to_string_lossy().starts_with("renderD"))
    };
    exists("/dev/nvidiactl")
        || exists("/dev/dxg")
        || std::fs::read_dir("/dev/dri").is_ok_and(|entries| entries.into_iter().any(renders))
}

/// The best GPU: never software, discrete before integrated, and the first of its type.
pub fn best(adapters: &[Adapter]) -> Option<usize> {
    let real = (0..adapters.len()).rev().filter(|&i| adapters[i].kind != Kind::Software);
    real.max_by_key(|&i| adapters[i].kind)
}
