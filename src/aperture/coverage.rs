//! The exact area of every pixel that a closed polygon covers.

/// A square of pixels around the origin, and the area of each that polygons cover.
///
/// The area of a polygon to the left of a position in a row is a sum over its edges. An edge that goes down by `h`
/// inside a pixel adds `h` to all pixels to its right, and to its own pixel the part to the right of the edge. So an
/// edge only changes the one or two pixels that it touches, and a running sum along each row completes the areas.
pub struct Coverage {
    reach: i32,
    side: usize,
    marks: Vec<f64>,
}

impl Coverage {
    /// Pixels up to `reach` away from the origin along either axis.
    pub fn new(reach: i32) -> Coverage {
        let side = (2 * reach + 1) as usize;
        // One more column, for the contributions to the right of the last one.
        Coverage { reach, side, marks: vec![0.0; (side + 1) * side] }
    }

    /// Adds a closed polygon with a weight; its corners run counter-clockwise on screen (y points down).
    pub fn add(&mut self, polygon: &[[f64; 2]], weight: f64) {
        // Pixel centres have integer coordinates in the polygon; here pixel corners have.
        let first = f64::from(self.reach) + 0.5;
        let shifted = |p: [f64; 2]| p.map(|v| v + first);
        for (i, &a) in polygon.iter().enumerate() {
            self.edge(shifted(a), shifted(polygon[(i + 1) % polygon.len()]), weight);
        }
    }

    fn edge(&mut self, a: [f64; 2], b: [f64; 2], weight: f64) {
        if a[1] == b[1] {
            return;
        }
        let (top, bottom, sign) = if a[1] < b[1] { (a, b, weight) } else { (b, a, -weight) };
        let slope = (bottom[0] - top[0]) / (bottom[1] - top[1]);
        let last = self.side - 1;
        let (mut y, mut x) = (top[1], top[0]);
        let mut row = (y as usize).min(last);
        while y < bottom[1] {
            // To the end of the row, of the column or of the edge, whichever comes first.
            let column = ((x + 1e-12 * slope.signum()).max(0.0) as usize).min(last);
            let column_end = if slope > 0.0 { column as f64 + 1.0 } else { column as f64 };
            let in_column = if slope == 0.0 { f64::INFINITY } else { (column_end - x) / slope };
            let row_end = if row == last { f64::INFINITY } else { row as f64 + 1.0 };
            let to_y = bottom[1].min(row_end).min(y + in_column.max(1e-12));
            let to_x = if to_y == bottom[1] { bottom[0] } else { top[0] + (to_y - top[1]) * slope };
            let height = sign * (to_y - y);
            let from_left = 0.5 * (x + to_x) - column as f64;
            let mark = row * (self.side + 1) + column;
            self.marks[mark] += height * (1.0 - from_left);
            self.marks[mark + 1] += height * from_left;
            (y, x) = (to_y, to_x);
            if y >= row_end {
                row += 1;
            }
        }
    }

    /// The covered area of every pixel, row by row.
    pub fn finish(mut self) -> Vec<f64> {
        /// The largest area that rounding alone can leave of a pixel outside the polygon.
        const NOTHING: f64 = 1e-11;
        let mut areas = Vec::with_capacity(self.side * self.side);
        for row in self.marks.chunks_mut(self.side + 1) {
            let mut sum = 0.0;
            areas.extend(row[..self.side].iter().map(|mark| {
                sum += mark;
                if sum.abs() < NOTHING { 0.0 } else { sum }
            }));
        }
        areas
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_covers_the_products_of_its_sides() {
        let mut coverage = Coverage::new(2);
        let (x0, x1, y0, y1) = (-1.2, 0.9, -0.3, 1.7);
        coverage.add(&[[x0, y0], [x0, y1], [x1, y1], [x1, y0]], 1.0);
        let share =
            |v: i32, from: f64, to: f64| (to.min(f64::from(v) + 0.5) - from.max(f64::from(v) - 0.5)).max(0.0);
        for (i, area) in coverage.finish().into_iter().enumerate() {
            let (x, y) = (i as i32 % 5 - 2, i as i32 / 5 - 2);
            assert!((area - share(x, x0, x1) * share(y, y0, y1)).abs() < 1e-12, "({x}, {y}): {area}");
        }
    }

    #[test]
    fn a_triangle_is_covered_as_fine_points_say() {
        let triangle = [[-2.3, -1.9], [-0.7, 2.4], [2.2, -0.4]];
        let mut coverage = Coverage::new(3);
        coverage.add(&triangle, 2.0);
        let inside = |p: [f64; 2]| {
            (0..3).all(|i| {
                let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
                (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0
            })
        };
        const N: usize = 200;
        let fine = |i: usize| (i as f64 + 0.5) / N as f64 - 0.5;
        for (i, area) in coverage.finish().into_iter().enumerate() {
            let (x, y) = ((i as i32 % 7 - 3) as f64, (i as i32 / 7 - 3) as f64);
            let hits = (0..N * N).filter(|&k| inside([x + fine(k % N), y + fine(k / N)])).count();
            let expected = 2.0 * hits as f64 / (N * N) as f64;
            assert!((area - expected).abs() < 0.01, "({x}, {y}): {area} against {expected}");
        }
    }
}
