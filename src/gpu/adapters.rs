//! The GPU adapters of this machine.

use super::visible::Visible;
use std::cmp::Reverse;
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

    /// Whether an adapter of this type is faster than the CPU beside it as a rule. One that shares the memory of the
    /// CPU mostly is not, and of one in a virtual machine, or of unknown type, nothing is known.
    pub fn pays(self) -> bool {
        self == Kind::Discrete
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
    /// The number of its maker.
    pub vendor: u32,
    /// Its address on the PCI bus; empty if its driver does not say. Direct3D 12 knows the model of a GPU only, and
    /// would have the address of any of several.
    pub pci_bus_id: String,
    /// The size of its memory, if the driver says so: for Vulkan, that of the largest heap of its own.
    pub memory_bytes: Option<u64>,
    /// Whether it measures how long each pass takes.
    pub measures_time: bool,
    /// The size of the largest buffer that it can allocate.
    pub max_buffer_bytes: u64,
    /// The size of the largest part of a buffer that one pass can bind.
    pub max_binding_bytes: u64,
    pub(super) handle: wgpu::Adapter,
}

impl Adapter {
    fn new(handle: wgpu::Adapter) -> Adapter {
        let (info, limits, features) = (handle.get_info(), handle.limits(), handle.features());
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
            vendor: info.vendor,
            pci_bus_id: if info.backend == wgpu::Backend::Vulkan {
                info.device_pci_bus_id
            } else {
                String::new()
            },
            memory_bytes: memory_bytes(&handle),
            measures_time: features.contains(wgpu::Features::TIMESTAMP_QUERY),
            max_buffer_bytes: limits.max_buffer_size,
            max_binding_bytes: limits.max_storage_buffer_binding_size,
            handle,
        }
    }

    /// Where it comes among the adapters that may be chosen; none if it is hidden.
    pub fn place_in(&self, visible: &Visible) -> Option<usize> {
        visible.place_of(self.vendor, &self.pci_bus_id)
    }
}

/// The size of the largest heap of an adapter's own memory. Only Vulkan tells it before anything is allocated.
#[cfg(any(windows, target_os = "linux"))]
fn memory_bytes(handle: &wgpu::Adapter) -> Option<u64> {
    /// `VK_MEMORY_HEAP_DEVICE_LOCAL_BIT`.
    const OWN: u32 = 1;
    // SAFETY: the adapter is asked for its properties, and is not kept.
    let memory = unsafe {
        let adapter = handle.as_hal::<wgpu::hal::api::Vulkan>()?;
        let instance = adapter.shared_instance().raw_instance();
        instance.get_physical_device_memory_properties(adapter.raw_physical_device())
    };
    let heaps = memory.memory_heaps_as_slice().iter();
    heaps.filter(|heap| heap.flags.as_raw() & OWN != 0).map(|heap| heap.size).max()
}

#[cfg(not(any(windows, target_os = "linux")))]
fn memory_bytes(_: &wgpu::Adapter) -> Option<u64> {
    None
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

/// The adapter that is taken if only a GPU is asked for, and if none is asked for (`automatic`): never software, the
/// latter only where it [pays](Kind::pays), discrete before integrated, and the first of its type that
/// `CUDA_VISIBLE_DEVICES` does not hide.
pub fn best(adapters: &[Adapter], automatic: bool) -> Option<usize> {
    let visible = Visible::here();
    let places = adapters.iter().map(|adapter| adapter.place_in(&visible).map(|place| (adapter.kind, place)));
    first(&places.collect::<Vec<_>>(), automatic)
}

/// The best of adapters of these types and places in an order; none for those that are hidden.
fn first(adapters: &[Option<(Kind, usize)>], automatic: bool) -> Option<usize> {
    let accepted = |kind: Kind| if automatic { kind.pays() } else { kind != Kind::Software };
    let candidates =
        adapters.iter().enumerate().filter_map(|(i, adapter)| adapter.map(|(kind, place)| (kind, place, i)));
    let best = candidates
        .filter(|(kind, ..)| accepted(*kind))
        .min_by_key(|&(kind, place, i)| (Reverse(kind), place, i));
    best.map(|(.., i)| i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use Kind::{Discrete, Integrated, Other, Software, Virtual};

    fn of(kinds: &[Kind], automatic: bool) -> Option<usize> {
        first(&kinds.iter().map(|kind| Some((*kind, 0))).collect::<Vec<_>>(), automatic)
    }

    #[test]
    fn only_discrete_gpus_are_taken_unasked() {
        for kind in [Software, Other, Virtual, Integrated] {
            assert_eq!(of(&[kind], true), None, "{}", kind.name());
        }
        assert_eq!(of(&[Integrated, Discrete, Discrete], true), Some(1));
    }

    #[test]
    fn a_gpu_that_is_asked_for_is_the_best_that_is_no_software() {
        assert_eq!(of(&[Software, Other, Integrated, Virtual], false), Some(2));
        assert_eq!(of(&[Software], false), None);
    }

    #[test]
    fn hidden_adapters_are_left_out_and_the_others_come_in_their_order() {
        let all = [None, Some((Discrete, 1)), Some((Discrete, 0)), Some((Integrated, 0))];
        assert_eq!(first(&all, true), Some(2));
        assert_eq!(first(&all[..2], true), Some(1));
        assert_eq!(first(&all[..1], false), None);
    }
}
