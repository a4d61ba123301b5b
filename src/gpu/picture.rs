//! A picture on a device.

use super::commands::Commands;
use super::device::Gpu;
use crate::error::Result;
use crate::memory::Buffer;
use crate::picture::{ChannelGroup, Picture, Size};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Some rows of a picture on a device.
pub struct GpuPicture {
    gpu: Arc<Gpu>,
    /// The picture and the rows of it that are on the device.
    source: Arc<Picture>,
    rows: Range<usize>,
    pub size: Size,
    /// Number of layers.
    pub layers: usize,
    /// Colour planes of all layers.
    pub color: wgpu::Buffer,
    /// Disparity of the front layer, uploaded when first needed.
    disparity: Arc<OnceLock<wgpu::Buffer>>,
    /// The least and the greatest disparity of all rows of the picture.
    pub disparity_range: [f32; 2],
}

impl GpuPicture {
    /// Uploads rows to a device. Their colours may be there already, uploaded for another focus surface.
    pub fn new(
        gpu: &Arc<Gpu>,
        source: &Arc<Picture>,
        rows: &Range<usize>,
        color: Option<wgpu::Buffer>,
    ) -> Result<GpuPicture> {
        let (size, layers) = (source.size, &source.layers);
        let planes: Vec<_> = layers.iter().map(|layer| &layer.color).collect();
        let color = color.map_or_else(|| upload(gpu, "the picture", &planes, size, rows), Ok)?;
        Ok(GpuPicture {
            gpu: Arc::clone(gpu),
            source: Arc::clone(source),
            rows: rows.clone(),
            size: Size { height: rows.len(), ..size },
            layers: layers.len(),
            color,
            disparity: Arc::default(),
            disparity_range: layers[0].disparity_range(),
        })
    }

    /// Disparity of the front layer.
    pub fn disparity(&self) -> Result<wgpu::Buffer> {
        if let Some(at_hand) = self.disparity.get() {
            return Ok(at_hand.clone());
        }
        let Range { start, end } = self.rows;
        let rows = start * self.size.width..end * self.size.width;
        let new = self.gpu.upload("the picture's depth", &self.source.layers[0].disparity[rows])?;
        Ok(self.disparity.get_or_init(|| new).clone())
    }

    /// The coverage of all rows of the picture in each of several layers; one layer covers all.
    pub fn coverage(&self) -> Vec<&[f32]> {
        self.source.coverage()
    }

    /// The groups of channels that the picture carries.
    pub fn carried(&self) -> &[ChannelGroup] {
        &self.source.carried
    }

    /// Uploads the planes of all layers of group number `g` of the channels that the picture carries.
    pub fn upload_carried(&self, g: usize) -> Result<wgpu::Buffer> {
        let layers: Vec<_> = self.source.carried[g].layers.iter().collect();
        upload(&self.gpu, "channels", &layers, self.source.size, &self.rows)
    }

    /// Whether these are the given rows of the picture.
    pub fn is_of(&self, gpu: &Arc<Gpu>, picture: &Arc<Picture>, rows: &Range<usize>) -> bool {
        Arc::ptr_eq(&self.gpu, gpu) && Arc::ptr_eq(&self.source, picture) && self.rows == *rows
    }

    /// Whether these are the colours of the given rows of a picture.
    pub fn has_colors_of(&self, gpu: &Arc<Gpu>, picture: &Picture, rows: &Range<usize>) -> bool {
        let layers = self.source.layers.iter().zip(&picture.layers);
        Arc::ptr_eq(&self.gpu, gpu)
            && self.rows == *rows
            && layers.into_iter().all(|(own, other)| Arc::ptr_eq(&own.color, &other.color))
    }

    /// Only these channels, for one job.
    pub fn of_channels(&self, commands: &mut Commands, channels: &[usize]) -> Result<GpuPicture> {
        let plane = self.size.pixels() * size_of::<f32>();
        let count = self.layers * channels.len();
        let color = commands.scratch::<f32>("some channels of the picture", count * self.size.pixels())?;
        let from = (0..self.layers).flat_map(|l| channels.iter().map(move |c| l * self.size.channels + c));
        for (to, from) in from.enumerate() {
            commands.copy_part(&self.color, from * plane, &color, to * plane, plane);
        }
        Ok(GpuPicture {
            gpu: Arc::clone(&self.gpu),
            source: Arc::clone(&self.source),
            rows: self.rows.clone(),
            size: Size { channels: channels.len(), ..self.size },
            color,
            disparity: Arc::clone(&self.disparity),
            ..*self
        })
    }
}

/// Uploads some rows of the planes of layers.
fn upload(
    gpu: &Gpu,
    what: &'static str,
    layers: &[&Arc<Buffer<f32>>],
    size: Size,
    rows: &Range<usize>,
) -> Result<wgpu::Buffer> {
    if let ([one], true) = (layers, rows.len() == size.height) {
        return gpu.upload(what, one);
    }
    let pixels = rows.start * size.width..rows.end * size.width;
    let planes = layers.iter().flat_map(|layer| layer.chunks(size.pixels()));
    gpu.upload(what, &planes.map(|plane| &plane[pixels.clone()]).collect::<Vec<_>>().concat())
}
