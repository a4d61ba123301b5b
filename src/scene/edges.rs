//! Depth discontinuities: which neighbouring pixels lie on one surface, and where surfaces end.

use rayon::prelude::*;

/// Neighbours whose shifts differ by less are on one surface: half-way between them is within half a pixel of either.
pub const CONNECTED_PX: f32 = 1.0;

/// Tolerance for the linear continuation of a surface: neighbours that deviate less are still on one surface. The
/// disparity of a plane is linear over the picture, so the continuation of a plane is exact, however steep it is.
const CONTINUES_PX: f32 = 0.5;

/// The pixel and its right neighbour are on one surface.
pub const RIGHT: u8 = 1;
/// The pixel and the one below it are on one surface.
pub const DOWN: u8 = 2;
/// A surface ends somewhere in the pixel's 3x3 neighbourhood: its colour may mix two surfaces.
pub const EDGE: u8 = 4;

/// How far neighbours with shifts `a` and `b` are apart, in units of what neighbours on one surface may be. `before` and
/// `after` are the next pixels on the line through them.
fn distance(before: f32, a: f32, b: f32, after: f32) -> f32 {
    let step = (b - a).abs() / CONNECTED_PX;
    let forward = (b - (2.0 * a - before)).abs() / CONTINUES_PX;
    let backward = (a - (2.0 * b - after)).abs() / CONTINUES_PX;
    step.min(forward).min(backward)
}

/// Whether neighbours are on one surface.
pub fn connected(before: f32, a: f32, b: f32, after: f32) -> bool {
    distance(before, a, b, after) < 1.0
}

/// Neighbours are on different surfaces in part from the limit up to which they are [`connected`] on, and entirely from
/// this multiple of it on. Over a quarter of a pixel of shift, noise of a few hundredths makes no step.
const ENTIRELY_APART: f32 = 1.25;

/// How much neighbours are on different surfaces.
fn apart(before: f32, a: f32, b: f32, after: f32) -> f32 {
    ((distance(before, a, b, after) - 1.0) / (ENTIRELY_APART - 1.0)).clamp(0.0, 1.0)
}

/// How much a surface ends in the 3x3 neighbourhood of pixel `(x, y)`: more than 0 where [`EDGE`] is set, and 1 where the
/// step is [`ENTIRELY_APART`] times as large as it need be for that.
pub fn strength(s: &[f32], width: usize, height: usize, x: usize, y: usize) -> f32 {
    let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
    let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
    let at = |x: usize, y: usize| s[y * width + x];
    let along = |x: usize, y: usize| {
        apart(at(x.saturating_sub(1), y), at(x, y), at(x + 1, y), at((x + 2).min(width - 1), y))
    };
    let across = |x: usize, y: usize| {
        apart(at(x, y.saturating_sub(1)), at(x, y), at(x, y + 1), at(x, (y + 2).min(height - 1)))
    };
    let mut strength = 0.0f32;
    for y in rows.clone() {
        for x in columns.clone() {
            if x < *columns.end() {
                strength = strength.max(along(x, y));
            }
            if y < *rows.end() {
                strength = strength.max(across(x, y));
            }
        }
    }
    strength
}

/// `RIGHT`, `DOWN` and `EDGE` of every pixel.
pub fn connectivity(s: &[f32], width: usize, height: usize) -> Vec<u8> {
    let mut connectivity = vec![RIGHT | DOWN; s.len()];
    let broken: Vec<(usize, u8)> = connectivity
        .par_chunks_mut(width)
        .enumerate()
        .flat_map_iter(|(y, row)| {
            let broken = broken_connections(s, width, height, y);
            for &(i, bit) in &broken {
                row[i - y * width] &= !bit;
            }
            broken
        })
        .collect();
    // A broken connection makes edge pixels of all pixels whose 3x3 neighbourhood contains it.
    for (i, bit) in broken {
        let (x, y) = (i % width, i / width);
        let (columns, rows) = if bit == RIGHT {
            (x..=x + 1, y.saturating_sub(1)..=(y + 1).min(height - 1))
        } else {
            (x.saturating_sub(1)..=(x + 1).min(width - 1), y..=y + 1)
        };
        for y in rows {
            for x in columns.clone() {
                connectivity[y * width + x] |= EDGE;
            }
        }
    }
    connectivity
}

/// The positions at which two rows of shifts differ by more than neighbours on one surface may. Such positions are
/// rare, so whole groups are tested first.
fn steps(a: &[f32], b: &[f32]) -> Vec<usize> {
    const GROUP: usize = 32;
    let far = |a: &f32, b: &f32| (b - a).abs() >= CONNECTED_PX;
    let mut steps = Vec::new();
    for (i, (a, b)) in a.chunks(GROUP).zip(b.chunks(GROUP)).enumerate() {
        if a.iter().zip(b).fold(false, |any, (a, b)| any | far(a, b)) {
            let here = a.iter().zip(b).enumerate().filter(|(_, (a, b))| far(a, b));
            steps.extend(here.map(|(x, _)| i * GROUP + x));
        }
    }
    steps
}

/// The connections of row `y` that do not join one surface, as pixel and bit.
fn broken_connections(s: &[f32], width: usize, height: usize, y: usize) -> Vec<(usize, u8)> {
    let row = &s[y * width..][..width];
    let mut broken = Vec::new();
    // At the border, where `before` or `after` is missing, the prediction is a surface of constant disparity.
    for x in steps(row, &row[1..]) {
        if !connected(row[x.saturating_sub(1)], row[x], row[x + 1], row[(x + 2).min(width - 1)]) {
            broken.push((y * width + x, RIGHT));
        }
    }
    if y + 1 < height {
        let below = &s[(y + 1) * width..][..width];
        let before = &s[y.saturating_sub(1) * width..][..width];
        let after = &s[(y + 2).min(height - 1) * width..][..width];
        for x in steps(row, below) {
            if !connected(before[x], row[x], below[x], after[x]) {
                broken.push((y * width + x, DOWN));
            }
        }
    }
    broken
}

