//! `dofsim.devices`, and the names of devices.

use crate::device::{Device, without_gpu};
use crate::gpu::visible::Visible;
use crate::gpu::{self, Restrictions, adapters};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::Duration;

/// The environment variable that determines the meaning of "auto" and "gpu".
const VARIABLE: &str = "DOFSIM_DEVICE";

/// An adapter that can be computed on; `devices` lists them.
///
/// Attributes
/// ----------
/// id : str
///     ``"gpu:0"`` and so on, to be given as `device`.
/// name : str
///     What it is called; it can be given as `device` too.
/// kind : {"discrete", "integrated", "virtual", "software", "other"}
///     Of what make it is. A software rasteriser does the work on the CPU.
/// backend : {"vulkan", "metal", "dx12"}
///     The interface that it is reached by.
/// driver : str
///     Its driver.
/// pci_bus_id : str
///     Where it is on the PCI bus, like ``"0000:41:00.0"``; empty if the driver does not say.
/// visible : bool
///     Whether ``"auto"`` and ``"gpu"`` may choose it: the environment variable ``CUDA_VISIBLE_DEVICES`` does not hide it.
/// memory_bytes : int or None
///     Its memory, if the driver says so.
/// measures_time : bool
///     Whether `Scene.profile` has times.
/// max_buffer_bytes, max_binding_bytes : int
///     The largest buffer, and how much of one a pass can see.
#[pyclass(name = "Device", module = "dofsim", frozen, eq, get_all)]
#[derive(Debug, Clone, PartialEq)]
pub struct PyDevice {
    id: String,
    name: String,
    kind: &'static str,
    backend: String,
    driver: String,
    pci_bus_id: String,
    visible: bool,
    memory_bytes: Option<u64>,
    measures_time: bool,
    max_buffer_bytes: u64,
    max_binding_bytes: u64,
}

#[pymethods]
impl PyDevice {
    fn __repr__(&self) -> String {
        let PyDevice { id, name, kind, backend, .. } = self;
        format!("<dofsim.Device {id}: {name} ({kind}, {backend})>")
    }
}

/// A list of the GPUs of this machine, and of software rasterisers.
///
/// Returns
/// -------
/// list of Device
///     In the order of their numbers; empty if no driver is installed. They are looked for once a process.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> real = [device.name for device in dofsim.devices() if device.kind != "software"]
#[pyfunction]
pub fn devices(py: Python<'_>) -> Vec<PyDevice> {
    let all = py.detach(adapters::all);
    let visible = Visible::here();
    let device = |(i, adapter): (usize, &adapters::Adapter)| PyDevice {
        id: format!("gpu:{i}"),
        name: adapter.name.clone(),
        kind: adapter.kind.name(),
        backend: adapter.backend.clone(),
        driver: adapter.driver.clone(),
        pci_bus_id: adapter.pci_bus_id.clone(),
        visible: adapter.place_in(&visible).is_some(),
        memory_bytes: adapter.memory_bytes,
        measures_time: adapter.measures_time,
        max_buffer_bytes: adapter.max_buffer_bytes,
        max_binding_bytes: adapter.max_binding_bytes,
    };
    all.iter().enumerate().map(device).collect()
}

/// The device that an argument names.
pub fn read_device(py: Python<'_>, name: &str) -> PyResult<Device> {
    let preset = std::env::var(VARIABLE).ok().filter(|preset| !preset.is_empty());
    Ok(py.detach(|| Device::named(name, preset.as_deref()))?)
}

/// The device that a name stands for here.
///
/// Parameters
/// ----------
/// name : str
///     As given as `device`.
///
/// Returns
/// -------
/// str
///     ``"cpu"``, or the ``id`` of one of `devices`.
#[pyfunction]
pub fn chosen_device(py: Python<'_>, name: &str) -> PyResult<String> {
    Ok(read_device(py, name)?.id())
}

