// The blur along y of both the weighted sums and the weights, followed by the division of the sums by the weights.

struct Params {
    half: vec2<u32>,
    reach: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> sum_color: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sum_weight: array<f32>;
// Weights of the texels by their distance.
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read_write> blurred: array<vec4<f32>>;

fn texel(x: u32, y: i32) -> u32 {
    return u32(mirrored(y, i32(params.half.y))) * params.half.x + x;
}

@compute @workgroup_size(16, 16)
fn blur_y(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.half) {
        return;
    }
    let own = id.y * params.half.x + id.x;
    var total_color = weights[0] * sum_color[own];
    var total_weight = weights[0] * sum_weight[own];
    for (var distance = 1u; distance <= params.reach; distance++) {
        let above = texel(id.x, i32(id.y) - i32(distance));
        let below = texel(id.x, i32(id.y) + i32(distance));
        total_color += weights[distance] * (sum_color[above] + sum_color[below]);
        total_weight += weights[distance] * (sum_weight[above] + sum_weight[below]);
    }
    blurred[own] = total_color / total_weight;
}
