//! A frame cut into tiles that workers fill independently.

use crate::picture::Size;

/// A rectangle of an interleaved frame.
pub struct Tile<'a> {
    /// Column and row of its first pixel.
    pub origin: (usize, usize),
    /// Its rows.
    pub rows: Vec<&'a mut [f32]>,
}

/// Cuts an interleaved frame into tiles of `columns` x `rows` pixels, smaller at the right and bottom, in scan order.
pub fn split(frame: &mut [f32], size: Size, (columns, rows): (usize, usize)) -> Vec<Tile<'_>> {
    let length = size.width * size.channels;
    let mut tiles: Vec<Tile> = Vec::new();
    for (band, lines) in frame.chunks_mut(length * rows).enumerate() {
        let first = tiles.len();
        tiles.extend(
            (0..size.width).step_by(columns).map(|x| Tile { origin: (x, band * rows), rows: Vec::new() }),
        );
        for line in lines.chunks_mut(length) {
            for (tile, piece) in tiles[first..].iter_mut().zip(line.chunks_mut(columns * size.channels)) {
                tile.rows.push(piece);
            }
        }
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_every_value_once() {
        let size = Size { width: 7, height: 5, channels: 2 };
        let mut frame = vec![0.0; size.pixels() * size.channels];
        for tile in split(&mut frame, size, (3, 2)) {
            for (y, row) in tile.rows.into_iter().enumerate() {
                for (i, v) in row.iter_mut().enumerate() {
                    *v += ((tile.origin.1 + y) * size.width * 2 + tile.origin.0 * 2 + i) as f32;
                }
            }
        }
        assert!(frame.iter().enumerate().all(|(i, v)| *v == i as f32));
    }
}
