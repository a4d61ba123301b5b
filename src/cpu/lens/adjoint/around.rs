//! The cells around a tile, in arrays of their own: how the picture changes from each to the next, and what is added to them.

use super::met::Met;
use super::window::{Target, Window};
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::lanes::FLOATS;
use crate::scene::grid::TILE;

/// All layers around a tile.
pub struct Around {
    channels: usize,
    /// Cells from one row to the next, and in front of the tile's first column and row.
    pub stride: usize,
    margin: usize,
    rows: usize,
    /// The place of the first cell in the padded frame.
    first: usize,
    pub layers: Vec<Layer>,
}

/// The cells of one layer around a tile.
#[derive(Default)]
pub struct Layer {
    /// Whether any cell is there.
    is_there: bool,
    /// The shift of the middle of each cell's span, and the depth codes that it spans.
    pub t: Vec<f32>,
    pub span: Vec<(u16, u16)>,
    /// A plane for each channel.
    pub color: Vec<Vec<f32>>,
    /// By how much the next cell along each axis differs, where the surface goes on.
    pub slopes: [Vec<Vec<f32>>; 2],
    /// A bit for each axis along which the next cell is of another surface.
    pub ends: Vec<u8>,
    /// What is added, a plane for each channel.
    pub by_color: Vec<Vec<f32>>,
    pub by_shift: Vec<f32>,
}

/// Whether two cells, `between` of which lie between them, are of one surface: their spans touch, or would with the slope
/// that they have.
pub fn is_one_surface((lo_a, hi_a): (u16, u16), (lo_b, hi_b): (u16, u16), between: u32) -> bool {
    let span = u32::from((hi_a - lo_a).max(hi_b - lo_b));
    let reach = |hi: u16| u32::from(hi) + between * span + 1;
    u32::from(lo_a) <= reach(hi_b) && u32::from(lo_b) <= reach(hi_a)
}

/// Makes a plane of zeros.
fn clear(plane: &mut Vec<f32>, len: usize) {
    plane.clear();
    plane.resize(len, 0.0);
}

impl Around {
    pub fn new(channels: usize, layers: usize) -> Around {
        let layers = (0..layers).map(|_| Layer::default()).collect();
        Around { channels, stride: 0, margin: 0, rows: 0, first: 0, layers }
    }

    /// Takes the cells that are at most `reach` columns or rows away from the tile at `origin`, with nothing added to them.
    pub fn take(&mut self, frame: &Frame, origin: (usize, usize), reach: usize) {
        // The cells beside them tell how the picture changes.
        self.margin = (reach + 1).min(frame.padded.padding.pad);
        (self.stride, self.rows) = (TILE.0 + 2 * self.margin, TILE.1 + 2 * self.margin);
        let padding = &frame.padded.padding;
        self.first = padding.index(origin.0, origin.1) - self.margin * (padding.stride + 1);
        let len = self.stride * self.rows + FLOATS;
        for layer in &mut self.layers {
            layer.is_there = false;
            layer.by_color.resize(self.channels, Vec::new());
            layer.by_color.iter_mut().for_each(|plane| clear(plane, len));
            clear(&mut layer.by_shift, len);
        }
    }

    /// Where a pixel of the tile, and what it has met, is in the arrays.
    #[inline(always)]
    pub fn index(&self, pixel: usize, met: Met) -> usize {
        let [across, down] = met.away();
        let at = (pixel / TILE.0 + self.margin) * self.stride + pixel % TILE.0 + self.margin;
        at.wrapping_add_signed(down as isize * self.stride as isize + across as isize)
    }

    /// Finds shifts, and how the picture changes from cell to cell.
    pub fn find_slopes(&mut self, frame: &Frame) {
        let padded = &frame.padded;
        let step = padded.codes.step() as f32;
        let t_at_0 = (padded.codes.decode(0.0) - frame.s_focus) as f32;
        let (stride, rows) = (self.stride, self.rows);
        for (layer, from) in self.layers.iter_mut().zip(&padded.layers) {
            let row_of = |y: usize| self.first + y * padded.padding.stride;
            layer.span.clear();
            for y in 0..rows {
                let (lo, hi) = (&from.lo[row_of(y)..][..stride], &from.hi[row_of(y)..][..stride]);
                layer.span.extend(lo.iter().copied().zip(hi.iter().copied()));
            }
            layer.span.resize(stride * rows + FLOATS, (0, 0));
            layer.is_there = layer.span.iter().any(|span| span.1 > 0);
            if !layer.is_there {
                continue;
            }
            let t = |&(lo, hi): &(u16, u16)| t_at_0 + step * 0.5 * (f32::from(lo) + f32::from(hi));
            layer.t.clear();
            layer.t.extend(layer.span.iter().map(t));
            layer.color.resize(self.channels, Vec::new());
            for (into, from) in layer.color.iter_mut().zip(&from.color) {
                into.clear();
                (0..rows).for_each(|y| into.extend_from_slice(&from[row_of(y)..][..stride]));
                into.resize(stride * rows + FLOATS, 0.0);
            }
            layer.find_slopes(stride);
        }
    }

    /// Adds what has been added to these cells to those of a window: the sums by colours, and behind these the one by shifts
    /// if it has a plane for them.
    pub fn add_to(&self, window: &mut Window) {
        let (first, stride) = (self.first - window.first_cell(), window.stride());
        for (number, layer) in self.layers.iter().enumerate() {
            let sums = layer.by_color.iter().chain([&layer.by_shift]);
            for (into, sums) in window.planes(Target::Swept(number)).iter_mut().zip(sums) {
                for (y, row) in sums.chunks_exact(self.stride).take(self.rows).enumerate() {
                    let into = &mut into[first + y * stride..][..self.stride];
                    into.iter_mut().zip(row).for_each(|(into, v)| *into += v);
                }
            }
        }
    }
}

impl Layer {
    fn find_slopes(&mut self, stride: usize) {
        let Layer { span, color, slopes, ends, .. } = self;
        let len = span.len();
        ends.clear();
        ends.resize(len, 0);
        for (axis, apart) in [1, stride].into_iter().enumerate() {
            slopes[axis].resize(color.len(), Vec::new());
            slopes[axis].iter_mut().for_each(|plane| clear(plane, len));
            for at in 0..len - FLOATS - apart {
                let (a, b) = (span[at], span[at + apart]);
                if a.1 == 0 || b.1 == 0 {
                    continue;
                }
                if is_one_surface(a, b, 0) {
                    for (slope, color) in slopes[axis].iter_mut().zip(&*color) {
                        slope[at] = color[at + apart] - color[at];
                    }
                } else {
                    ends[at] |= 1 << axis;
                }
            }
        }
    }
}
