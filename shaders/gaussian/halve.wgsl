// The half-size copy: means of two by two pixels, of both colours and blurriness.

struct Params {
    size: vec2<u32>,
    half: vec2<u32>,
    @align(16) defocus: Defocus,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read_write> half_color: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> half_blurriness: array<f32>;

fn blurriness(pixel: u32) -> f32 {
    return min(abs(defocus_at(params.defocus, disparity[pixel])), 1.0);
}

// The sums of two pixels of a row.
struct Pair {
    color: vec4<f32>,
    blurriness: f32,
}

fn pair_at(x: i32, y: i32) -> Pair {
    let left = index_in(params.size, x, y);
    let right = index_in(params.size, x + 1, y);
    return Pair(
        color_at(params.size, left) + color_at(params.size, right),
        blurriness(left) + blurriness(right),
    );
}

@compute @workgroup_size(16, 16)
fn halve(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.half) {
        return;
    }
    let at = 2 * vec2<i32>(id.xy);
    let above = pair_at(at.x, at.y);
    let below = pair_at(at.x, at.y + 1);
    let texel = id.y * params.half.x + id.x;
    half_color[texel] = 0.25 * (above.color + below.color);
    half_blurriness[texel] = 0.25 * (above.blurriness + below.blurriness);
}