/// Why no GPU is chosen by itself, where that is so.
///
/// Returns
/// -------
/// list of str
///     A sentence for each thing that this machine lacks, and for each GPU that the environment hides.
#[pyfunction]
pub fn lacking_for_gpu(py: Python<'_>) -> Vec<String> {
    py.detach(|| without_gpu(&adapters::all()))
}

/// Open devices anew with no more than this, until the next call: for tests of what smaller devices do.
///
/// Parameters
/// ----------
/// max_binding_bytes : int, optional
///     How much of a buffer one pass can see; by default what the adapter allows.
/// memory_bytes : int, optional
///     The memory for which bands are planned; by default what the driver says.
/// room_bytes : int, optional
///     The memory beyond which nothing can be allocated.
/// submission_s : float, optional
///     The time that one submission should take.
/// quotient : float, optional
///     A factor by which all quotients of shaders are off, in builds with the feature ``test-shaders``.
#[pyfunction]
#[pyo3(signature = (*, max_binding_bytes=None, memory_bytes=None, room_bytes=None, submission_s=None, quotient=None))]
pub fn restrict_devices(
    max_binding_bytes: Option<u64>,
    memory_bytes: Option<u64>,
    room_bytes: Option<u64>,
    submission_s: Option<f64>,
    quotient: Option<f32>,
) -> PyResult<()> {
    let none = Restrictions::NONE;
    let submission = submission_s.map(Duration::try_from_secs_f64).transpose();
    let submission = submission.map_err(|error| PyValueError::new_err(format!("submission_s: {error}")))?;
    if let Some(quotient) = quotient.filter(|quotient| !quotient.is_finite()) {
        return Err(PyValueError::new_err(format!("quotient must be finite; got {quotient}")));
    }
    if !cfg!(feature = "test-shaders") && quotient.is_some() {
        return Err(PyValueError::new_err("quotient: dofsim was built without the feature test-shaders"));
    }
    gpu::restrict(Restrictions {
        most_bytes: max_binding_bytes.unwrap_or(none.most_bytes),
        memory_bytes,
        room_bytes,
        submission: submission.unwrap_or(none.submission),
        #[cfg(feature = "test-shaders")]
        quotient: quotient.unwrap_or(none.quotient),
    });
    Ok(())
}

/// Give back the memory of devices in which nothing is kept.
///
/// A device keeps the memory of the last picture for the next one. It is given back after some seconds in which nothing is
/// rendered, and by this function at once. What a `Scene` keeps on a device stays there as long as the scene.
///
/// Examples
/// --------
/// >>> import dofsim
/// >>> dofsim.release_devices()
#[pyfunction]
pub fn release_devices(py: Python<'_>) {
    py.detach(gpu::release);
}

/// How much memory the devices of this process have allocated.
///
/// Returns
/// -------
/// int
///     Bytes; 0 where drivers cannot be asked.
#[pyfunction]
pub fn device_bytes(py: Python<'_>) -> u64 {
    py.detach(gpu::allocated_bytes)
}

/// What was submitted to the devices that are open.
///
/// Returns
/// -------
/// tuple of int and float
///     The number of submissions, and the seconds of the longest one whose end was waited for.
#[pyfunction]
pub fn device_submissions() -> (u64, f64) {
    let measured = gpu::submissions();
    (measured.submissions, measured.longest_s)
}

/// What went from this process to devices and back so far.
///
/// Returns
/// -------
/// dict of str to int
///     ``uploaded_bytes``, ``downloaded_bytes``, ``readbacks`` (how often something came back) and ``submissions``.
#[pyfunction]
pub fn device_traffic(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let traffic = gpu::traffic();
    let counts = PyDict::new(py);
    counts.set_item("uploaded_bytes", traffic.uploaded_bytes)?;
    counts.set_item("downloaded_bytes", traffic.downloaded_bytes)?;
    counts.set_item("readbacks", traffic.readbacks)?;
    counts.set_item("submissions", traffic.submissions)?;
    Ok(counts)
}
