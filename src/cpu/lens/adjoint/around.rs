//! The cells around a tile, in arrays of their own: how the picture changes from each to the next, and what is added to them.
//!
//! A cell spans the depths from half-way to the farthest of its neighbours, its bottom, to half-way to the nearest one, its top.

use super::job::Asked;
use super::met::Met;
use super::plane_set::PlaneSet;
use super::views::Reach;
use super::window::{Region, Target, Window};
use crate::cpu::lens::frame::Frame;
use crate::cpu::lens::lanes::FLOATS;
use crate::cpu::lens::padded_layer::PaddedLayer;
use crate::scene::grid::TILE;

/// All layers around a tile.
pub struct Around {
    channels: usize,
    asked: Asked,
    pub region: Region,
    /// Whether the pixels in front of the first column and row of the tile are not swept, or beyond the frame: what lies
    /// between these and the tile's is then the tile's.
    pub is_first: [bool; 2],
    pub layers: Vec<Layer>,
}

/// The cells of one layer around a tile.
#[derive(Default)]
pub struct Layer {
    pub codes: Codes,
    /// The depth codes that each cell spans.
    pub span: Vec<(u16, u16)>,
    /// The shift of each cell.
    s: Vec<f32>,
    pub color: Vec<[f32; 4]>,
    /// The shift of the top of each cell, relative to the focus.
    pub top: PlaneSet,
    /// By how much the next cell of its surface differs along each axis, in each channel; 0 where the surface ends.
    pub slopes: [PlaneSet; 2],
    /// A bit for each axis along which the next cell is of another surface.
    pub ends: Vec<u8>,
    /// What is added, if anything is.
    pub sums: Option<Sums>,
}

/// What is added to the cells of a layer.
pub struct Sums {
    /// A plane for each channel.
    pub by_color: PlaneSet,
    /// By the shifts of the tops and the bottoms of cells. Empty if they are not asked for.
    pub by_top: PlaneSet,
    pub by_bottom: PlaneSet,
}

/// Whether two cells, `between` of which lie between them, are of one surface: their spans touch, or would with the slope
/// that they have.
pub fn is_one_surface((lo_a, hi_a): (u16, u16), (lo_b, hi_b): (u16, u16), between: u32) -> bool {
    let span = u32::from((hi_a - lo_a).max(hi_b - lo_b));
    let reach = |hi: u16| u32::from(hi) + between * span + 1;
    u32::from(lo_a) <= reach(hi_b) && u32::from(lo_b) <= reach(hi_a)
}

impl Around {
    pub fn new(frame: &Frame, channels: usize, asked: Asked) -> Around {
        let layers = frame.padded.layers.iter().map(|_| Layer::default()).collect();
        let region = Region::new(&frame.padded.padding, (0, 0), 0);
        Around { channels, asked, region, is_first: [false; 2], layers }
    }

    /// Takes the cells that the tile at `origin` meets, and those beside them, with nothing added to them.
    pub fn take(&mut self, frame: &Frame, (origin, is_first): ((usize, usize), [bool; 2]), reach: Reach) {
        // The cells beside them tell how the picture changes.
        self.region = Region::new(&frame.padded.padding, origin, reach.cells + 1);
        self.is_first = is_first;
        let len = self.region.len();
        for (number, (layer, from)) in self.layers.iter_mut().zip(&frame.padded.layers).enumerate() {
            layer.sums = (reach.layers >> number & 1 != 0).then(|| Sums::new(self.channels, self.asked, len));
            if layer.sums.is_some() && self.asked.shifts() {
                layer.read(frame, &self.region, (number, from), self.channels);
                layer.find_slopes(self.region.stride, self.channels);
            }
        }
    }

    /// Where a pixel of the tile, and what it has met, is in the arrays.
    #[inline(always)]
    pub fn index(&self, pixel: usize, met: Met) -> usize {
        let [across, down] = met.away();
        let at = self.region.index(pixel % TILE.0, pixel / TILE.0);
        at.wrapping_add_signed(down as isize * self.region.stride as isize + across as isize)
    }

    /// What has been added to the cells of each layer: the sums by colours, and those by shifts if they were asked for.
    pub fn added(&mut self) -> impl Iterator<Item = Window> {
        let Around { region, layers, asked, .. } = self;
        let (region, asked) = (*region, *asked);
        layers
            .iter_mut()
            .enumerate()
            .filter_map(|(number, layer)| Some((number, layer.sums.take()?, &*layer)))
            .flat_map(move |(number, sums, layer)| {
                let shifts = asked.shifts().then(|| layer.by_shift(&sums, &region));
                let shifts = shifts.map(|planes| Window { target: Target::Shifts(number), region, planes });
                let colors = Window { target: Target::Swept(number), region, planes: sums.by_color };
                std::iter::once(colors).chain(shifts)
            })
    }
}

impl Sums {
    fn new(channels: usize, asked: Asked, len: usize) -> Sums {
        let of_shifts = || PlaneSet::zeros(1, if asked.shifts() { len } else { 0 });
        Sums { by_color: PlaneSet::zeros(channels, len), by_top: of_shifts(), by_bottom: of_shifts() }
    }
}

