//! Which neighbouring pixels lie on one surface, and where surfaces end.

use rayon::prelude::*;

/// Two neighbours closer than this in shift belong together: within half a pixel of either's own place.
pub const CONNECTED_PX: f32 = 1.0;

/// How far a surface may leave its own linear continuation and still be the same surface. The disparity of a
/// plane is linear over the picture, so a plane however steep continues itself exactly.
const CONTINUES_PX: f32 = 0.5;

/// The pixel and its right neighbour are on one surface.
pub const RIGHT: u8 = 1;
/// The pixel and the one below it are on one surface.
pub const DOWN: u8 = 2;
/// A surface ends somewhere in the pixel's 3x3 neighbourhood: its colour may mix two surfaces.
pub const EDGE: u8 = 4;

/// Whether neighbours with shifts `a` and `b` are on one surface, `before` and `after` being the next ones on
/// the line through them.
fn connected(before: f32, a: f32, b: f32, after: f32) -> bool {
    (b - a).abs() < CONNECTED_PX
        || (b - (2.0 * a - before)).abs() < CONTINUES_PX
        || (a - (2.0 * b - after)).abs() < CONTINUES_PX
}

/// `RIGHT`, `DOWN` and `EDGE` of every pixel.
pub fn links(s: &[f32], width: usize, height: usize) -> Vec<u8> {
    let at = |x: usize, y: usize| s[y * width + x];
    let mut links = vec![0u8; s.len()];
    links.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let a = at(x, y);
            let mut bits = 0;
            // Beyond the frame there is no edge; a missing `before` or `after` predicts a flat surface.
            if x + 1 == width
                || connected(at(x.saturating_sub(1), y), a, at(x + 1, y), at((x + 2).min(width - 1), y))
            {
                bits |= RIGHT;
            }
            if y + 1 == height
                || connected(at(x, y.saturating_sub(1)), a, at(x, y + 1), at(x, (y + 2).min(height - 1)))
            {
                bits |= DOWN;
            }
            *out = bits;
        }
    });

    // A broken link makes edges of all pixels whose 3x3 neighbourhood holds it: spread along rows, then columns.
    let broken_in_row: Vec<u8> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let row = &links[y * width..][..width];
            (0..width).map(move |x| {
                let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
                // The links between columns left..right of this row; the last column's RIGHT leads out.
                let across = row[left..right].iter().any(|l| l & RIGHT == 0);
                let down = row[left..=right].iter().any(|l| l & DOWN == 0);
                u8::from(across) | (u8::from(down) << 1)
            })
        })
        .collect();
    links.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let at = |y: usize| broken_in_row[y * width + x];
            let above = y.checked_sub(1).map_or(0, at);
            let below = if y + 1 < height { at(y + 1) & 1 } else { 0 };
            if above | at(y) | below != 0 {
                *out |= EDGE;
            }
        }
    });
    links
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steep_plane_is_one_surface_and_a_step_is_an_edge() {
        let (w, h) = (12, 5);
        let plane: Vec<f32> = (0..w * h).map(|i| 3.0 * (i % w) as f32 - 2.0 * (i / w) as f32).collect();
        assert!(links(&plane, w, h).iter().all(|&l| l == RIGHT | DOWN));

        let step: Vec<f32> = (0..w * h).map(|i| if i % w < 6 { 0.0 } else { 9.0 }).collect();
        for (i, l) in links(&step, w, h).iter().enumerate() {
            assert_eq!(l & EDGE != 0, (4..8).contains(&(i % w)), "column {}", i % w);
            assert_eq!(l & RIGHT == 0, i % w == 5);
        }
    }
}
