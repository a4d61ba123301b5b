//! The device on which to compute.

use crate::error::{Error, Result, value_error};
use crate::gpu::adapters::{self, Adapter, Kind};
use crate::gpu::machine;
use crate::gpu::visible::Visible;

/// A device as a caller chose it. The numbers of adapters are their indices in [`adapters::all`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Device {
    /// The CPU.
    Cpu,
    /// An adapter.
    Gpu(usize),
}

impl Device {
    /// The name under which it is given: that of an adapter has its number.
    pub fn id(self) -> String {
        let Device::Gpu(number) = self else { return "cpu".to_owned() };
        format!("gpu:{number}")
    }

    /// The device with this name. `preset`, from the environment, determines the meaning of "auto" and "gpu".
    pub fn named(name: &str, preset: Option<&str>) -> Result<Device> {
        match (name, preset) {
            ("cpu", _) => Ok(Device::Cpu),
            ("auto", Some("cpu")) => Ok(Device::Cpu),
            ("gpu", Some("cpu")) => Err(Error::Device(
                "device=\"gpu\": the environment variable DOFSIM_DEVICE is \"cpu\"; unset it, or name an adapter that \
                 dofsim.devices() lists"
                    .to_owned(),
            )),
            ("auto", None | Some("auto")) if !machine::may_have_gpu() => Ok(Device::Cpu),
            ("auto", None | Some("auto")) => {
                Ok(adapters::best(&adapters::all(), true).map_or(Device::Cpu, Device::Gpu))
            }
            ("gpu", None | Some("auto" | "gpu")) | ("auto", Some("gpu")) => {
                gpu(&adapters::all()).map(Device::Gpu)
            }
            ("auto" | "gpu", Some(word)) => {
                adapter("the environment variable DOFSIM_DEVICE", word).map(Device::Gpu)
            }
            (word, _) => adapter("device", word).map(Device::Gpu),
        }
    }
}

/// The best GPU.
fn gpu(adapters: &[Adapter]) -> Result<usize> {
    adapters::best(adapters, false).ok_or_else(|| {
        let software = adapters.iter().position(|adapter| adapter.kind == Kind::Software);
        let found = software.map_or(String::new(), |i| {
            let name = &adapters[i].name;
            format!(" There is a software rasteriser, {name:?}, which device=\"gpu:{i}\" uses.")
        });
        let why = without_gpu(adapters).join(" ");
        Error::Device(format!("device=\"gpu\": no GPU was found. {why}{found} device=\"cpu\" needs none."))
    })
}

/// Why no GPU is taken, where that is so: what this machine lacks, and what `CUDA_VISIBLE_DEVICES` hides or is not
/// heeded for.
pub fn without_gpu(adapters: &[Adapter]) -> Vec<String> {
    let visible = Visible::here();
    let is_gpu = |(_, adapter): &(usize, &Adapter)| adapter.kind != Kind::Software;
    let gpus: Vec<_> = adapters.iter().enumerate().filter(is_gpu).collect();
    let mut why = if gpus.is_empty() { machine::missing() } else { Vec::new() };
    for (i, adapter) in gpus.iter().filter(|(_, adapter)| adapter.place_in(&visible).is_none()) {
        why.push(format!("CUDA_VISIBLE_DEVICES hides gpu:{i} ({}), unless it is named.", adapter.name));
    }
    if let Visible::Unknown(reason) = visible {
        why.push(format!("{reason}."));
    }
    why
}

/// The adapter that a word denotes: by its number after "gpu:", its name, or a part of the name that no other has.
fn adapter(argument: &str, word: &str) -> Result<usize> {
    let adapters = adapters::all();
    let names = || {
        let all = adapters.iter().enumerate();
        let all: Vec<String> = all.map(|(i, adapter)| format!("\"gpu:{i}\" ({})", adapter.name)).collect();
        if all.is_empty() { "there is no adapter".to_owned() } else { format!("there is {}", all.join(", ")) }
    };
    if let Some(number) = word.strip_prefix("gpu:") {
        let number: usize =
            number.parse().map_err(|_| value_error!("{argument} must be like \"gpu:1\"; got {word:?}"))?;
        return (number < adapters.len())
            .then_some(number)
            .ok_or_else(|| Error::Device(format!("{argument}: there is no {word:?}; {}", names())));
    }
    let lower = word.to_lowercase();
    let matching = |matches: &dyn Fn(&str) -> bool| -> Vec<usize> {
        let all = adapters.iter().enumerate();
        all.filter(|(_, adapter)| matches(&adapter.name.to_lowercase())).map(|(i, _)| i).collect()
    };
    let exact = matching(&|name| name == lower);
    // One adapter may be listed more than once, by several drivers.
    if let Some(&first) = exact.first() {
        return Ok(first);
    }
    match matching(&|name| !lower.is_empty() && name.contains(&lower)).as_slice() {
        [one] => Ok(*one),
        _ => Err(value_error!(
            "{argument} must be \"auto\", \"cpu\", \"gpu\" or an adapter; got {word:?}, and {}",
            names()
        )),
    }
}
