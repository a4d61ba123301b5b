//! Where cameras stand, and how pixels of one are found in the picture of another.

/// A pinhole camera. Its axes are those of OpenCV: x to the right, y down, z forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// From a point with `z = 1` to its pixel. The first entries of the last two rows are 0, and the last row is
    /// `[0, 0, 1]`; pixel centres have integer coordinates.
    pub intrinsics: [[f64; 3]; 3],
    /// The columns are the directions of the camera's axes in the world.
    pub rotation: [[f64; 3]; 3],
    /// Where it stands in the world.
    pub position: [f64; 3],
}

/// A point as a camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// The pixel, from the left.
    pub x: f64,
    /// From the top.
    pub y: f64,
    /// The inverse of its `z`.
    pub disparity: f64,
}

fn times(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn applied(a: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| (0..3).map(|k| a[i][k] * v[k]).sum())
}

impl Camera {
    /// From a pixel to the point with `z = 1` that is seen there.
    fn inverse_intrinsics(&self) -> [[f64; 3]; 3] {
        let [[fx, skew, cx], [_, fy, cy], _] = self.intrinsics;
        [
            [1.0 / fx, -skew / (fx * fy), (skew * cy - cx * fy) / (fx * fy)],
            [0.0, 1.0 / fy, -cy / fy],
            [0.0, 0.0, 1.0],
        ]
    }

    /// Focal length in pixels: the geometric mean of both axes.
    pub fn focal_px(&self) -> f64 {
        (self.intrinsics[0][0] * self.intrinsics[1][1]).sqrt()
    }

    /// How far two cameras are apart.
    pub fn baseline(&self, other: &Camera) -> f64 {
        let square = |i: usize| (self.position[i] - other.position[i]).powi(2);
        (0..3).map(square).sum::<f64>().sqrt()
    }
}

/// The map from the pixels of one camera, and the disparities of what they see, to those of another.
///
/// A point at disparity `d` that pixel `p` sees is `K^-1 p / d`. Multiplied by `d` it stays finite at infinity, and the
/// other camera sees `linear p + d shift`, whose third component is the ratio of the two `z`.
#[derive(Debug, Clone, Copy)]
pub struct Warp {
    linear: [[f64; 3]; 3],
    shift: [f64; 3],
}

impl Warp {
    /// The map from one camera to another.
    pub fn between(from: &Camera, to: &Camera) -> Warp {
        let back: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| to.rotation[j][i]));
        let turn = times(&back, &from.rotation);
        let apart = std::array::from_fn(|i| from.position[i] - to.position[i]);
        Warp {
            linear: times(&times(&to.intrinsics, &turn), &from.inverse_intrinsics()),
            shift: applied(&to.intrinsics, applied(&back, apart)),
        }
    }

    /// What the other camera sees of the point at a pixel; `None` if that is not in front of it.
    #[inline(always)]
    pub fn at(&self, x: f64, y: f64, d: f64) -> Option<Seen> {
        let seen = |i: usize| {
            let [a, b, c] = self.linear[i];
            a * x + b * y + c + d * self.shift[i]
        };
        let w = seen(2);
        (w > 0.0).then(|| Seen { x: seen(0) / w, y: seen(1) / w, disparity: d / w })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera(turn: f64, position: [f64; 3]) -> Camera {
        let (sin, cos) = turn.sin_cos();
        Camera {
            intrinsics: [[100.0, 3.0, 31.5], [0.0, 110.0, 23.5], [0.0, 0.0, 1.0]],
            rotation: [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]],
            position,
        }
    }

    proptest! {
        #[test]
        fn there_and_back_is_where_one_was(
            turn in -0.3..0.3f64, right in -1.0..1.0f64, forward in -1.0..1.0f64,
            x in 0.0..64.0f64, y in 0.0..48.0f64, d in 0.0..0.4f64,
        ) {
            let (one, other) = (camera(0.1, [0.0; 3]), camera(turn, [right, 0.2, forward]));
            let there = Warp::between(&one, &other).at(x, y, d);
            prop_assume!(there.is_some());
            let there = there.unwrap();
            let back = Warp::between(&other, &one).at(there.x, there.y, there.disparity).unwrap();
            prop_assert!((back.x - x).abs() < 1e-6 && (back.y - y).abs() < 1e-6 && (back.disparity - d).abs() < 1e-9);
        }
    }

    #[test]
    fn a_step_to_the_right_moves_things_to_the_left() {
        let seen = Warp::between(&camera(0.0, [0.0; 3]), &camera(0.0, [0.5, 0.0, 0.0])).at(31.5, 23.5, 0.2);
        assert_eq!(seen, Some(Seen { x: 31.5 - 100.0 * 0.5 * 0.2, y: 23.5, disparity: 0.2 }));
    }
}
