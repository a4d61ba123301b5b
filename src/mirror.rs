//! The mirror image of the picture beyond its border.

/// Half-sample symmetric extension, at any distance: `.. 1 0 | 0 1 2 .. n-1 | n-1 n-2 ..`. Returns the index, and
/// whether it is a mirror image.
pub fn mirrored(i: i64, n: usize) -> (usize, bool) {
    let i = i.rem_euclid(2 * n as i64) as usize;
    if i < n { (i, false) } else { (2 * n - 1 - i, true) }
}

/// Fills `out` with a row, starting at index `first`; the row is mirrored at its ends.
pub fn read_mirrored(row: &[f32], first: i64, out: &mut [f32]) {
    let inside = |i: i64| (i - first).clamp(0, out.len() as i64) as usize;
    let (start, end) = (inside(0), inside(row.len() as i64));
    if start < end {
        out[start..end].copy_from_slice(&row[(first + start as i64) as usize..][..end - start]);
    }
    for i in (0..start).chain(end.max(start)..out.len()) {
        out[i] = row[mirrored(first + i as i64, row.len()).0];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrors_repeat_the_edge_pixel() {
        let at = |i| mirrored(i, 3).0;
        assert_eq!((-7..10).map(at).collect::<Vec<_>>(), [0, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2]);
        assert_eq!((-2..2).map(|i| mirrored(i, 1).0).collect::<Vec<_>>(), [0; 4]);
    }

    #[test]
    fn rows_are_read_with_their_mirror_image() {
        let row: Vec<f32> = (0..7).map(|x| x as f32).collect();
        for (first, n) in [(-3, 5), (-9, 40), (2, 3), (5, 6), (11, 4)] {
            let mut out = vec![-1.0; n];
            read_mirrored(&row, first, &mut out);
            let expected = (0..n).map(|i| mirrored(first + i as i64, 7).0 as f32);
            assert_eq!(out, expected.collect::<Vec<_>>());
        }
    }
}
