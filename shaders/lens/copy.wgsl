// Tiles in focus, as the pinhole sees them: their layers composited.

struct Params {
    size: vec2<u32>,
    layers: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// The first pixel of each tile.
@group(0) @binding(3) var<storage, read> tiles: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> picture: array<f32>;

fn composed(pixel: u32) -> vec4<f32> {
    let layer = CHANNELS * params.size.x * params.size.y;
    var sum = color_at(params.size, pixel);
    var left = 1.0 - sum[CHANNELS - 1u];
    for (var i = 1u; i < params.layers; i++) {
        let behind = color_at(params.size, i * layer + pixel);
        sum += left * behind;
        left *= 1.0 - behind[CHANNELS - 1u];
    }
    return sum;
}

@compute @workgroup_size(64, 4)
fn copy(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) thread: vec3<u32>) {
    let at = tiles[group.x] + vec2(thread.x, 4u * group.y + thread.y);
    if any(at >= params.size) {
        return;
    }
    let pixel = at.y * params.size.x + at.x;
    let value = composed(pixel);
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
