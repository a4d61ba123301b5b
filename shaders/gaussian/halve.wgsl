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

@compute @workgroup_size(16, 16)
fn halve(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.half) {
        return;
    }
    let at = 2 * vec2<i32>(id.xy);
    var row_color = array<vec4<f32>, 2>();
    var row_blurriness = array<f32, 2>();
    for (var j = 0; j < 2; j++) {
        let left = index_in(params.size, at.x, at.y + j);
        let right = index_in(params.size, at.x + 1, at.y + j);
        row_color[j] = color_at(params.size, left) + color_at(params.size, right);
        row_blurriness[j] = blurriness(left) + blurriness(right);
    }
    let texel = id.y * params.half.x + id.x;
    half_color[texel] = 0.25 * (row_color[0] + row_color[1]);
    half_blurriness[texel] = 0.25 * (row_blurriness[0] + row_blurriness[1]);
}
