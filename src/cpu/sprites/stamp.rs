//! Sprites in the form in which they are drawn.

use super::light::Light;
use crate::plan::sprites::Sprite;
use std::ops::Range;

/// Number of neighbouring weights that are multiplied together.
pub const QUAD: usize = 4;

/// A sprite cut into quads of neighbours in a row, without quads that are only zeros.
///
/// Each quad stores its own position instead of following the previous one in its row. This also helps the compiler:
/// it vectorises the light of a quad, instead of looking for vectors across the quads of a row.
pub struct Stamp {
    /// Its first column and row, relative to the pixel of the target that contains the drawn pixel.
    left: i32,
    top: i32,
    /// Number of columns that its quads take.
    across: i32,
    /// Row and column of each quad.
    places: Vec<[u16; 2]>,
    weights: Vec<[f32; QUAD]>,
    /// The first quad of every row, and the end of the last one.
    rows: Vec<usize>,
}

impl Stamp {
    pub fn new(sprite: &Sprite) -> Stamp {
        let (left, top) = (sprite.left, sprite.top);
        let across = (sprite.across + QUAD - 1) as i32;
        let mut stamp = Stamp { left, top, across, places: Vec::new(), weights: Vec::new(), rows: vec![0] };
        for (y, row) in sprite.weights.chunks_exact(sprite.across).enumerate() {
            let mut x = 0;
            while let Some(zeros) = row[x..].iter().position(|w| *w > 0.0) {
                x += zeros;
                let mut quad = [0.0; QUAD];
                quad.iter_mut().zip(&row[x..]).for_each(|(out, w)| *out = *w);
                stamp.places.push([y as u16, x as u16]);
                stamp.weights.push(quad);
                x = (x + QUAD).min(row.len());
            }
            stamp.rows.push(stamp.places.len());
        }
        stamp
    }

    /// Number of pixels of the picture that it reaches; even.
    pub fn reach(&self) -> usize {
        let (right, bottom) = (self.left + self.across, self.top + self.down());
        2 * (1 - self.left).max(1 - self.top).max(right).max(bottom) as usize
    }

    fn down(&self) -> i32 {
        self.rows.len() as i32 - 1
    }

    /// The columns that it covers when drawn at column `x`.
    #[inline(always)]
    pub fn columns(&self, x: i64) -> Range<i64> {
        let left = x + i64::from(self.left);
        left..left + i64::from(self.across)
    }

    /// The rows, out of so many, that it touches when drawn at row `y`.
    #[inline(always)]
    pub fn touches(&self, y: i64, rows: usize) -> Range<usize> {
        let top = y + i64::from(self.top);
        let end = (top + i64::from(self.down())).clamp(0, rows as i64);
        top.clamp(0, end) as usize..end as usize
    }

    /// Draws light at column `x` and row `y` into some rows.
    #[inline(always)]
    pub fn draw<const C: usize>(
        &self,
        (x, y): (i64, i64),
        rows: Range<usize>,
        light: &Light<C>,
        stride: usize,
        sums: &mut [Light<C>],
    ) {
        let (left, top) = (x + i64::from(self.left), y + i64::from(self.top));
        let of_row = |row: usize| self.rows[(row as i64 - top) as usize];
        let quads = of_row(rows.start)..of_row(rows.end);
        let corner = top * stride as i64 + left;
        for (&[row, column], weights) in self.places[quads.clone()].iter().zip(&self.weights[quads]) {
            let at = (corner + i64::from(row) * stride as i64 + i64::from(column)) as usize;
            let sums = sums[at..].first_chunk_mut::<QUAD>().expect("rows have a margin as wide as a sprite");
            for i in 0..QUAD {
                sums[i].add(weights[i], light);
            }
        }
    }
}
