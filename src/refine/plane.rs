//! One value a pixel, and the filters that refining is made of.

use crate::memory::Buffer;
use crate::picture::range;
use rayon::prelude::*;

/// Rows that one worker filters along the columns at a time.
const BAND: usize = 64;
/// Rows that one worker takes at least.
const ROWS_PER_TASK: usize = 32;
/// How many times maps are known to have been enlarged: parts of a tile's sides.
const ENLARGED: [usize; 5] = [8, 6, 4, 3, 2];
/// Columns and rows of a tile.
const TILE: (usize, usize) = (384, 96);

/// One value a pixel, row after row.
#[derive(Debug, Clone)]
pub struct Plane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values.
    pub values: Buffer<f32>,
}

impl Plane {
    /// A plane with `row(y, out)` for each of its rows.
    pub fn of_rows(width: usize, height: usize, row: impl Fn(usize, &mut [f32]) + Sync) -> Plane {
        let mut values = Buffer::unset(width * height);
        let rows = values.par_chunks_mut(width).enumerate().with_min_len(ROWS_PER_TASK);
        rows.for_each(|(y, out)| row(y, out));
        Plane { width, height, values }
    }

    /// A plane of the same size with `row(y, out)` for each of its rows.
    pub fn like(&self, row: impl Fn(usize, &mut [f32]) + Sync) -> Plane {
        Plane::of_rows(self.width, self.height, row)
    }

    /// A row; the nearest one if it lies beyond the border.
    pub fn row(&self, y: isize) -> &[f32] {
        let y = y.clamp(0, self.height as isize - 1) as usize;
        &self.values[y * self.width..][..self.width]
    }

    /// The value of a pixel; that of the nearest one if it lies beyond the border.
    pub fn at(&self, x: isize, y: isize) -> f32 {
        self.row(y)[x.clamp(0, self.width as isize - 1) as usize]
    }

    /// A plane of one value for each pair of values.
    pub fn with(&self, other: &Plane, value: impl Fn(f32, f32) -> f32 + Sync) -> Plane {
        self.like(|y, out| {
            let rows = self.row(y as isize).iter().zip(other.row(y as isize));
            out.iter_mut().zip(rows).for_each(|(out, (a, b))| *out = value(*a, *b));
        })
    }

    /// The greatest value in the square of `2 radius + 1` pixels around each pixel.
    pub fn maxima(&self, radius: usize) -> Plane {
        self.extremes(radius, |a, b| if b > a { b } else { a })
    }

    /// The least value in that square.
    pub fn minima(&self, radius: usize) -> Plane {
        self.extremes(radius, |a, b| if b < a { b } else { a })
    }

    /// The extreme value in that square. An extreme of 2, 4, 8 ... neighbours is one of two extremes of half as many,
    /// and windows that overlap are as good as those that do not.
    fn extremes(&self, radius: usize, of: impl Fn(f32, f32) -> f32 + Sync) -> Plane {
        let window = 2 * radius + 1;
        let doublings =
            || std::iter::successors(Some(1), |step| Some(2 * step)).take_while(|step| 2 * step <= window);
        let largest = doublings().last().map_or(1, |step| 2 * step);
        let across = self.like(|y, out| {
            let row = self.row(y as isize);
            let mut padded = Vec::with_capacity(row.len() + 2 * radius);
            padded.extend(std::iter::repeat_n(row[0], radius));
            padded.extend_from_slice(row);
            padded.extend(std::iter::repeat_n(row[row.len() - 1], radius));
            let mut next = Vec::with_capacity(padded.len());
            for step in doublings() {
                next.clear();
                next.extend(padded.iter().zip(&padded[step..]).map(|(a, b)| of(*a, *b)));
                std::mem::swap(&mut padded, &mut next);
            }
            let shifted = &padded[window - largest..];
            out.iter_mut().zip(&padded).zip(shifted).for_each(|((out, a), b)| *out = of(*a, *b));
        });
        let mut values = Buffer::unset(self.values.len());
        values.par_chunks_mut(BAND * self.width).enumerate().for_each(|(band, out)| {
            let first = (band * BAND) as isize - radius as isize;
            let rows = out.len() / self.width + 2 * radius;
            let mut padded: Vec<f32> = Vec::with_capacity(rows * self.width);
            (0..rows).for_each(|i| padded.extend_from_slice(across.row(first + i as isize)));
            let mut left = rows;
            for step in doublings() {
                left -= step;
                for row in 0..left {
                    let (above, below) = padded.split_at_mut((row + step) * self.width);
                    let above = &mut above[row * self.width..][..self.width];
                    above.iter_mut().zip(&below[..self.width]).for_each(|(a, b)| *a = of(*a, *b));
                }
            }
            let shifted = &padded[(window - largest) * self.width..];
            out.iter_mut().zip(&padded).zip(shifted).for_each(|((out, a), b)| *out = of(*a, *b));
        });
        Plane { values, ..*self }
    }

    /// The plane convolved with a Gaussian of standard deviation `sigma` pixels.
    pub fn blurred(&self, sigma: f32) -> Plane {
        self.filtered(&gaussian(sigma))
    }

