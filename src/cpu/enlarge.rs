//! Linear interpolation between the centres of pixels that are larger than those of the picture.

use crate::mirror::mirrored;
use crate::simd::Simd;

/// A target whose pixels are `scale` times as large as the picture's along each axis; `scale` is a power of two.
pub struct Enlarge {
    /// Positions of the picture's pixels between two pixels of the target, starting with the first one past a centre.
    fractions: Vec<f32>,
    /// A row interpolated between two rows of the target, with one more pixel at both ends.
    between: Vec<f32>,
}

impl Enlarge {
    /// For targets with rows of `width` pixels.
    pub fn new(scale: usize, width: usize) -> Enlarge {
        let fraction = |i: usize| ((scale / 2 + i) as f64 + 0.5) / scale as f64 - 0.5;
        Enlarge { fractions: (0..scale).map(|i| fraction(i) as f32).collect(), between: vec![0.0; width + 2] }
    }

    /// A row that [`Enlarge::row`] can write into.
    pub fn new_row(&self) -> Vec<f32> {
        vec![0.0; (self.between.len() - 1) * self.fractions.len()]
    }

    /// The position of the picture's first pixel in such a row.
    pub fn first(&self) -> usize {
        self.fractions.len() - self.fractions.len() / 2
    }

    /// The rows of a target of `height` rows between which the picture's row `y` lies.
    pub fn rows(&self, y: usize, height: usize) -> [usize; 2] {
        [0, 1].map(|i| mirrored(((y + self.first()) / self.fractions.len() + i) as i64 - 1, height).0)
    }

    /// Interpolates two rows of a target at the pixels of the picture's row `y`.
    pub fn row(&mut self, simd: Simd, y: usize, rows: [&[f32]; 2], out: &mut [f32]) {
        let fraction = self.fractions[(y + self.first()) % self.fractions.len()];
        simd.run(
            #[inline(always)]
            || between(fraction, rows, &mut self.between),
        );
        match self.fractions.len() {
            1 => simd.run(
                #[inline(always)]
                || stretch::<1>(&self.fractions, &self.between, out),
            ),
            2 => simd.run(
                #[inline(always)]
                || stretch::<2>(&self.fractions, &self.between, out),
            ),
            4 => simd.run(
                #[inline(always)]
                || stretch::<4>(&self.fractions, &self.between, out),
            ),
            _ => simd.run(
                #[inline(always)]
                || stretch::<8>(&self.fractions, &self.between, out),
            ),
        }
    }
}

/// A row between two rows, extended at both ends by its mirror image.
#[inline(always)]
fn between(fraction: f32, rows: [&[f32]; 2], out: &mut [f32]) {
    let last = rows[0].len();
    for ((out, a), b) in out[1..=last].iter_mut().zip(rows[0]).zip(rows[1]) {
        *out = a + fraction * (b - a);
    }
    (out[0], out[last + 1]) = (out[1], out[last]);
}

/// Interpolates between all neighbours of a row at all `fractions`, whose number is a multiple of `N`.
#[inline(always)]
fn stretch<const N: usize>(fractions: &[f32], row: &[f32], out: &mut [f32]) {
    let (fractions, out, pairs) = (fractions.as_chunks::<N>().0, out.as_chunks_mut::<N>().0, row.windows(2));
    if let [fractions] = fractions {
        // If the compiler knows that there is only one, this takes two thirds of the time.
        out.iter_mut().zip(pairs).for_each(|(out, pair)| interpolate(fractions, pair, out));
    } else {
        for (out, pair) in out.chunks_exact_mut(fractions.len()).zip(pairs) {
            out.iter_mut().zip(fractions).for_each(|(out, fractions)| interpolate(fractions, pair, out));
        }
    }
}

/// Interpolates between two values.
#[inline(always)]
fn interpolate<const N: usize>(fractions: &[f32; N], pair: &[f32], out: &mut [f32; N]) {
    for i in 0..N {
        out[i] = pair[0] + fractions[i] * (pair[1] - pair[0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_between_the_outer_centres() {
        for scale in [1usize, 2, 4, 16] {
            let ramp: Vec<f32> = (0..5).map(|x| (x as f32 + 0.5) * scale as f32 - 0.5).collect();
            let mut enlarge = Enlarge::new(scale, ramp.len());
            let mut out = enlarge.new_row();
            enlarge.row(Simd::PORTABLE, 0, [&ramp, &ramp], &mut out);
            for x in scale / 2..5 * scale - scale / 2 {
                assert_eq!(out[enlarge.first() + x], x as f32, "{scale}");
            }
            // Down the picture, where rows 0, 1, 2 .. of the target have their centres at the ramp's values.
            for y in scale / 2..5 * scale - scale / 2 {
                let rows = enlarge.rows(y, 5).map(|row| [ramp[row]; 5]);
                enlarge.row(Simd::PORTABLE, y, [&rows[0], &rows[1]], &mut out);
                assert_eq!(out[enlarge.first()], y as f32, "{scale}");
            }
        }
    }
}
