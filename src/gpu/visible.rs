//! The GPUs that `CUDA_VISIBLE_DEVICES` leaves to this process.
//!
//! The variable numbers GPUs as CUDA does, or has their UUIDs; adapters know their addresses on the PCI bus. NVIDIA's
//! driver lists UUIDs and addresses of all GPUs in `/proc`, so UUIDs can be looked up. Numbers can be only if CUDA
//! counts by address (`CUDA_DEVICE_ORDER=PCI_BUS_ID`) or there is one GPU: by default it counts the fastest first, by a
//! rule that is not published.

use std::path::Path;

const VARIABLE: &str = "CUDA_VISIBLE_DEVICES";
/// The number of NVIDIA among makers of PCI devices.
const NVIDIA: u32 = 0x10de;

/// An address on the PCI bus: domain, bus and device.
type Address = [u32; 3];

/// A GPU as NVIDIA's driver lists it.
#[derive(Debug, Clone, PartialEq)]
struct Listed {
    address: Address,
    uuid: String,
}

/// Which of NVIDIA's GPUs a process may choose by itself.
#[derive(Debug, Clone, PartialEq)]
pub enum Visible {
    /// All of them.
    All,
    /// These, the first one first.
    Only(Vec<[u32; 3]>),
    /// It cannot be known: the variable's value, and why.
    Unknown(String),
}

impl Visible {
    /// What the environment says.
    pub fn here() -> Visible {
        let variable = |name| std::env::var(name).ok();
        let Some(value) = variable(VARIABLE) else { return Visible::All };
        let by_address = variable("CUDA_DEVICE_ORDER").is_some_and(|order| order == "PCI_BUS_ID");
        Visible::new(&value, by_address, &listed(Path::new("/proc/driver/nvidia/gpus")))
    }

    fn new(value: &str, by_address: bool, listed: &[Listed]) -> Visible {
        let mut addresses: Vec<Address> = listed.iter().map(|gpu| gpu.address).collect();
        addresses.sort_unstable();
        let unknown = |why: &str| Visible::Unknown(format!("{VARIABLE}={value} is not heeded: {why}"));
        let mut only = Vec::new();
        for word in value.split(',').map(str::trim) {
            // CUDA ignores what follows the first entry that is no GPU.
            let found = if word.starts_with("MIG-") {
                return unknown("parts of a GPU cannot be had through Vulkan");
            } else if word.starts_with("GPU-") {
                let mut matching = listed.iter().filter(|gpu| gpu.uuid.starts_with(word));
                match (matching.next(), matching.next()) {
                    _ if listed.is_empty() => return unknown("NVIDIA's driver lists no GPUs in /proc"),
                    (Some(one), None) => Some(one.address),
                    _ => None,
                }
            } else if let Ok(number) = word.parse::<usize>() {
                if listed.is_empty() {
                    return unknown("NVIDIA's driver lists no GPUs in /proc");
                }
                if !by_address && listed.len() > 1 {
                    return unknown("how CUDA counts GPUs is known with CUDA_DEVICE_ORDER=PCI_BUS_ID alone");
                }
                addresses.get(number).copied()
            } else {
                None
            };
            match found {
                Some(address) => only.push(address),
                None => break,
            }
        }
        Visible::Only(only)
    }

    /// Where an adapter comes among those that may be chosen; none if it is hidden. The variable says nothing about
    /// GPUs of other makers, and nothing is known of those whose address is not.
    pub fn place_of(&self, vendor: u32, bus_id: &str) -> Option<usize> {
        match (self, vendor) {
            (Visible::Only(only), NVIDIA) if only.is_empty() => None,
            (Visible::Only(only), NVIDIA) => {
                address(bus_id).map_or(Some(0), |own| only.iter().position(|other| *other == own))
            }
            _ => Some(0),
        }
    }
}