impl Layer {
    /// Reads the cells of a layer in a region.
    fn read(
        &mut self,
        frame: &Frame,
        region: &Region,
        (number, from): (usize, &PaddedLayer),
        channels: usize,
    ) {
        let Region { stride, rows, .. } = *region;
        let row_of = |y: usize| region.padded_row(&frame.padded.padding, y);
        self.span.clear();
        for y in 0..rows {
            let (lo, hi) = (&from.lo[row_of(y)..][..stride], &from.hi[row_of(y)..][..stride]);
            self.span.extend(lo.iter().copied().zip(hi.iter().copied()));
        }
        self.span.resize(region.len(), (0, 0));
        self.read_shifts(frame, region, number);
        self.color.clear();
        self.color.resize(region.len(), [0.0; 4]);
        for (c, from) in from.color.iter().enumerate().take(channels) {
            for (y, into) in self.color.chunks_exact_mut(stride).take(rows).enumerate() {
                let row = into.iter_mut().zip(&from[row_of(y)..][..stride]);
                row.for_each(|(color, v)| color[c] = *v);
            }
        }
        self.codes = Codes::new(frame);
    }

    /// Reads the shifts of the cells.
    fn read_shifts(&mut self, frame: &Frame, region: &Region, number: usize) {
        let (padding, from) = (&frame.padded.padding, &frame.scene.layers[number].s);
        let columns: Vec<usize> = region.padded_columns().map(|px| padding.column(px).0).collect();
        self.s.clear();
        for py in region.padded_rows() {
            let row = &from[padding.row(py).0 * padding.width..][..padding.width];
            self.s.extend(columns.iter().map(|x| row[*x]));
        }
        self.s.resize(region.len(), f32::NAN);
    }

    fn find_slopes(&mut self, stride: usize, channels: usize) {
        let Layer { codes, span, color, top, slopes, ends, .. } = self;
        let len = span.len();
        top.clear(1, len);
        let tops = top.plane_mut(0).iter_mut().zip(&*span);
        tops.for_each(|(top, (_, hi))| *top = codes.shift(f32::from(*hi)));
        ends.clear();
        ends.resize(len, 0);
        for (axis, (slopes, apart)) in slopes.iter_mut().zip([1, stride]).enumerate() {
            slopes.clear(channels, len);
            for at in 0..len - FLOATS - apart {
                let (a, b) = (span[at], span[at + apart]);
                if a.1 == 0 || b.1 == 0 {
                    continue;
                }
                if is_one_surface(a, b, 0) {
                    for c in 0..channels {
                        slopes.plane_mut(c)[at] = color[at + apart][c] - color[at][c];
                    }
                } else {
                    ends[at] |= 1 << axis;
                }
            }
        }
    }

    /// What the shifts of cells change, from what their tops and bottoms do.
    fn by_shift(&self, sums: &Sums, region: &Region) -> PlaneSet {
        let mut by_shift = PlaneSet::zeros(1, region.len());
        let sum = by_shift.plane_mut(0);
        for (from, toward) in [(&sums.by_top, 1.0), (&sums.by_bottom, -1.0)] {
            for (at, change) in from.plane(0).iter().enumerate().filter(|(_, change)| **change != 0.0) {
                let mut own = *change;
                for (q, share) in self.extreme(at, region.stride, toward) {
                    sum[q] += share * change;
                    own -= share * change;
                }
                sum[at] += own;
            }
        }
        by_shift
    }

    /// The neighbours half-way to which a cell's span reaches, to the top (`toward` is 1) or the bottom (-1), each with how much
    /// it moves that end.
    ///
    /// Where a cell is as near as its nearest neighbours, a small change makes either of them the nearest. On average over
    /// changes that are linear, those on opposite sides cancel, and one without an opposite counts for half of the half.
    fn extreme(&self, at: usize, stride: usize, toward: f32) -> impl Iterator<Item = (usize, f32)> + use<> {
        let Layer { s, ends, .. } = self;
        let inside = at >= stride && at + stride < s.len();
        let sides = if inside { [at - 1, at + 1, at - stride, at + stride] } else { [at; 4] };
        let is_end = [ends[sides[0]] & 1, ends[at] & 1, ends[sides[2]] & 2, ends[at] & 2];
        let rises: [f32; 4] = std::array::from_fn(|i| {
            let rise = toward * (s[sides[i]] - s[at]);
            // There may be no cell.
            if is_end[i] == 0 && rise > f32::NEG_INFINITY { rise } else { f32::NEG_INFINITY }
        });
        let most = rises.iter().fold(f32::NEG_INFINITY, |most, rise| most.max(*rise));
        let is_chosen: [bool; 4] =
            std::array::from_fn(|i| rises[i] == most && (most > 0.0 || most == 0.0 && rises[i ^ 1] != most));
        let count = is_chosen.iter().filter(|is_chosen| **is_chosen).count();
        let share = if most > 0.0 { 0.5 } else { 0.25 } / count as f32;
        (0..4).filter(move |i| is_chosen[*i]).map(move |i| (sides[i], share))
    }
}

/// Depth codes as shifts relative to the focus.
#[derive(Clone, Copy, Default)]
pub struct Codes {
    at_0: f32,
    step: f32,
}

impl Codes {
    fn new(frame: &Frame) -> Codes {
        let codes = &frame.padded.codes;
        Codes { at_0: (codes.decode(0.0) - frame.s_focus) as f32, step: codes.step() as f32 }
    }

    pub fn shift(self, code: f32) -> f32 {
        self.at_0 + self.step * code
    }
}
