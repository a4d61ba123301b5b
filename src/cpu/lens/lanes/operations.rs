//! The operations of the sweep on a row of cells.

/// Half-planes of a row of cells, and the ray that is tested against them.
#[derive(Clone, Copy)]
pub struct HalfPlaneRow {
    pub normal_x: *const f32,
    pub normal_y: *const f32,
    pub cut: *const f32,
    /// Depth codes of the cells.
    pub code: *const u16,
    /// Where the ray meets a cell of code `u`, from the cell's centre: `(ax u + bx, ay u + by)`.
    pub ray: CellRay,
}

/// See [`HalfPlaneRow::ray`].
#[derive(Clone, Copy, Debug)]
pub struct CellRay {
    pub ax: f32,
    pub bx: f32,
    pub ay: f32,
    pub by: f32,
}

/// The operations of the sweep in one instruction set.
///
/// # Safety
///
/// The caller must have detected the instructions that an implementation uses, and implementations read `CELLS`
/// values from every pointer.
pub unsafe trait Lanes {
    /// Number of cells processed together: as many as leave the sums of three channels and two rows in registers.
    const CELLS: usize;
    /// Sums of one channel.
    type Sum: Copy;
    /// A subset of the cells.
    type Mask: Copy;

    /// Sums of zero.
    unsafe fn zero() -> Self::Sum;
    /// The cells whose bits are set.
    unsafe fn mask(bits: u32) -> Self::Mask;
    /// The bits of a subset of cells.
    unsafe fn bits(cells: Self::Mask) -> u32;
    /// Whether the subset is empty.
    unsafe fn is_none(cells: Self::Mask) -> bool;
    /// The union of two subsets.
    unsafe fn union(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The cells of `a` that are not in `b`.
    unsafe fn without(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The cells of a subset that span some of the codes `from .. to`: `hi >= from && lo < to`.
    unsafe fn hits(of: Self::Mask, lo: *const u16, hi: *const u16, from: u16, to: u16) -> Self::Mask;
    /// Adds the values of all cells.
    unsafe fn add_all(sum: &mut Self::Sum, values: *const f32);
    /// Adds the values of a subset of cells.
    unsafe fn add(sum: &mut Self::Sum, values: *const f32, cells: Self::Mask);
    /// Adds the products of weights and values of a subset of cells.
    unsafe fn add_weighted(sum: &mut Self::Sum, values: *const f32, weights: *const f32, cells: Self::Mask);
    /// Writes the sums out.
    unsafe fn store(sum: Self::Sum, out: *mut f32);
    /// Bit `i` is set where the ray passes through the covered part of cell `i`.
    unsafe fn covered(row: &HalfPlaneRow) -> u32;
}

/// Masks that are plain bits, with the processor's own bit operations.
macro_rules! bit_masks {
    () => {
        #[inline(always)]
        unsafe fn mask(bits: u32) -> u32 {
            bits
        }

        #[inline(always)]
        unsafe fn bits(cells: u32) -> u32 {
            cells
        }

        #[inline(always)]
        unsafe fn is_none(cells: u32) -> bool {
            cells == 0
        }

        #[inline(always)]
        unsafe fn union(a: u32, b: u32) -> u32 {
            a | b
        }

        #[inline(always)]
        unsafe fn without(a: u32, b: u32) -> u32 {
            a & !b
        }
    };
}
pub(super) use bit_masks;
