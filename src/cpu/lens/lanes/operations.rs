//! What the sweep does with a row of cells.

/// Half-planes of a row of cells, and the ray that tests them.
#[derive(Clone, Copy)]
pub struct HalfPlaneRow {
    pub normal_x: *const f32,
    pub normal_y: *const f32,
    pub cut: *const f32,
    /// DepthCodes of the cells.
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
/// Implementations use instructions that the caller has to have detected, and read `CELLS` values from every
/// pointer.
pub unsafe trait Lanes {
    /// Cells handled at once, as many as leave the sums of three channels and two rows in registers.
    const CELLS: usize;
    /// Sums of one channel.
    type Sum: Copy;
    /// Some of the cells.
    type Mask: Copy;

    /// All sums zero.
    unsafe fn zero() -> Self::Sum;
    /// The cells whose bit is set.
    unsafe fn mask(bits: u32) -> Self::Mask;
    /// The bits of some cells.
    unsafe fn bits(cells: Self::Mask) -> u32;
    /// Whether there is none.
    unsafe fn is_none(cells: Self::Mask) -> bool;
    /// The cells of both.
    unsafe fn union(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The cells of `a` that are not in `b`.
    unsafe fn without(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Those of some cells that reach into the codes `from .. to`: `hi >= from && lo < to`.
    unsafe fn hits(of: Self::Mask, lo: *const u16, hi: *const u16, from: u16, to: u16) -> Self::Mask;
    /// Adds the values of all cells.
    unsafe fn add_all(sum: &mut Self::Sum, values: *const f32);
    /// Adds the values of some cells.
    unsafe fn add(sum: &mut Self::Sum, values: *const f32, cells: Self::Mask);
    /// Writes the sums out.
    unsafe fn store(sum: Self::Sum, out: *mut f32);
    /// Bit `i` is set where the ray passes through the covered part of cell `i`.
    unsafe fn covered(row: &HalfPlaneRow) -> u32;
}

/// Masks that are bits, on which processors calculate.
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
