// The picture at another size, which may differ between channels: plan/magnify.rs.

struct Params {
    size: vec2<u32>,
}

// The source of a row or column: four neighbours, and their weights.
struct Source {
    places: vec4<u32>,
    weights: vec4<f32>,
}

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> rendered: array<f32>;
// For each channel, the sources of all columns, then those of all rows.
@group(0) @binding(2) var<storage, read> sources: array<Source>;
@group(0) @binding(3) var<storage, read_write> picture: array<f32>;

// One channel of a pixel, limited to the range of the four source pixels around its position.
fn magnified(at: vec2<u32>, c: u32) -> f32 {
    let first = c * (params.size.x + params.size.y);
    let across = sources[first + at.x];
    let down = sources[first + params.size.x + at.y];
    var sum = 0.0;
    var least = 3e38;
    var greatest = -3e38;
    for (var j = 0u; j < 4u; j++) {
        var row = 0.0;
        for (var i = 0u; i < 4u; i++) {
            let v = rendered[(down.places[j] * params.size.x + across.places[i]) * CHANNELS + c];
            row += across.weights[i] * v;
            if (i == 1u || i == 2u) && (j == 1u || j == 2u) {
                least = min(least, v);
                greatest = max(greatest, v);
            }
        }
        sum += down.weights[j] * row;
    }
    return clamp(sum, least, greatest);
}

@compute @workgroup_size(16, 16)
fn magnify(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    for (var c = 0u; c < CHANNELS; c++) {
        picture[(id.y * params.size.x + id.x) * CHANNELS + c] = magnified(id.xy, c);
    }
}
