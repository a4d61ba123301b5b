// The blur along x: every tap is weighted by the amount by which its blurriness exceeds its threshold. The result is
// weighted sums, and their weights.

struct Params {
    half: vec2<u32>,
    count: u32,
    centre_threshold: f32,
}

// A tap between texels `whole` and `whole + 1`, on both sides of the centre.
struct Tap {
    whole: i32,
    fraction: f32,
    threshold: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> half_color: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> half_blurriness: array<f32>;
@group(0) @binding(3) var<storage, read> taps: array<Tap>;
@group(0) @binding(4) var<storage, read_write> sum_color: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> sum_weight: array<f32>;

// Weighted colours, and their weight.
struct Weighted {
    color: vec4<f32>,
    total: f32,
}

// Adds a tap between two texels of a row to a sum.
fn with_tap(sum: Weighted, row: u32, near: i32, far: i32, fraction: f32, threshold: f32) -> Weighted {
    let a = row + u32(mirrored(near, i32(params.half.x)));
    let b = row + u32(mirrored(far, i32(params.half.x)));
    let blurriness = half_blurriness[a] + fraction * (half_blurriness[b] - half_blurriness[a]);
    let weight = clamp(blurriness - threshold, 0.0, 1.0);
    let tap_color = half_color[a] + fraction * (half_color[b] - half_color[a]);
    return Weighted(sum.color + weight * tap_color, sum.total + weight);
}

@compute @workgroup_size(16, 16)
fn blur_x(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.half) {
        return;
    }
    let row = id.y * params.half.x;
    let x = i32(id.x);
    var sum = with_tap(Weighted(), row, x, x, 0.0, params.centre_threshold);
    for (var i = 0u; i < params.count; i++) {
        let tap = taps[i];
        sum = with_tap(sum, row, x + tap.whole, x + tap.whole + 1, tap.fraction, tap.threshold);
        sum = with_tap(sum, row, x - tap.whole, x - tap.whole - 1, tap.fraction, tap.threshold);
    }
    sum_color[row + id.x] = sum.color;
    sum_weight[row + id.x] = sum.total;
}
