//! What became of sharp depth in a map, and how much of something the map has lost.

use super::plane::Plane;

/// What became of sharp depth.
#[derive(Clone, Copy)]
pub enum Spread {
    /// It was blurred by something like a Gaussian of this standard deviation.
    Gaussian(f32),
    /// It was averaged over squares of so many pixels, and enlarged.
    Blocks(usize),
}

impl Spread {
    /// What becomes of a plane.
    pub fn of(self, plane: &Plane) -> Plane {
        match self {
            Spread::Gaussian(sigma) => plane.blurred(sigma),
            Spread::Blocks(side) => plane.averaged(side).resized(plane.width, plane.height),
        }
    }
}

/// Local statistics of planes and of one that they are compared with.
pub struct Local<'a> {
    probe: &'a Plane,
    mean: Plane,
    window_px: f32,
}

impl Local<'_> {
    /// Statistics in a Gaussian window of this standard deviation.
    pub fn new(probe: &Plane, window_px: f32) -> Local<'_> {
        Local { probe, mean: probe.blurred(window_px), window_px }
    }

    /// The covariance of a plane with the probe.
    pub fn covariance(&self, plane: &Plane) -> Plane {
        let products = plane.with(self.probe, |a, b| a * b).blurred(self.window_px);
        let means = plane.blurred(self.window_px).with(&self.mean, |a, b| a * b);
        products.with(&means, |product, means| product - means)
    }

    /// The squared correlation of a plane with the probe.
    pub fn correlation(&self, plane: &Plane) -> Plane {
        let mean = plane.blurred(self.window_px);
        let square = plane.with(plane, |a, b| a * b).blurred(self.window_px);
        let variance = square.with(&mean, |square, mean| square - mean * mean);
        let variances = variance.with(&self.covariance(self.probe), |a, b| a * b);
        self.covariance(plane).with(&variances, |shared, both| shared * shared / both.max(1e-20))
    }
}