    /// The plane convolved along both axes with a symmetric filter: the weights of offsets 0, 1, 2 ...
    pub fn filtered(&self, weights: &[f32]) -> Plane {
        let reach = weights.len() - 1;
        let down = self.like(|y, out| {
            let y = y as isize;
            out.iter_mut().zip(self.row(y)).for_each(|(out, v)| *out = weights[0] * v);
            for (i, w) in weights.iter().enumerate().skip(1) {
                let rows = self.row(y - i as isize).iter().zip(self.row(y + i as isize));
                out.iter_mut().zip(rows).for_each(|(out, (a, b))| *out += w * (a + b));
            }
        });
        self.like(|y, out| {
            let row = down.row(y as isize);
            let mut padded = Vec::with_capacity(row.len() + 2 * reach);
            padded.extend(std::iter::repeat_n(row[0], reach));
            padded.extend_from_slice(row);
            padded.extend(std::iter::repeat_n(row[row.len() - 1], reach));
            out.iter_mut().zip(row).for_each(|(out, v)| *out = weights[0] * v);
            for (i, w) in weights.iter().enumerate().skip(1) {
                let pairs = padded[reach - i..].iter().zip(&padded[reach + i..]);
                out.iter_mut().zip(pairs).for_each(|(out, (a, b))| *out += w * (a + b));
            }
        })
    }

    /// The plane at another size, interpolated between pixels' centres.
    pub fn resized(&self, width: usize, height: usize) -> Plane {
        let resizing = Resizing::new(self, width, height);
        Plane::of_rows(width, height, |y, out| resizing.row(y, out))
    }

    /// Means over squares of `side` pixels, whose sides are parts of the plane's.
    pub fn averaged(&self, side: usize) -> Plane {
        let scale = ((side * side) as f32).recip();
        Plane::of_rows(self.width / side, self.height / side, |y, out| {
            out.fill(0.0);
            for row in side * y..side * (y + 1) {
                let row = self.row(row as isize).chunks_exact(side);
                out.iter_mut().zip(row).for_each(|(out, part)| *out += part.iter().sum::<f32>());
            }
            out.iter_mut().for_each(|out| *out *= scale);
        })
    }

    /// The plane that linear interpolation enlarged `side` times to this one, if one did.
    fn before_enlarging(&self, side: usize) -> Plane {
        // Between the centres of its pixels, values are on a line.
        let along = |a: f32, b: f32| a - (b - a) * (0.5 - 0.5 * (side % 2) as f32);
        let first = side / 2;
        Plane::of_rows(self.width / side, self.height / side, |y, out| {
            let (above, below) =
                (self.row((side * y + first) as isize), self.row((side * y + first + 1) as isize));
            for (x, out) in out.iter_mut().enumerate() {
                let (left, right) = (side * x + first, (side * x + first + 1).min(self.width - 1));
                *out = along(along(above[left], above[right]), along(below[left], below[right]));
            }
        })
    }

    /// How many times a smaller plane was enlarged to this one by linear interpolation; 1 if that was not done.
    pub fn enlarged_by(&self, range: f32) -> usize {
        let fits = |side: &usize| {
            let whole = self.width.is_multiple_of(*side) && self.height.is_multiple_of(*side);
            whole && self.width.min(self.height) > 4 * side && {
                let small = self.before_enlarging(*side);
                let resizing = Resizing::new(&small, self.width, self.height);
                // The last columns and rows are not between two centres.
                let rows = (2 * side..self.height - 2 * side).into_par_iter();
                rows.all(|y| {
                    let mut again = vec![0.0; self.width];
                    resizing.row(y, &mut again);
                    let inside = 2 * side..self.width - 2 * side;
                    let both = self.row(y as isize)[inside.clone()].iter().zip(&again[inside]);
                    both.fold(0.0f32, |most, (a, b)| most.max((a - b).abs())) < 1e-4 * range
                })
            }
        };
        ENLARGED.into_iter().find(fits).unwrap_or(1)
    }

    /// The plane at about twice its size, each pixel of which has the value of the one that it is part of.
    pub fn doubled(&self, width: usize, height: usize) -> Plane {
        Plane::of_rows(width, height, |y, out| {
            let row = self.row((y / 2) as isize);
            out.iter_mut().enumerate().for_each(|(x, out)| *out = row[(x / 2).min(row.len() - 1)]);
        })
    }

    /// The plane at half of its size, rounded up: means of blocks of two by two pixels.
    pub fn halved(&self) -> Plane {
        Plane::of_rows(self.width.div_ceil(2), self.height.div_ceil(2), |y, out| {
            let (above, below) = (self.row(2 * y as isize), self.row(2 * y as isize + 1));
            for (x, out) in out.iter_mut().enumerate() {
                let (a, b) = (2 * x, (2 * x + 1).min(self.width - 1));
                *out = 0.25 * (above[a] + above[b] + below[a] + below[b]);
            }
        })
    }
}

