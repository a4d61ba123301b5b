//! The places of a picture for which a lens is known, and directions in the picture.

use crate::error::{Result, value_error};

/// A direction of unit length in the picture, and what is measured along it and across it.
#[derive(Debug, Clone, Copy)]
pub struct Direction(pub [f64; 2]);

impl Direction {
    /// That of the picture's rows.
    pub const RIGHT: Direction = Direction([1.0, 0.0]);

    /// A vector of the picture, along the direction and across it.
    pub fn turned(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [c, s] = self.0;
        [c * x + s * y, c * y - s * x]
    }

    /// The inverse of [`Direction::turned`].
    pub fn turned_back(self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [c, s] = self.0;
        [c * u - s * v, s * u + c * v]
    }
}

/// A place of the picture: the distance from the axis in half diagonals, and the direction away from it.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub height: f64,
    pub away: Direction,
}

impl Place {
    /// The place itself, in half diagonals from the axis.
    pub fn at(&self) -> [f64; 2] {
        self.away.0.map(|v| self.height * v)
    }
}

/// The places for which a lens has maps, in half diagonals from the axis; rising along each axis.
#[derive(Debug, Clone, PartialEq)]
pub enum Fields {
    /// Places to the right of the axis of a lens that is rotationally symmetric.
    Heights(Vec<f64>),
    /// Columns and rows of places, of which each has a map, row after row.
    Grid([Vec<f64>; 2]),
}

impl Fields {
    /// How many places there are.
    pub fn count(&self) -> usize {
        match self {
            Fields::Heights(heights) => heights.len(),
            Fields::Grid([x, y]) => x.len() * y.len(),
        }
    }

    /// Map number `i`, in words.
    pub fn name(&self, i: usize) -> String {
        match self {
            Fields::Heights(heights) => heights[i].to_string(),
            Fields::Grid([x, y]) => format!("({}, {})", x[i % x.len()], y[i / x.len()]),
        }
    }

    /// Refuses places that do not rise.
    pub fn check(&self) -> Result<()> {
        let rising = |of: &[f64]| {
            !of.is_empty() && of.iter().all(|v| v.is_finite()) && of.windows(2).all(|pair| pair[0] < pair[1])
        };
        match self {
            Fields::Heights(heights) if !rising(heights) || heights[0] < 0.0 => Err(value_error!(
                "field must be rising distances from the axis in half diagonals, at least one, finite and not \
                 negative; got {heights:?}"
            )),
            Fields::Grid([x, y]) if !rising(x) || !rising(y) => Err(value_error!(
                "field must be rising columns and rising rows in half diagonals from the axis, at least one each, \
                 finite; got {x:?} and {y:?}"
            )),
            _ => Ok(()),
        }
    }
}
