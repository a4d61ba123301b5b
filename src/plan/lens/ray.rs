//! The traversal of the cells along a ray (a DDA), for both devices.

use crate::scene::depth_codes::DepthCodes;

/// The position of a ray as a function of a depth code, `base + slope code`, relative to the pixel where it starts.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    pub slope: [f64; 2],
    pub base: [f64; 2],
}

impl Ray {
    /// The ray from `start` through the lens point `lens`: `start + lens t`, with `t` linear in the code.
    pub fn new(codes: &DepthCodes, s_focus: f64, lens: [f64; 2], start: [f64; 2]) -> Ray {
        let t_at_0 = codes.decode(0.0) - s_focus;
        Ray { slope: lens.map(|l| l * codes.step()), base: [0, 1].map(|i| start[i] + lens[i] * t_at_0) }
    }

    /// The offset from a cell to the position of the ray at code 0.
    #[inline(always)]
    pub fn base_from(&self, cell: [i32; 2]) -> [f32; 2] {
        [0, 1].map(|i| (self.base[i] - f64::from(cell[i])) as f32)
    }

    /// Calls `visit(cell, from, to)` for every cell that the ray passes between codes `near` and `far`, near to far.
    /// The cell is at the offset `cell` from the start, and the ray is in it for the codes `from .. to`.
    #[inline(always)]
    pub fn traverse(&self, near: usize, far: usize, mut visit: impl FnMut([i32; 2], usize, usize)) {
        let Ray { slope, base } = *self;
        let first = [0, 1].map(|i| (base[i] + slope[i] * near as f64).round());
        let toward = slope.map(f64::signum);
        // The number of codes that the ray spends in a column or row of cells; 0 if it never leaves its own.
        let codes_per_cell = slope.map(|slope| if slope == 0.0 { 0.0 } else { slope.recip().abs() });
        // The code at which the ray, on its way away from the camera, leaves this column or row of cells.
        let mut leave = [0, 1].map(|i| {
            let half_way = toward[i] * (first[i] - base[i]) - 0.5;
            if slope[i] == 0.0 { f64::NEG_INFINITY } else { half_way * codes_per_cell[i] }
        });
        let (mut cell, step) = (first.map(|v| v as i32), toward.map(|v| v as i32));
        let mut to = near;
        while to > far {
            let axis = usize::from(leave[1] > leave[0]);
            let leaves = leave[axis];
            // Rounds to the nearest integer. The conversion to 32 bits, which hold all codes, takes fewer
            // instructions.
            let nearest = |code: f64| (code + 0.5) as u32 as usize;
            let from = if leaves <= far as f64 { far } else { nearest(leaves.min(to as f64)).max(far) };
            if from < to {
                visit(cell, from, to);
                to = from;
            }
            cell[axis] -= step[axis];
            leave[axis] -= codes_per_cell[axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ray_passes_every_code_once_and_stays_in_its_cell(
            lens in [-1.0..1.0f64, -1.0..1.0f64],
            start in [-0.5..0.5f64, -0.5..0.5f64],
            shifts in (-200.0..0.0f64, 0.0..200.0f64),
            codes in (1usize..=65534, 1usize..=65534),
            at_focus in 0.0..1.0f64,
        ) {
            let table = DepthCodes::new(shifts);
            let s_focus = shifts.0 + at_focus * (shifts.1 - shifts.0);
            let ray = Ray::new(&table, s_focus, lens, start);
            let (far, near) = (codes.0.min(codes.1), codes.0.max(codes.1));
            let mut next = near;
            let mut farthest_off = 0.0f64;
            ray.traverse(near, far, |cell, from, to| {
                assert!(from < to && to == next, "{from}..{to} after {next}");
                next = from;
                // The codes at which the ray enters and leaves a cell are rounded by half a code, which moves it by
                // this much.
                let rounding = ray.slope.map(|slope| 0.5 * slope.abs());
                for code in [from, to] {
                    for i in 0..2 {
                        let off = ray.base[i] + ray.slope[i] * code as f64 - f64::from(cell[i]);
                        farthest_off = farthest_off.max(off.abs() - rounding[i]);
                    }
                }
            });
            prop_assert_eq!(next, far);
            prop_assert!(farthest_off <= 0.5 + 1e-6, "{} from the middle of its cell", farthest_off);
        }
    }
}
