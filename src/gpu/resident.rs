//! What is kept on a device from one render of a scene to the next.

use super::device::Gpu;
use super::lens::Cells;
use super::process::OfProcess;
use super::sprites::Table;
use crate::cpu::lens::Sheets;
use crate::error::Result;
use crate::picture::{Picture, Size};
use crate::plan::sprites::Settings;
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex, PoisonError};

/// A picture on a device.
pub struct Resident {
    gpu: Arc<Gpu>,
    pub size: Size,
    /// How many layers there are.
    pub layers: usize,
    /// Colour planes of all layers.
    pub color: wgpu::Buffer,
    /// Disparity of the front layer.
    pub disparity: wgpu::Buffer,
    /// The least and the greatest of them.
    pub disparity_range: [f32; 2],
}

impl Resident {
    fn new(gpu: &Arc<Gpu>, picture: &Picture) -> Result<Resident> {
        let color = match picture.layers.as_slice() {
            [one] => gpu.upload("the picture", &one.color),
            layers => {
                let all: Vec<&[f32]> = layers.iter().map(|layer| layer.color.as_slice()).collect();
                gpu.upload("the picture", &all.concat())
            }
        }?;
        let disparity = gpu.upload("its depth", &picture.layers[0].disparity)?;
        Ok(Resident {
            gpu: Arc::clone(gpu),
            size: picture.size,
            layers: picture.layers.len(),
            color,
            disparity,
            disparity_range: picture.layers[0].disparity_range(),
        })
    }
}

/// Sheets on a device.
struct OnDevice {
    gpu: Arc<Gpu>,
    sheets: Arc<Sheets>,
    cells: Arc<Cells>,
}

/// A place for one thing on a device.
struct Slot<T>(Mutex<Option<OfProcess<Arc<T>>>>);

impl<T> Default for Slot<T> {
    fn default() -> Slot<T> {
        Slot(Mutex::new(None))
    }
}

impl<T> Slot<T> {
    /// What is there if it fits, else what is made anew and stays there.
    fn get(&self, fits: impl FnOnce(&T) -> bool, make: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let at_hand = kept().as_ref().and_then(OfProcess::get).map(Arc::clone);
        if let Some(at_hand) = at_hand.filter(|at_hand| fits(at_hand)) {
            return Ok(at_hand);
        }
        // What no longer fits makes room first.
        *kept() = None;
        let made = Arc::new(make()?);
        *kept() = Some(OfProcess::new(Arc::clone(&made)));
        Ok(made)
    }
}

/// Sprites on a device.
struct SpritesOnDevice {
    gpu: Arc<Gpu>,
    table: Arc<Table>,
}

/// Where a scene's picture, its sheets and the sprites for it are kept, once they have been asked for.
#[derive(Default)]
pub struct Residence {
    picture: Slot<Resident>,
    sheets: Slot<OnDevice>,
    sprites: Slot<SpritesOnDevice>,
}

impl Residence {
    /// The picture on this device, taken there on the first call.
    pub fn picture(&self, gpu: &Arc<Gpu>, picture: &Picture) -> Result<Arc<Resident>> {
        let fits = |resident: &Resident| Arc::ptr_eq(&resident.gpu, gpu);
        self.picture.get(fits, || gpu.guarded(|| Resident::new(gpu, picture)))
    }

    /// The cells of these sheets on this device, taken there on the first call.
    pub fn cells(&self, gpu: &Arc<Gpu>, sheets: &Arc<Sheets>) -> Result<Arc<Cells>> {
        let fits = |own: &OnDevice| Arc::ptr_eq(&own.gpu, gpu) && Arc::ptr_eq(&own.sheets, sheets);
        let make = || {
            let cells = Arc::new(gpu.guarded(|| Cells::new(gpu, sheets))?);
            Ok(OnDevice { gpu: Arc::clone(gpu), sheets: Arc::clone(sheets), cells })
        };
        Ok(Arc::clone(&self.sheets.get(fits, make)?.cells))
    }

    /// The sprites of these steps on this device, and perhaps of more.
    pub fn sprites(
        &self,
        gpu: &Arc<Gpu>,
        settings: &Settings,
        steps: &RangeInclusive<i32>,
    ) -> Result<Arc<Table>> {
        let fits = |own: &SpritesOnDevice| Arc::ptr_eq(&own.gpu, gpu) && own.table.holds(settings, steps);
        let make = || {
            let table = Arc::new(Table::new(gpu, settings, steps.clone())?);
            Ok(SpritesOnDevice { gpu: Arc::clone(gpu), table })
        };
        Ok(Arc::clone(&self.sprites.get(fits, make)?.table))
    }
}
