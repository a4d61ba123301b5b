//! A picture that is kept on a device.

use super::device::Gpu;
use super::process::OfProcess;
use crate::error::Result;
use crate::picture::{Picture, Size};
use std::sync::{Arc, Mutex, PoisonError};

/// The front layer of a picture on a device.
pub struct Resident {
    gpu: Arc<Gpu>,
    pub size: Size,
    /// Colour planes.
    pub color: wgpu::Buffer,
    pub disparity: wgpu::Buffer,
}

/// Where the picture of a scene is kept, if it has been asked for.
#[derive(Default)]
pub struct Residence(Mutex<Option<OfProcess<Arc<Resident>>>>);

impl Residence {
    /// The picture on this device, taken there on the first call.
    pub fn on(&self, gpu: &Arc<Gpu>, picture: &Picture) -> Result<Arc<Resident>> {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand = kept().as_ref().and_then(OfProcess::get).map(Arc::clone);
        if let Some(resident) = at_hand.filter(|resident| Arc::ptr_eq(&resident.gpu, gpu)) {
            return Ok(resident);
        }
        let front = &picture.layers[0];
        let resident = gpu.guarded(|| {
            Ok(Arc::new(Resident {
                gpu: Arc::clone(gpu),
                size: picture.size,
                color: gpu.upload("the picture", &front.color)?,
                disparity: gpu.upload("its depth", &front.disparity)?,
            }))
        })?;
        *kept() = Some(OfProcess::new(Arc::clone(&resident)));
        Ok(resident)
    }
}
