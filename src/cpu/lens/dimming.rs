//! Rays that go on behind what light passes through.

use super::lanes::Lanes;
use super::planes::Planes;
use super::segments::{MOST, ROWS, Segments, Step};

/// How much of the light of each cell reaches the pixel that has met it.
pub type Weights = [[f32; MOST]; ROWS];

/// What is left of the rays of one sample behind what they have met.
pub struct Left {
    /// Whether any of them has met something that light passes through.
    pub dimmed: bool,
    /// Of a ray that has met nothing all. Defined if any is dimmed.
    pub light: Weights,
}

impl Left {
    /// Rays that have met nothing yet.
    pub const ALL: Left = Left { dimmed: false, light: [[1.0; MOST]; ROWS] };

    /// Dims the rays that meet `cells` of a layer in a segment. Returns how much of each cell's light arrives, and the
    /// rays of which nothing is left.
    ///
    /// On a slope, a ray may meet several cells of a surface that it crosses once. It crosses it in the pixel that it
    /// enters in front of the surface and leaves behind it.
    ///
    /// # Safety
    ///
    /// The segment's cells lie inside the padded arrays, and `base` is the first pixel.
    // Out of the loop of the sweep, which then keeps its sums in registers.
    #[cold]
    #[inline(never)]
    pub unsafe fn dim<L: Lanes, const C: usize>(
        &mut self,
        layer: &Planes<C>,
        (base, stride): (usize, usize),
        (segments, number): (&Segments, u32),
        cells: [u32; ROWS],
    ) -> (Weights, [u32; ROWS]) {
        if !self.dimmed {
            *self = Left { dimmed: true, ..Left::ALL };
        }
        let (mut weights, mut ended) = ([[0.0; MOST]; ROWS], [0; ROWS]);
        let own = &segments.traced[number as usize];
        let (before, after) = segments.steps_beside(own);
        let at = |pixel: usize, offset: i32| pixel.wrapping_add_signed(offset as isize);
        for row in 0..ROWS {
            for i in (0..L::CELLS).filter(|i| cells[row] >> i & 1 != 0) {
                let pixel = base + row * stride + i;
                let cell = at(pixel, own.segment.offset);
                // SAFETY: per the function's contract.
                let opacity = unsafe { layer.opacity(cell) };
                let is_behind = |step: &Step, to: u16| {
                    // SAFETY: a ray's steps stay inside the padded arrays.
                    unsafe { layer.is_behind(cell, at(pixel, step.offset), to) }
                };
                let comes_from_behind =
                    || before.and_then(|step| is_behind(step, own.segment.to)) == Some(true);
                let stays_in_front = || after.and_then(|step| is_behind(step, step.to)) == Some(false);
                if opacity < 1.0 && (comes_from_behind() || stays_in_front()) {
                    continue;
                }
                let light = &mut self.light[row][i];
                weights[row][i] = *light * opacity;
                *light -= weights[row][i];
                ended[row] |= u32::from(*light <= 0.0) << i;
            }
        }
        (weights, ended)
    }
}
