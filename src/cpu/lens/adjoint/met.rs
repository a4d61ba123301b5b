//! What a ray meets, as a number.

/// What a ray meets: a layer, and how many columns and rows its cell is away from the pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Met(u32);

impl Met {
    pub const NOTHING: Met = Met(u32::MAX);
    /// The pixel's own cell of the first layer.
    pub const OWN: Met = Met((Met::MIDDLE as u32) << Met::BITS | Met::MIDDLE as u32);
    /// A cell is at most [`FULL_RESOLUTION_PX`](crate::plan::lens::FULL_RESOLUTION_PX) columns or rows and those of its span away.
    const BITS: u32 = 13;
    const MIDDLE: i32 = 1 << (Met::BITS - 1);

    /// A cell of a layer at an offset in padded cells.
    #[inline(always)]
    pub fn new(layer: u32, offset: i32, stride: usize) -> Met {
        let stride = stride as i32;
        let down = (offset + stride / 2).div_euclid(stride);
        let across = offset - down * stride;
        let (across, down) = ((across + Met::MIDDLE) as u32, (down + Met::MIDDLE) as u32);
        Met(layer << (2 * Met::BITS) | down << Met::BITS | across)
    }

    /// The number that says all of it.
    #[inline(always)]
    pub const fn code(self) -> u32 {
        self.0
    }

    #[inline(always)]
    pub fn of_code(code: u32) -> Met {
        Met(code)
    }

    #[inline(always)]
    pub fn layer(self) -> usize {
        (self.0 >> (2 * Met::BITS)) as usize
    }

    /// Columns and rows from the pixel to the cell.
    #[inline(always)]
    pub fn away(self) -> [i32; 2] {
        const MASK: u32 = (1 << Met::BITS) - 1;
        let [across, down] = [self.0 & MASK, self.0 >> Met::BITS & MASK];
        [across as i32 - Met::MIDDLE, down as i32 - Met::MIDDLE]
    }
}
