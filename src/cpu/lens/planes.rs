//! The data of a layer that the sweep reads, cell by cell.

use super::lanes::{CellRay, HalfPlaneRow, Lanes};
use super::padded_layer::{PaddedLayer, PartialPlanes};

/// The data of a layer that the sweep reads.
pub struct Planes<'a, const C: usize> {
    pub lo: *const u16,
    pub hi: *const u16,
    pub color: [*const f32; C],
    pub partial: &'a PartialPlanes,
}

impl<const C: usize> Planes<'_, C> {
    pub fn of(layer: &PaddedLayer) -> Planes<'_, C> {
        let color = std::array::from_fn(|c| layer.color[c].as_ptr());
        Planes { lo: layer.lo.as_ptr(), hi: layer.hi.as_ptr(), color, partial: &layer.partial }
    }

    /// The cells of a row, starting at `at`, that cover their pixel only partly.
    ///
    /// # Safety
    ///
    /// The cells lie inside the padded arrays.
    #[inline(always)]
    pub unsafe fn partial(&self, at: usize) -> u32 {
        // SAFETY: per the function's contract; the bits have some bytes more than there are cells.
        let word = unsafe { self.partial.bits.as_ptr().add(at / 8).cast::<u64>().read_unaligned() };
        (u64::from_le(word) >> (at % 8)) as u32
    }

    /// Those of the given cells, in a row starting at `at`, that a ray meets where they cover their pixel.
    ///
    /// # Safety
    ///
    /// The instructions of `L` have been detected, and the cells lie inside the padded arrays.
    #[inline(always)]
    pub unsafe fn covering<L: Lanes>(&self, cells: L::Mask, at: usize, ray: CellRay) -> L::Mask {
        let PartialPlanes { normal_x, normal_y, cut, .. } = self.partial;
        // SAFETY: per the function's contract.
        unsafe {
            let doubtful = self.partial(at) & L::bits(cells);
            if doubtful == 0 {
                return cells;
            }
            let row = HalfPlaneRow {
                normal_x: normal_x.as_ptr().add(at),
                normal_y: normal_y.as_ptr().add(at),
                cut: cut.as_ptr().add(at),
                code: self.lo.add(at),
                ray,
            };
            L::without(cells, L::mask(doubtful & !L::covered(&row)))
        }
    }

    /// The depth codes that a cell spans, from the farthest to the nearest.
    ///
    /// # Safety
    ///
    /// The cell lies inside the padded arrays.
    #[inline(always)]
    pub unsafe fn span(&self, cell: usize) -> [u16; 2] {
        // SAFETY: per the function's contract.
        unsafe { [*self.lo.add(cell), *self.hi.add(cell)] }
    }

    /// The fraction of a ray's light that a cell stops where it covers its pixel.
    ///
    /// # Safety
    ///
    /// As for [`Planes::span`].
    #[inline(always)]
    pub unsafe fn opacity(&self, cell: usize) -> f32 {
        // SAFETY: per the function's contract.
        if unsafe { self.partial(cell) } & 1 != 0 { self.partial.opacity[cell] } else { 1.0 }
    }

    /// Whether a ray that comes from the pixel of one of two cells to that of the other, where it begins with the code
    /// before `to`, is behind the surface there; `None` if they are not one surface.
    ///
    /// The cells of a slope span the depths up to half-way to their neighbours, where they touch.
    ///
    /// # Safety
    ///
    /// As for [`Planes::span`], for both cells.
    #[inline(always)]
    pub unsafe fn is_behind(&self, a: usize, b: usize, to: u16) -> Option<bool> {
        // SAFETY: per the function's contract.
        let [[lo_a, hi_a], [lo_b, hi_b]] = unsafe { [self.span(a), self.span(b)] };
        let touch = hi_b > 0 && lo_a <= hi_b.saturating_add(1) && lo_b <= hi_a.saturating_add(1);
        touch.then(|| to <= lo_a.max(lo_b))
    }
}
