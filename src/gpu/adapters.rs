//! The adapters of this machine.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Of what make an adapter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A program that does a GPU's work on the CPU.
    Software,
    /// Its driver does not say.
    Other,
    /// A share of a GPU in a virtual machine.
    Virtual,
    /// A GPU that shares the memory of the CPU.
    Integrated,
    /// A GPU with memory of its own.
    Discrete,
}

impl Kind {
    /// The word for it.
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

/// An adapter and what is known of it.
pub struct Adapter {
    /// What it is called.
    pub name: String,
    /// Of what make it is.
    pub kind: Kind,
    /// The interface that it is reached by, such as `vulkan`.
    pub backend: String,
    /// Its driver and that one's version.
    pub driver: String,
    /// The largest buffer it can hold.
    pub max_buffer_bytes: u64,
    /// How much of a buffer one pass can see.
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

/// All adapters, in the order in which their drivers list them; looked for once a process.
pub fn all() -> Arc<Vec<Adapter>> {
    // What another process found is kept, because a forked child must not free it.
    static FOUND: Mutex<Option<HashMap<u32, Arc<Vec<Adapter>>>>> = Mutex::new(None);
    let found = || FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some(adapters) = found().as_ref().and_then(|found| found.get(&process)) {
        return Arc::clone(adapters);
    }
    let adapters = Arc::new(look());
    let mut found = found();
    Arc::clone(found.get_or_insert_with(HashMap::new).entry(process).or_insert(adapters))
}

fn look() -> Vec<Adapter> {
    let backends = wgpu::Backends::PRIMARY;
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    // Memory that is promised but not there fails late and badly: leave a share of it to others.
    descriptor.memory_budget_thresholds.for_resource_creation = Some(95);
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(backends)).into_iter().map(Adapter::new).collect()
}

/// Whether there may be a GPU. To know for sure, all drivers have to be loaded, which takes long where the only one is
/// a software rasteriser.
pub fn may_have_gpu() -> bool {
    // Linux has a file for every GPU, and for what a virtual machine is lent.
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

/// The best GPU: no software, discrete before integrated, and the first of its kind.
pub fn best(adapters: &[Adapter]) -> Option<usize> {
    let real = (0..adapters.len()).rev().filter(|&i| adapters[i].kind != Kind::Software);
    real.max_by_key(|&i| adapters[i].kind)
}
