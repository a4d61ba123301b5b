//! What is kept on a device from one render of a scene to the next.

use super::commands::Commands;
use super::device::Gpu;
use super::lens::Cells;
use super::process::OfProcess;
use super::sprites::Table;
use crate::cpu::lens::Sheets;
use crate::error::Result;
use crate::picture::{Layer, Picture, Size};
use crate::plan::sprites::Settings;
use std::ops::{Range, RangeInclusive};
use std::sync::{Arc, Mutex, PoisonError};

/// Some rows of a picture on a device.
pub struct Resident {
    gpu: Arc<Gpu>,
    /// What they were taken from, and which they are.
    source: Arc<Picture>,
    rows: Range<usize>,
    pub size: Size,
    /// How many layers there are.
    pub layers: usize,
    /// Colour planes of all layers.
    pub color: wgpu::Buffer,
    /// Disparity of the front layer.
    pub disparity: wgpu::Buffer,
    /// The least and the greatest of all rows of the picture.
    pub disparity_range: [f32; 2],
}

impl Resident {
    /// Takes rows to a device; their colour may be there already, for another focus surface.
    fn new(
        gpu: &Arc<Gpu>,
        source: &Arc<Picture>,
        rows: &Range<usize>,
        color: Option<wgpu::Buffer>,
    ) -> Result<Resident> {
        let (size, layers) = (source.size, &source.layers);
        let pixels = rows.start * size.width..rows.end * size.width;
        let disparity = gpu.upload("its depth", &layers[0].disparity[pixels.clone()])?;
        let color = match (color, layers.as_slice()) {
            (Some(color), _) => color,
            (None, [one]) if rows.len() == size.height => gpu.upload("the picture", &one.color)?,
            (None, layers) => {
                let planes = |layer: &'_ Layer| {
                    layer.color.chunks(size.pixels()).map(|p| p[pixels.clone()].to_vec()).collect::<Vec<_>>()
                };
                gpu.upload("the picture", &layers.iter().flat_map(planes).collect::<Vec<_>>().concat())?
            }
        };
        Ok(Resident {
            gpu: Arc::clone(gpu),
            source: Arc::clone(source),
            rows: rows.clone(),
            size: Size { height: rows.len(), ..size },
            layers: layers.len(),
            color,
            disparity,
            disparity_range: layers[0].disparity_range(),
        })
    }

    /// Whether the colours of a picture's rows are these.
    fn has_colors_of(&self, gpu: &Arc<Gpu>, picture: &Picture, rows: &Range<usize>) -> bool {
        let layers = self.source.layers.iter().zip(&picture.layers);
        Arc::ptr_eq(&self.gpu, gpu)
            && self.rows == *rows
            && layers.into_iter().all(|(own, other)| Arc::ptr_eq(&own.color, &other.color))
    }

    /// These channels alone, for one job.
    pub fn of_channels(&self, commands: &mut Commands, channels: &[usize]) -> Result<Resident> {
        let plane = self.size.pixels() * size_of::<f32>();
        let count = self.layers * channels.len();
        let color = commands.scratch::<f32>("some channels of the picture", count * self.size.pixels())?;
        let from = (0..self.layers).flat_map(|l| channels.iter().map(move |c| l * self.size.channels + c));
        for (to, from) in from.enumerate() {
            commands.copy_part(&self.color, from * plane, &color, to * plane, plane);
        }
        Ok(Resident {
            gpu: Arc::clone(&self.gpu),
            source: Arc::clone(&self.source),
            rows: self.rows.clone(),
            size: Size { channels: channels.len(), ..self.size },
            color,
            disparity: self.disparity.clone(),
            ..*self
        })
    }
}

/// Some rows of sheets on a device.
struct OnDevice {
    gpu: Arc<Gpu>,
    source: Arc<Sheets>,
    rows: Range<usize>,
    /// Those rows.
    sheets: Arc<Sheets>,
    cells: Arc<Cells>,
}

/// Sprites on a device.
struct SpritesOnDevice {
    gpu: Arc<Gpu>,
    table: Arc<Table>,
}

/// Places for things on a device.
struct Slots<T>(Mutex<Vec<OfProcess<Arc<T>>>>);

impl<T> Default for Slots<T> {
    fn default() -> Slots<T> {
        Slots(Mutex::default())
    }
}

impl<T> Slots<T> {
    fn find(&self, fits: impl Fn(&T) -> bool) -> Option<Arc<T>> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().filter_map(OfProcess::get).find(|kept| fits(kept)).map(Arc::clone)
    }

    /// What is there if it fits, else what is made anew and stays there, together with `count - 1` others.
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
        // What has been there the longest makes room first.
        let surplus = (kept().len() + 1).saturating_sub(count);
        let gone: Vec<_> = kept().drain(..surplus).collect();
        drop(gone);
        let made = Arc::new(make()?);
        kept().push(OfProcess::new(Arc::clone(&made)));
        Ok(made)
    }
}

/// Where a scene's picture, its sheets and the sprites for it are kept, once they have been asked for.
#[derive(Default)]
pub struct Residence {
    pictures: Slots<Resident>,
    sheets: Slots<OnDevice>,
    sprites: Slots<SpritesOnDevice>,
}

impl Residence {
    /// Rows of the picture on this device, taken there on the first call; there are `count` such bands of it.
    pub fn picture(
        &self,
        gpu: &Arc<Gpu>,
        picture: &Arc<Picture>,
        rows: &Range<usize>,
        count: usize,
    ) -> Result<Arc<Resident>> {
        let fits = |own: &Resident| {
            Arc::ptr_eq(&own.gpu, gpu) && Arc::ptr_eq(&own.source, picture) && own.rows == *rows
        };
        let color = self.pictures.find(|own| own.has_colors_of(gpu, picture, rows));
        let color = color.map(|own| own.color.clone());
        self.pictures.get(count, fits, || gpu.guarded(|| Resident::new(gpu, picture, rows, color)))
    }

    /// Rows of these sheets and their cells on this device, taken there on the first call; there are `count` such bands.
    pub fn cells(
        &self,
        gpu: &Arc<Gpu>,
        source: &Arc<Sheets>,
        rows: &Range<usize>,
        count: usize,
    ) -> Result<(Arc<Sheets>, Arc<Cells>)> {
        let fits = |own: &OnDevice| {
            Arc::ptr_eq(&own.gpu, gpu) && Arc::ptr_eq(&own.source, source) && own.rows == *rows
        };
        let make = || {
            let whole = rows.len() == source.size.height;
            let sheets = if whole { Arc::clone(source) } else { Arc::new(source.rows(rows.clone())) };
            let cells = Arc::new(gpu.guarded(|| Cells::new(gpu, &sheets))?);
            Ok(OnDevice {
                gpu: Arc::clone(gpu),
                source: Arc::clone(source),
                rows: rows.clone(),
                sheets,
                cells,
            })
        };
        let own = self.sheets.get(count, fits, make)?;
        Ok((Arc::clone(&own.sheets), Arc::clone(&own.cells)))
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
        Ok(Arc::clone(&self.sprites.get(1, fits, make)?.table))
    }
}
