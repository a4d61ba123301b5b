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