impl Plane {
    /// The part of a plane that begins at (x, y), continued beyond the border.
    fn part(&self, x: isize, y: isize, width: usize, height: usize) -> Plane {
        let inside = x >= 0 && x as usize + width <= self.width;
        Plane::of_rows(width, height, |row, out| {
            let from = self.row(y + row as isize);
            if inside {
                out.copy_from_slice(&from[x as usize..][..width]);
            } else {
                let last = from.len() as isize - 1;
                out.iter_mut()
                    .enumerate()
                    .for_each(|(i, out)| *out = from[(x + i as isize).clamp(0, last) as usize]);
            }
        })
    }

    /// Writes tiles, as [`Tile::each`] gives them, over the plane. What is none stays as it is.
    pub fn write_tiles<'a>(&mut self, margin: usize, tiles: impl Iterator<Item = Option<&'a Plane>>) {
        let across = self.width.div_ceil(TILE.0);
        for (i, tile) in tiles.enumerate() {
            let Some(tile) = tile else { continue };
            let (x, y) = (i % across * TILE.0, i / across * TILE.1);
            let (width, height) = (tile.width - 2 * margin, tile.height - 2 * margin);
            for row in 0..height {
                let from = &tile.values[(row + margin) * tile.width + margin..][..width];
                self.values[(y + row) * self.width + x..][..width].copy_from_slice(from);
            }
        }
    }

    /// The least and the greatest value.
    pub fn range(&self) -> (f32, f32) {
        let [low, high] = range(&self.values);
        (low, high)
    }
}

/// The way from a plane to one of another size, row by row.
struct Resizing<'a> {
    from: &'a Plane,
    /// Two columns, and the second's share.
    columns: Vec<(usize, usize, f32)>,
    step_y: f64,
}

impl Resizing<'_> {
    fn new(from: &Plane, width: usize, height: usize) -> Resizing<'_> {
        let step_x = from.width as f64 / width as f64;
        let column = |x: usize| {
            let (first, fraction) = Resizing::place(x, step_x);
            let clamped = |i: isize| i.clamp(0, from.width as isize - 1) as usize;
            (clamped(first), clamped(first + 1), fraction)
        };
        let columns = (0..width).map(column).collect();
        Resizing { from, columns, step_y: from.height as f64 / height as f64 }
    }

    fn place(i: usize, step: f64) -> (isize, f32) {
        let at = (i as f64 + 0.5) * step - 0.5;
        (at.floor() as isize, (at - at.floor()) as f32)
    }

    fn row(&self, y: usize, out: &mut [f32]) {
        let (first, fraction) = Resizing::place(y, self.step_y);
        let (above, below) = (self.from.row(first), self.from.row(first + 1));
        for (out, (a, b, across)) in out.iter_mut().zip(&self.columns) {
            let mix = |row: &[f32]| row[*a] + across * (row[*b] - row[*a]);
            let (above, below) = (mix(above), mix(below));
            *out = above + fraction * (below - above);
        }
    }
}

/// One tile of several planes: its pixels and those `margin` around them.
pub struct Tile<const N: usize> {
    /// The parts of the planes.
    pub planes: [Plane; N],
    /// Pixels around the tile.
    pub margin: usize,
}

impl<const N: usize> Tile<N> {
    /// The tiles of planes of one size, with what a function gives for each, in the order of rows.
    pub fn each<T: Send>(planes: [&Plane; N], margin: usize, of: impl Fn(Tile<N>) -> T + Sync) -> Vec<T> {
        let Plane { width, height, .. } = *planes[0];
        let across = width.div_ceil(TILE.0);
        let tile = |i: usize| {
            let (x, y) = (i % across * TILE.0, i / across * TILE.1);
            let (width, height) = (TILE.0.min(width - x), TILE.1.min(height - y));
            let margins = 2 * margin;
            let part = |plane: &Plane| {
                plane.part(
                    x as isize - margin as isize,
                    y as isize - margin as isize,
                    width + margins,
                    height + margins,
                )
            };
            of(Tile { planes: planes.map(part), margin })
        };
        (0..across * height.div_ceil(TILE.1)).into_par_iter().map(tile).collect()
    }
}

/// The weights of a Gaussian of standard deviation `sigma` pixels, cut off at three of them.
pub fn gaussian(sigma: f32) -> Vec<f32> {
    let reach = (3.0 * sigma).ceil() as usize;
    normalized((0..=reach).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect())
}

/// The weights of a mean over `width` pixels. The outermost ones count as far as they are within it.
pub fn mean(width: f32) -> Vec<f32> {
    let reach = (0.5 * width + 0.5).ceil() as usize;
    normalized((0..=reach).map(|i| (0.5 * width + 0.5 - i as f32).clamp(0.0, 1.0)).collect())
}

/// The weights of a symmetric filter, of which the sum over both sides is 1.
fn normalized(weights: Vec<f32>) -> Vec<f32> {
    let total = weights[0] + 2.0 * weights[1..].iter().sum::<f32>();
    weights.iter().map(|w| w / total).collect()
}

/// 0 up to `from`, 1 from `to` on, and a smooth transition in between.
#[inline(always)]
pub fn fade(v: f32, from: f32, to: f32) -> f32 {
    let t = ((v - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
