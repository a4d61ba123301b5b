// The mirror image of a frame beyond its border.

// Half-sample symmetric extension, at any distance: .. 1 0 | 0 1 2 .. n-1 | n-1 n-2 ..
fn mirrored(i: i32, n: i32) -> i32 {
    if i >= 0 && i < n {
        return i;
    }
    let period = 2 * n;
    let place = ((i % period) + period) % period;
    return select(period - 1 - place, place, place < n);
}

// The index of a pixel in a plane of a frame.
fn index_in(size: vec2<u32>, x: i32, y: i32) -> u32 {
    return u32(mirrored(y, i32(size.y))) * size.x + u32(mirrored(x, i32(size.x)));
}