/// An address as in `0000:41:00.0`.
fn address(text: &str) -> Option<Address> {
    let (place, _function) = text.split_once('.')?;
    let parts: Vec<u32> =
        place.split(':').map(|part| u32::from_str_radix(part, 16)).collect::<Result<_, _>>().ok()?;
    parts.try_into().ok()
}

/// The GPUs that NVIDIA's driver lists: a folder for each one, named by its address.
fn listed(folder: &Path) -> Vec<Listed> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let gpu = |entry: std::fs::DirEntry| {
        let text = std::fs::read_to_string(entry.path().join("information")).unwrap_or_default();
        let uuid = text.lines().find_map(|line| line.strip_prefix("GPU UUID:")).unwrap_or_default();
        Some(Listed { address: address(&entry.file_name().to_string_lossy())?, uuid: uuid.trim().to_owned() })
    };
    entries.filter_map(gpu).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two() -> Vec<Listed> {
        let gpu = |bus, uuid: &str| Listed { address: [0, bus, 0], uuid: uuid.to_owned() };
        vec![gpu(0x81, "GPU-aa11"), gpu(0x41, "GPU-bb22")]
    }

    fn only(buses: &[u32]) -> Visible {
        Visible::Only(buses.iter().map(|bus| [0, *bus, 0]).collect())
    }

    #[test]
    fn numbers_are_places_on_the_bus_if_cuda_counts_so() {
        for (value, buses) in
            [("0", &[0x41][..]), ("1,0", &[0x81, 0x41]), ("1,7,0", &[0x81]), ("", &[]), ("-1", &[])]
        {
            assert_eq!(Visible::new(value, true, &two()), only(buses), "{value}");
        }
        assert_eq!(Visible::new("0", false, &two()[..1]), only(&[0x81]));
    }

    #[test]
    fn adapters_come_in_the_order_of_the_variable() {
        let visible = only(&[0x81, 0x41]);
        assert_eq!(visible.place_of(NVIDIA, "0000:41:00.0"), Some(1));
        assert_eq!(visible.place_of(NVIDIA, "0000:c1:00.0"), None);
        assert_eq!(visible.place_of(NVIDIA, ""), Some(0));
        assert_eq!(only(&[]).place_of(NVIDIA, ""), None);
        let amd = 0x1002;
        assert_eq!(only(&[]).place_of(amd, "0000:c1:00.0"), Some(0));
    }

    #[test]
    fn uuids_may_be_shortened() {
        assert_eq!(Visible::new("GPU-bb22", false, &two()), only(&[0x41]));
        assert_eq!(Visible::new("GPU-b, GPU-a", false, &two()), only(&[0x41, 0x81]));
        assert_eq!(Visible::new("GPU-", false, &two()), only(&[]));
    }

    #[test]
    fn what_cannot_be_known_is_said_and_not_guessed() {
        for (value, listed, why) in
            [("0", two(), "CUDA_DEVICE_ORDER"), ("0", vec![], "/proc"), ("MIG-1", two(), "parts")]
        {
            let Visible::Unknown(text) = Visible::new(value, false, &listed) else { panic!("{value}") };
            assert!(text.contains(why) && text.contains(value), "{text}");
        }
        // Nothing is to be known where nothing is visible.
        assert_eq!(Visible::new("", false, &[]), only(&[]));
    }

    #[test]
    fn the_driver_s_list_is_read() {
        let folder = std::env::temp_dir().join(format!("dofsim-gpus-{}", std::process::id()));
        let own = folder.join("0000:41:00.0");
        std::fs::create_dir_all(&own).unwrap();
        std::fs::write(own.join("information"), "Model: \t\t NVIDIA\nGPU UUID: \t GPU-bb22\n").unwrap();
        let found = listed(&folder);
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(found, [Listed { address: [0, 0x41, 0], uuid: "GPU-bb22".to_owned() }]);
        assert_eq!(address("00000000:0A:1f.1"), Some([0, 10, 31]));
        assert_eq!(address("gpu"), None);
    }
}
