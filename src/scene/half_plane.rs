//! Coverage of a pixel by a straight edge, or by something that light passes through.

use crate::picture::Size;
use rayon::prelude::*;

/// A partly covered pixel as a half-plane. The covered part of the pixel satisfies `normal . f <= cut`, where `f` is
/// measured from the pixel's centre and lies within half a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfPlane {
    pub normal: [f32; 2],
    pub cut: f32,
    /// The fraction of the pixel that it covers.
    pub area: f32,
    /// The fraction of light that the covered part stops.
    pub opacity: f32,
}

/// The area of a pixel in which `normal . f <= cut`; undoes [`HalfPlane::with_area`].
pub fn area_below(normal: [f32; 2], cut: f32) -> f32 {
    let (p, q) = (normal[0].abs().min(normal[1].abs()), normal[0].abs().max(normal[1].abs()));
    let moved = (0.5 * (p + q) - cut.abs()).max(0.0);
    let small = if moved < p { moved * moved / (2.0 * p * q) } else { (moved - 0.5 * p) / q };
    if cut <= 0.0 { small } else { 1.0 - small }
}

/// A line so far from the centre, in pixels, covers the whole of the pixel, and of every beam one pixel wide that passes
/// within a pixel.
const BEYOND: f32 = 4.0;

impl HalfPlane {
    /// The opaque half-plane of the given unit normal that covers the fraction `area` of the pixel.
    pub fn with_area(normal: [f32; 2], area: f32) -> HalfPlane {
        let (p, q) = (normal[0].abs().min(normal[1].abs()), normal[0].abs().max(normal[1].abs()));
        // How far the line has moved in from the corner: the area grows first as a triangle, then as a band.
        let small = area.min(1.0 - area);
        let moved = if small <= 0.5 * p / q { (2.0 * p * q * small).sqrt() } else { small * q + 0.5 * p };
        let cut = moved - 0.5 * (p + q);
        HalfPlane { normal, cut: if area <= 0.5 { cut } else { -cut }, area, opacity: 1.0 }
    }

    /// The fraction of light that the pixel stops.
    pub fn coverage(&self) -> f32 {
        self.area * self.opacity
    }

    /// The half-plane of a pixel of what is as opaque as it is anywhere around: its coverage is less where it ends.
    ///
    /// Beside an edge, some pixel around is covered entirely. Where none is, no edge makes the coverage less than whole:
    /// light passes through, as through fog and glass. An edge of glass is both.
    pub fn of_layer(around: [[f32; 3]; 3], index: usize) -> HalfPlane {
        let opacity = around.iter().flatten().fold(0.0, |most: f32, &v| most.max(v)).min(1.0);
        if around[1][1] >= opacity {
            return HalfPlane { normal: [1.0, 0.0], cut: BEYOND, area: 1.0, opacity };
        }
        let plane = HalfPlane::from_coverage(around.map(|row| row.map(|v| v / opacity)), index);
        HalfPlane { opacity, ..plane }
    }

    /// The opaque half-plane of a pixel with this coverage, from the coverage of its 3x3 neighbourhood (rows of three, y
    /// down).
    ///
    /// Where the gradient gives no direction, as in hair, one is drawn from the position: any direction has the right
    /// area.
    pub fn from_coverage(around: [[f32; 3]; 3], index: usize) -> HalfPlane {
        let sobel = |v: [[f32; 3]; 3]| -> f32 {
            (0..3).map(|i| [1.0, 2.0, 1.0][i] * (v[i][2] - v[i][0])).sum::<f32>()
        };
        let transposed = std::array::from_fn(|i| std::array::from_fn(|j| around[j][i]));
        let gradient = [sobel(around), sobel(transposed)];
        let length = gradient[0].hypot(gradient[1]);
        // A straight edge has a gradient of 4 in these units.
        const WEAK: f32 = 1.0;
        let normal = if length > WEAK {
            [-gradient[0] / length, -gradient[1] / length]
        } else {
            // Multiplicative hashing: the golden ratio in 32 bits spreads neighbouring indices over the circle.
            let turn = (index as u32).wrapping_mul(0x9e37_79b9) as f32 / 4_294_967_296.0;
            let (sin, cos) = (turn * std::f32::consts::TAU).sin_cos();
            [cos, sin]
        };
        HalfPlane::with_area(normal, around[1][1])
    }
}

/// The half-planes of the pixels of a layer that its coverage covers partly, in the order of rows.
pub fn of_layer(size: Size, coverage: &[f32]) -> Vec<(usize, HalfPlane)> {
    (0..size.pixels())
        .into_par_iter()
        .filter(|&i| coverage[i] > 0.0 && coverage[i] < 1.0)
        .map(|index| (index, HalfPlane::of_layer(around(size, index, |q| coverage[q]), index)))
        .collect()
}

/// The coverage of the pixels around one; at the border of the frame, its own pixels stand in for those beyond.
pub fn around(size: Size, index: usize, coverage: impl Fn(usize) -> f32) -> [[f32; 3]; 3] {
    let (x, y) = (index % size.width, index / size.width);
    let clamped = |v: usize, d: usize, n: usize| (v + d).saturating_sub(1).min(n - 1);
    let at = |i: usize, j: usize| clamped(y, j, size.height) * size.width + clamped(x, i, size.width);
    std::array::from_fn(|j| std::array::from_fn(|i| coverage(at(i, j))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_area_of_a_half_plane_is_what_it_was_made_for(turn in 0.0..7.0f32, area in 0.0..1.0f32) {
            let plane = HalfPlane::with_area([turn.cos(), turn.sin()], area);
            prop_assert!((area_below(plane.normal, plane.cut) - area).abs() < 1e-5);
            // The opposite half-plane covers the rest of the pixel.
            let other = area_below(plane.normal.map(|n| -n), -plane.cut);
            prop_assert!((other - (1.0 - area)).abs() < 1e-5);
        }
    }

    #[test]
    fn coverage_is_opacity_where_nothing_ends() {
        let even = HalfPlane::of_layer([[0.3; 3]; 3], 7);
        assert_eq!((even.area, even.opacity), (1.0, 0.3));
        assert_eq!(area_below(even.normal, even.cut - 1.0), 1.0);
        let edge = [[0.0, 0.25, 1.0]; 3];
        assert_eq!(HalfPlane::of_layer(edge, 7), HalfPlane::from_coverage(edge, 7));
        let of_glass = HalfPlane::of_layer(edge.map(|row| row.map(|v| 0.5 * v)), 7);
        assert_eq!(of_glass, HalfPlane { opacity: 0.5, ..HalfPlane::from_coverage(edge, 7) });
        assert!((of_glass.coverage() - 0.125).abs() < 1e-7);
    }

    #[test]
    fn half_planes_cover_the_area_they_are_asked_for() {
        const STEPS: usize = 400;
        for turn in 0..12 {
            let angle = turn as f32 * 0.55;
            for area in [0.02, 0.11, 0.3, 0.5, 0.77, 0.98] {
                let plane = HalfPlane::with_area([angle.cos(), angle.sin()], area);
                let at = |i: usize| (i as f32 + 0.5) / STEPS as f32 - 0.5;
                let covered = (0..STEPS * STEPS)
                    .filter(|i| {
                        plane.normal[0] * at(i % STEPS) + plane.normal[1] * at(i / STEPS) <= plane.cut
                    })
                    .count();
                let covered = covered as f32 / (STEPS * STEPS) as f32;
                assert!((covered - area).abs() < 4e-3, "{angle} {area}: {covered}");
            }
        }
    }
}