/// The largest distance that [`distance_to_edges`] can represent.
pub const FAR_PX: u8 = 48;
/// Rows whose distances are found together.
const BAND: usize = 96;

/// Chessboard distance in pixels to the nearest edge pixel, up to [`FAR_PX`].
pub fn distance_to_edges(connectivity: &[u8], width: usize) -> Vec<u8> {
    let rows = connectivity.len() / width;
    let mut distance = vec![FAR_PX; connectivity.len()];
    distance.par_chunks_mut(width * BAND).enumerate().for_each(|(band, out)| {
        // Edges in the neighbouring bands matter up to the largest distance that can be represented.
        let first = (band * BAND).saturating_sub(usize::from(FAR_PX));
        let end = ((band + 1) * BAND + usize::from(FAR_PX)).min(rows);
        let near = &connectivity[first * width..end * width];
        if near.iter().fold(0, |all, l| all | l) & EDGE == 0 {
            return;
        }
        let mut d: Vec<u8> = near.iter().map(|l| if l & EDGE != 0 { 0 } else { FAR_PX }).collect();
        // Two sweeps. Each propagates distances from the previous row and along the row.
        for y in 0..end - first {
            let (before, row) = d.split_at_mut(y * width);
            carry_over(before.rchunks(width).next(), &mut row[..width]);
            let mut last = FAR_PX;
            row[..width].iter_mut().for_each(|d| carry_on(&mut last, d));
        }
        for y in (0..end - first).rev() {
            let (row, after) = d[y * width..].split_at_mut(width);
            carry_over(after.chunks(width).next(), row);
            let mut last = FAR_PX;
            row.iter_mut().rev().for_each(|d| carry_on(&mut last, d));
        }
        let own = (band * BAND - first) * width;
        out.copy_from_slice(&d[own..own + out.len()]);
    });
    distance
}

/// Updates the distances of a row from those of an adjacent row.
fn carry_over(beside: Option<&[u8]>, row: &mut [u8]) {
    let Some(beside) = beside else { return };
    let n = row.len();
    for (d, near) in row.iter_mut().zip(beside) {
        *d = (*d).min(near + 1);
    }
    for (d, near) in row[1..].iter_mut().zip(&beside[..n - 1]) {
        *d = (*d).min(near + 1);
    }
    for (d, near) in row[..n - 1].iter_mut().zip(&beside[1..]) {
        *d = (*d).min(near + 1);
    }
}

/// Updates the distance of a pixel from that of the previous pixel in the row.
fn carry_on(last: &mut u8, d: &mut u8) {
    *d = (*d).min(*last + 1);
    *last = *d;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_edge_begins_with_no_strength() {
        let (w, h) = (12, 5);
        for (height, expected) in
            [(0.9, 0.0), (1.0, 0.0), (1.001, 0.004), (1.125, 0.5), (1.25, 1.0), (9.0, 1.0)]
        {
            let step: Vec<f32> = (0..w * h).map(|i| if i % w < 6 { 0.0 } else { height }).collect();
            let connectivity = connectivity(&step, w, h);
            for (i, l) in connectivity.iter().enumerate() {
                let beside = (5..7).contains(&(i % w));
                let found = strength(&step, w, h, i % w, i / w);
                assert!((found - if beside { expected } else { 0.0 }).abs() < 1e-3, "{height}: {found}");
                assert!(found == 0.0 || l & EDGE != 0);
            }
        }
    }

    proptest! {
        #[test]
        fn what_is_not_connected_is_at_an_edge(s in prop::collection::vec(0.0..4.0f32, 9 * 7), scale in 0.2..2.0f32) {
            let (w, h) = (9, 7);
            let s: Vec<f32> = s.iter().map(|s| scale * s).collect();
            let connectivity = connectivity(&s, w, h);
            for i in 0..w * h {
                for (inside, bit, beside) in [(i % w + 1 < w, RIGHT, i + 1), (i / w + 1 < h, DOWN, i + w)] {
                    if inside && connectivity[i] & bit == 0 {
                        prop_assert!(connectivity[i] & connectivity[beside] & EDGE != 0, "{i} {bit}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_steep_plane_is_one_surface_and_a_step_is_an_edge() {
        let (w, h) = (12, 5);
        let plane: Vec<f32> = (0..w * h).map(|i| 3.0 * (i % w) as f32 - 2.0 * (i / w) as f32).collect();
        assert!(connectivity(&plane, w, h).iter().all(|&l| l == RIGHT | DOWN));

        let step: Vec<f32> = (0..w * h).map(|i| if i % w < 6 { 0.0 } else { 9.0 }).collect();
        for (i, l) in connectivity(&step, w, h).iter().enumerate() {
            assert_eq!(l & EDGE != 0, (5..7).contains(&(i % w)), "column {}", i % w);
            assert_eq!(l & RIGHT == 0, i % w == 5);
        }
        for (i, d) in distance_to_edges(&connectivity(&step, w, h), w).iter().enumerate() {
            assert_eq!(usize::from(*d), (5usize.saturating_sub(i % w)).max((i % w).saturating_sub(6)));
        }
    }
}
