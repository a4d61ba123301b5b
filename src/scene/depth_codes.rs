//! Depth as 16-bit codes.

/// The coding of shifts: `s = s_min + (code - 1) * step`. Code 0 is never a depth.
#[derive(Debug, Clone, Copy)]
pub struct DepthCodes {
    pub s_min: f64,
    step: f64,
    /// Encoding is done in single precision, which is enough: 24 bits for 16.
    least: f32,
    per_px: f32,
}

impl DepthCodes {
    pub const MAX: u16 = u16::MAX - 1;

    pub fn new((s_min, s_max): (f64, f64)) -> DepthCodes {
        let step = ((s_max - s_min) / f64::from(DepthCodes::MAX - 1)).max(1e-9);
        DepthCodes { s_min, step, least: s_min as f32, per_px: (1.0 / step) as f32 }
    }

    #[inline(always)]
    pub fn encode(&self, s: f32) -> u16 {
        // Adding 2^23 rounds to an integer, which the lowest bits then hold.
        const TWO_TO_23: f32 = 8_388_608.0;
        let code = (s - self.least) * self.per_px;
        let code = if code > 0.0 { code } else { 0.0 };
        let code = if code < f32::from(DepthCodes::MAX - 1) { code } else { f32::from(DepthCodes::MAX - 1) };
        (code + TWO_TO_23).to_bits() as u16 + 1
    }

    /// The least shift, and codes a pixel of shift, in the precision of [`encode`](DepthCodes::encode).
    pub fn scale(&self) -> [f32; 2] {
        [self.least, self.per_px]
    }

    /// The shift of a code, or of a position between two codes.
    pub fn decode(&self, code: f64) -> f64 {
        self.s_min + (code - 1.0) * self.step
    }

    /// The position of a shift on the scale of codes; the inverse of [`DepthCodes::decode`].
    pub fn place(&self, s: f64) -> f64 {
        (s - self.s_min) / self.step + 1.0
    }

    pub fn step(&self) -> f64 {
        self.step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_keep_depth_to_a_thousandth_of_a_pixel() {
        let codes = DepthCodes::new((-3.0, 57.0));
        for s in [-3.0f32, 0.0, 12.3456, 57.0] {
            assert!((codes.decode(f64::from(codes.encode(s))) - f64::from(s)).abs() < 1e-3);
        }
    }
}
