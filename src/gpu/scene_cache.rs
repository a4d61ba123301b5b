//! The data that a device keeps from one render of a scene to the next.

use super::commands::Commands;
use super::device::Gpu;
use super::lens::Cells;
use super::picture::GpuPicture;
use super::process_local::ProcessLocal;
use super::sprites::Table;
use crate::error::Result;
use crate::picture::Picture;
use crate::plan::sprites::Settings;
use crate::scene::layered::LayeredScene;
use crate::simd::Simd;
use std::ops::{Range, RangeInclusive};
use std::sync::{Arc, Mutex, PoisonError};

/// Some rows of layers on a device.
struct OnDevice {
    gpu: Arc<Gpu>,
    source: Arc<LayeredScene>,
    rows: Range<usize>,
    /// The rows.
    layers: Arc<LayeredScene>,
    cells: Arc<Cells>,
}

/// Sprites on a device.
struct SpritesOnDevice {
    gpu: Arc<Gpu>,
    table: Arc<Table>,
}

/// A cache of values on a device.
struct Slots<T>(Mutex<Vec<ProcessLocal<Arc<T>>>>);

impl<T> Default for Slots<T> {
    fn default() -> Slots<T> {
        Slots(Mutex::default())
    }
}

impl<T> Slots<T> {
    fn find(&self, fits: impl Fn(&T) -> bool) -> Option<Arc<T>> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().filter_map(ProcessLocal::get).find(|kept| fits(kept)).map(Arc::clone)
    }

    fn clear(&self) {
        let gone = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        // It is freed after the lock has been released.
        drop(gone);
    }

    /// The cached value that fits, or else a new one, which is then kept together with `count - 1` others.
    fn get(
        &self,
        count: usize,
        fits: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<Arc<T>> {
        if let Some(at_hand) = self.find(fits) {
            return Ok(at_hand);
        }
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // The oldest entries make room first.
        let surplus = (kept().len() + 1).saturating_sub(count);
        let gone: Vec<_> = kept().drain(..surplus).collect();
        drop(gone);
        let made = Arc::new(make()?);
        kept().push(ProcessLocal::new(Arc::clone(&made)));
        Ok(made)
    }
}

/// The cache of a scene's picture, its layers, and the sprites for it. Each is filled when first needed.
#[derive(Default)]
pub struct SceneCache {
    pictures: Slots<GpuPicture>,
    layers: Slots<OnDevice>,
    sprites: Slots<SpritesOnDevice>,
}

impl SceneCache {
    /// Gives back all that devices keep.
    pub fn clear(&self) {
        self.pictures.clear();
        self.layers.clear();
        self.sprites.clear();
    }

    /// Rows of the picture on this device, uploaded by the first call. The picture has `count` such bands.
    pub fn picture(
        &self,
        gpu: &Arc<Gpu>,
        picture: &Arc<Picture>,
        rows: &Range<usize>,
        count: usize,
    ) -> Result<Arc<GpuPicture>> {
        let fits = |own: &GpuPicture| own.is_of(gpu, picture, rows);
        let color = self.pictures.find(|own| own.has_colors_of(gpu, picture, rows));
        let color = color.map(|own| own.color.clone());
        self.pictures.get(count, fits, || gpu.guarded(|| GpuPicture::new(gpu, picture, rows, color)))
    }

    /// Rows of these layers and their cells on the device, where the picture has the same rows; made by the first call.
    /// There are `count` such bands.
    pub fn cells(
        &self,
        commands: &mut Commands,
        picture: &GpuPicture,
        source: &Arc<LayeredScene>,
        (rows, count): (&Range<usize>, usize),
        simd: Simd,
    ) -> Result<(Arc<LayeredScene>, Arc<Cells>)> {
        let gpu = commands.gpu;
        let fits = |own: &OnDevice| {
            Arc::ptr_eq(&own.gpu, gpu) && Arc::ptr_eq(&own.source, source) && own.rows == *rows
        };
        let make = || {
            let whole = rows.len() == source.size.height;
            let layers = if whole { Arc::clone(source) } else { Arc::new(source.rows(rows.clone(), simd)) };
            let cells = Arc::new(gpu.guarded(|| Cells::new(commands, picture, source, rows))?);
            Ok(OnDevice {
                gpu: Arc::clone(gpu),
                source: Arc::clone(source),
                rows: rows.clone(),
                layers,
                cells,
            })
        };
        let own = self.layers.get(count, fits, make)?;
        Ok((Arc::clone(&own.layers), Arc::clone(&own.cells)))
    }

    /// The sprites of at least these steps on this device.
    pub fn sprites(
        &self,
        gpu: &Arc<Gpu>,
        settings: &Settings,
        steps: &RangeInclusive<i32>,
    ) -> Result<Arc<Table>> {
        let fits = |own: &SpritesOnDevice| Arc::ptr_eq(&own.gpu, gpu) && own.table.holds(settings, steps);
        let make = || {
            let table = Arc::new(Table::new(gpu, settings, steps)?);
            Ok(SpritesOnDevice { gpu: Arc::clone(gpu), table })
        };
        Ok(Arc::clone(&self.sprites.get(1, fits, make)?.table))
    }
}
