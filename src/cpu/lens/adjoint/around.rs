//! The cells around a tile, in arrays of their own: how the picture changes from each to the next, and what is added to them.

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
    pub color: Vec<[f32; 4]>,
    /// The borders between cells and the next ones of their surface along each axis: the shift of each, and by how much the
    /// next cell differs in each channel; 0 where the surface ends.
    pub borders: [PlaneSet; 2],
    /// How much of each cell is covered along a line through its middle, counted from the left, the right, above and below: 1
    /// where it is covered on the other side. Empty if all cells are covered.
    pub covered: Vec<[f32; 4]>,
    /// A bit for each axis along which the next cell is of another surface.
    pub ends: Vec<u8>,
    /// What is added, if anything is.
    pub sums: Option<Sums>,
}

/// What is added to the cells of a layer.
pub struct Sums {
    /// A plane for each channel.
    pub by_color: PlaneSet,
    /// By the shifts of borders along each axis, and of cells. Empty if they are not asked for.
    pub by_border: [PlaneSet; 2],
    pub by_shift: PlaneSet,
}

/// Whether two cells, `between` of which lie between them, are of one surface: their spans touch, or would with the slope
/// that they have.
pub fn is_one_surface((lo_a, hi_a): (u16, u16), (lo_b, hi_b): (u16, u16), between: u32) -> bool {
    let span = u32::from((hi_a - lo_a).max(hi_b - lo_b));
    let reach = |hi: u16| u32::from(hi) + between * span + 1;
    u32::from(lo_a) <= reach(hi_b) && u32::from(lo_b) <= reach(hi_a)
}

/// The middle of what the spans of two neighbours have in common: where the one goes over into the other.
fn border((lo_a, hi_a): (u16, u16), (lo_b, hi_b): (u16, u16)) -> f32 {
    0.5 * (f32::from(lo_a.max(lo_b)) + f32::from(hi_a.min(hi_b)))
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
                layer.read(frame, &self.region, from, self.channels);
                layer.find_borders(self.region.stride, self.channels);
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
        let sums =
            layers.iter_mut().enumerate().filter_map(|(number, layer)| Some((number, layer.sums.take()?)));
        sums.flat_map(move |(number, sums)| {
            let (by_color, by_shift) = sums.into_planes(region.stride);
            let colors = Window { target: Target::Swept(number), region, planes: by_color };
            let shifts = Window { target: Target::Shifts(number), region, planes: by_shift };
            std::iter::once(colors).chain(asked.shifts().then_some(shifts))
        })
    }
}

impl Sums {
    fn new(channels: usize, asked: Asked, len: usize) -> Sums {
        let of_shifts = || PlaneSet::zeros(1, if asked.shifts() { len } else { 0 });
        Sums {
            by_color: PlaneSet::zeros(channels, len),
            by_border: [of_shifts(), of_shifts()],
            by_shift: of_shifts(),
        }
    }

    /// The planes by colours, and that by shifts; both cells at a border move it by half of their shift.
    fn into_planes(self, stride: usize) -> (PlaneSet, PlaneSet) {
        let Sums { by_color, by_border, mut by_shift } = self;
        for (by_border, apart) in by_border.iter().zip([1, stride]) {
            let (sums, by_border) = (by_shift.plane_mut(0), by_border.plane(0));
            sums.iter_mut().skip(apart).zip(by_border).for_each(|(sum, v)| *sum += 0.5 * v);
            sums.iter_mut().zip(by_border).for_each(|(sum, v)| *sum += 0.5 * v);
        }
        (by_color, by_shift)
    }
}

impl Layer {
    /// Reads the cells of a layer in a region.
    fn read(&mut self, frame: &Frame, region: &Region, from: &PaddedLayer, channels: usize) {
        let Region { stride, rows, .. } = *region;
        let row_of = |y: usize| region.padded_row(&frame.padded.padding, y);
        self.span.clear();
        for y in 0..rows {
            let (lo, hi) = (&from.lo[row_of(y)..][..stride], &from.hi[row_of(y)..][..stride]);
            self.span.extend(lo.iter().copied().zip(hi.iter().copied()));
        }
        self.span.resize(region.len(), (0, 0));
        self.color.clear();
        self.color.resize(region.len(), [0.0; 4]);
        for (c, from) in from.color.iter().enumerate().take(channels) {
            for (y, into) in self.color.chunks_exact_mut(stride).take(rows).enumerate() {
                let row = into.iter_mut().zip(&from[row_of(y)..][..stride]);
                row.for_each(|(color, v)| color[c] = *v);
            }
        }
        self.codes = Codes::new(frame);
        self.covered.clear();
        let partial = &from.partial;
        if partial.cut.is_empty() {
            return;
        }
        self.covered.resize(region.len(), [1.0; 4]);
        for y in 0..rows {
            let first = row_of(y);
            for (x, covered) in self.covered[y * stride..][..stride].iter_mut().enumerate() {
                if let Some((normal, cut)) = partial.line(first + x) {
                    let along = |n: f32| if n > 0.0 { (0.5 + cut / n).clamp(0.0, 1.0) } else { 1.0 };
                    *covered = [normal[0], -normal[0], normal[1], -normal[1]].map(along);
                }
            }
        }
    }

    fn find_borders(&mut self, stride: usize, channels: usize) {
        let Layer { codes, span, color, borders, ends, .. } = self;
        let len = span.len();
        ends.clear();
        ends.resize(len, 0);
        for (axis, (borders, apart)) in borders.iter_mut().zip([1, stride]).enumerate() {
            borders.clear(1 + channels, len);
            for at in 0..len - FLOATS - apart {
                let (a, b) = (span[at], span[at + apart]);
                if a.1 == 0 || b.1 == 0 {
                    continue;
                }
                if is_one_surface(a, b, 0) {
                    borders.plane_mut(0)[at] = codes.shift(border(a, b));
                    for c in 0..channels {
                        borders.plane_mut(1 + c)[at] = color[at + apart][c] - color[at][c];
                    }
                } else {
                    ends[at] |= 1 << axis;
                }
            }
        }
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
