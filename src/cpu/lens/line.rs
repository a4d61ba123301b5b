//! The way of a ray through the depths, which both devices follow.

use super::cells::Codes;

/// A ray's place as a function of the code of a depth, `base + slope code`, relative to the pixel that it starts from.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    pub slope: [f64; 2],
    pub base: [f64; 2],
}

impl Line {
    /// The ray from `start` through the lens point `lens`: `start + lens t`, with `t` linear in the code.
    pub fn new(codes: &Codes, s_focus: f64, lens: [f64; 2], start: [f64; 2]) -> Line {
        let t_at_0 = codes.decode(0.0) - s_focus;
        Line { slope: lens.map(|l| l * codes.step()), base: [0, 1].map(|i| start[i] + lens[i] * t_at_0) }
    }

    /// From a cell to the place where the ray would be at code 0.
    pub fn base_from(&self, cell: [f64; 2]) -> [f32; 2] {
        [0, 1].map(|i| (self.base[i] - cell[i]) as f32)
    }

    /// Calls `visit(cell, from, to)` for every cell that the ray passes between codes `near` and `far`, near to far:
    /// that at this offset from the start, over the codes `from .. to`.
    #[inline(always)]
    pub fn follow(&self, near: usize, far: usize, mut visit: impl FnMut([f64; 2], usize, usize)) {
        let Line { slope, base } = *self;
        // Of a ray that never leaves its column, infinite, and not used.
        let codes_per_cell = slope.map(f64::recip);
        let mut cell = [0, 1].map(|i| (base[i] + slope[i] * near as f64).round());
        let mut to = near;
        while to > far {
            // The code at which the ray, going farther, leaves this column or row of cells.
            let leave = |i: usize| {
                if slope[i] == 0.0 {
                    f64::NEG_INFINITY
                } else {
                    (cell[i] - 0.5 * slope[i].signum() - base[i]) * codes_per_cell[i]
                }
            };
            let (leave_x, leave_y) = (leave(0), leave(1));
            let leaves = leave_x.max(leave_y);
            let from = if leaves <= far as f64 { far } else { (leaves.round() as usize).clamp(far, to) };
            if from < to {
                visit(cell, from, to);
                to = from;
            }
            let step = if leave_x >= leave_y { 0 } else { 1 };
            cell[step] -= slope[step].signum();
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
            let table = Codes::new(shifts);
            let s_focus = shifts.0 + at_focus * (shifts.1 - shifts.0);
            let line = Line::new(&table, s_focus, lens, start);
            let (far, near) = (codes.0.min(codes.1), codes.0.max(codes.1));
            let mut next = near;
            let mut farthest_off = 0.0f64;
            line.follow(near, far, |cell, from, to| {
                assert!(from < to && to == next, "{from}..{to} after {next}");
                next = from;
                // Where it enters and leaves a cell codes are rounded: by half of one, which moves it by this much.
                let rounding = line.slope.map(|slope| 0.5 * slope.abs());
                for code in [from, to] {
                    for i in 0..2 {
                        let off = line.base[i] + line.slope[i] * code as f64 - cell[i];
                        farthest_off = farthest_off.max(off.abs() - rounding[i]);
                    }
                }
            });
            prop_assert_eq!(next, far);
            prop_assert!(farthest_off <= 0.5 + 1e-6, "{} from the middle of its cell", farthest_off);
        }
    }
}
