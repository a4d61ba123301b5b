// The cells of all layers, one layer after another: `index_in(size, x, y)` within each.

// The shift of empty cells.
const NOWHERE: f32 = 1e30;

// The depth span of a cell, from the code in the low half to the code in the high half. Both are 0 if it is empty.
fn farthest(codes: u32) -> u32 {
    return codes & 0xffffu;
}

fn nearest(codes: u32) -> u32 {
    return codes >> 16u;
}

// Rounds to the nearest integer, halves away from zero.
fn rounded(v: f32) -> f32 {
    return sign(v) * floor(abs(v) + 0.5);
}

// The part of a pixel that a cell covers, on one side of a line: the line's normal, and its distance from the centre.
struct HalfPlane {
    normal: vec2<f32>,
    cut: f32,
}

// For each axis, -1 if a position is mirrored along it.
fn mirroring(size: vec2<u32>, x: i32, y: i32) -> vec2<f32> {
    let flipped = vec2<bool>(is_mirrored(x, i32(size.x)), is_mirrored(y, i32(size.y)));
    return select(vec2<f32>(1.0), vec2<f32>(-1.0), flipped);
}

fn is_mirrored(i: i32, n: i32) -> bool {
    let period = 2 * n;
    return ((i % period) + period) % period >= n;
}
