//! Sheets on a device.

use crate::cpu::lens::{Sheet, Sheets};
use crate::error::Result;
use crate::gpu::commands::Bound::{Read, Write};
use crate::gpu::commands::{Commands, groups, pixels};
use crate::gpu::device::Gpu;
use crate::gpu::shader::{Shader, shader, shared};
use crate::memory;
use crate::picture::Size;
use rayon::prelude::*;
use std::sync::Arc;

pub const CHANNELS: Shader = shader!("lens/channels", [], [ChannelsParams]);

shared! {
    /// Of a choice of channels.
    struct ChannelsParams {
        size: [u32; 2],
        channels: [u32; 2],
    }
}

/// Stands for the shift of an empty cell, because shaders need not know of NaN.
const NOWHERE: f32 = 1e30;
/// Stands for the links of a sheet that has none.
const NO_LINKS: u8 = 128;
/// Values that one worker converts at a time.
const CHUNK: usize = 1 << 14;

/// The cells of all sheets, one sheet after another.
pub struct Cells {
    pub size: Size,
    /// How many sheets there are.
    pub sheets: usize,
    /// Depths: the farthest in the low half, the nearest in the high half.
    pub codes: wgpu::Buffer,
    pub shifts: wgpu::Buffer,
    /// Four bytes to a word.
    pub links: wgpu::Buffer,
    /// Four channels each.
    pub colors: wgpu::Buffer,
    /// For each cell 0 or one more than the number of its half-plane; then these, three words each.
    pub half_planes: wgpu::Buffer,
}

impl Cells {
    /// Takes sheets to a device.
    pub fn new(gpu: &Arc<Gpu>, sheets: &Sheets) -> Result<Cells> {
        let (size, n) = (sheets.size, sheets.size.pixels());
        let codes: Vec<u32> = sheets
            .depths
            .iter()
            .flat_map(|depths| {
                depths.lo.iter().zip(depths.hi.iter()).map(|(&lo, &hi)| u32::from(lo) | u32::from(hi) << 16)
            })
            .collect();
        let codes = gpu.upload("the depths of all cells", &codes)?;
        let shown = |s: &f32| if s.is_nan() { NOWHERE } else { *s };
        let shifts: Vec<f32> = sheets.sheets.iter().flat_map(|sheet| sheet.s.iter().map(shown)).collect();
        let shifts = gpu.upload("the shifts of all cells", &shifts)?;
        let mut links: Vec<u8> = Vec::with_capacity((n * sheets.sheets.len()).next_multiple_of(4));
        for sheet in &sheets.sheets {
            if sheet.links.is_empty() {
                links.resize(links.len() + n, NO_LINKS);
            } else {
                links.extend_from_slice(&sheet.links);
            }
        }
        let links = gpu.upload("the links between cells", &links)?;
        let mut colors: Vec<[f32; 4]> = memory::zeros(n * sheets.sheets.len());
        sheets.sheets.iter().zip(colors.chunks_mut(n)).for_each(|(sheet, out)| interleave(sheet, size, out));
        let colors = gpu.upload("the colours of all cells", &colors)?;
        let half_planes = gpu.upload("the half-planes of all cells", &half_planes(&sheets.sheets, n))?;
        Ok(Cells { size, sheets: sheets.sheets.len(), codes, shifts, links, colors, half_planes })
    }

    /// The same cells with one or two channels of their colours, for one job.
    pub fn of_channels(&self, commands: &mut Commands, channels: &[usize]) -> Result<Cells> {
        const NONE: u32 = 4;
        let colors = commands.scratch::<[f32; 4]>("some channels of all cells", self.len())?;
        let number = |i: usize| channels.get(i).map_or(NONE, |c| *c as u32);
        let params = ChannelsParams { size: pixels(self.size), channels: [number(0), number(1)] };
        let [across, down, _] = groups(self.size.width, self.size.height);
        let buffers = [Read(&self.colors), Write(&colors)];
        commands.pass(&CHANNELS, NONE as usize, &params, &buffers, [across, down, self.sheets as u32])?;
        Ok(Cells {
            size: Size { channels: channels.len(), ..self.size },
            sheets: self.sheets,
            codes: self.codes.clone(),
            shifts: self.shifts.clone(),
            links: self.links.clone(),
            colors,
            half_planes: self.half_planes.clone(),
        })
    }

    /// Cells of all sheets.
    pub fn len(&self) -> usize {
        self.sheets * self.size.pixels()
    }
}

/// The colours of a sheet, channels side by side.
fn interleave(sheet: &Sheet, size: Size, out: &mut [[f32; 4]]) {
    let planes = sheet.colors.to_planes();
    let planes: Vec<&[f32]> = planes.chunks(size.pixels()).collect();
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(i, out)| {
        for (x, color) in out.iter_mut().enumerate() {
            for (value, plane) in color.iter_mut().zip(&planes) {
                *value = plane[i * CHUNK + x];
            }
        }
    });
}

/// The words of the half-planes.
fn half_planes(sheets: &[Sheet], pixels: usize) -> Vec<u32> {
    let mut words = memory::zeros(sheets.len() * pixels);
    let mut planes: Vec<u32> = Vec::new();
    for (first, sheet) in (0..).step_by(pixels).zip(sheets) {
        for (index, plane) in sheet.partial.iter() {
            let [x, y] = plane.normal;
            planes.extend([x, y, plane.cut].map(f32::to_bits));
            words[first + index] = planes.len() as u32 / 3;
        }
    }
    words.extend(planes);
    words
}
