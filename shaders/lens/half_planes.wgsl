// What cells that cover their pixel only partly cover of it: `half_planes` has for each cell 0, or one more than the index
// of its half-plane; then the half-planes.

// The part of a pixel on one side of a line: the line's normal and its distance from the centre, and the fraction of light
// that this part stops.
struct HalfPlane {
    normal: vec2<f32>,
    cut: f32,
    opacity: f32,
}

// The half-plane of a number above 0, as it is at a position that may be mirrored.
fn half_plane(number: u32, at: vec2<i32>) -> HalfPlane {
    let first = params.layers * params.size.x * params.size.y + 4u * (number - 1u);
    let normal = vec2(bitcast<f32>(half_planes[first]), bitcast<f32>(half_planes[first + 1u]));
    return HalfPlane(
        normal * mirroring(params.size, at.x, at.y),
        bitcast<f32>(half_planes[first + 2u]),
        bitcast<f32>(half_planes[first + 3u]),
    );
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
