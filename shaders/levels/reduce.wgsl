// The picture at a fraction of its size: means of square blocks.

struct Params {
    size: vec2<u32>,
    small: vec2<u32>,
    // Pixels of the picture per pixel of the result, along each axis.
    block: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read_write> small: array<vec4<f32>>;

fn mean(at: vec2<u32>) -> vec4<f32> {
    let first = vec2<i32>(at * params.block);
    var sum = vec4<f32>();
    for (var j = 0; j < i32(params.block); j++) {
        for (var i = 0; i < i32(params.block); i++) {
            sum += color_at(params.size, index_in(params.size, first.x + i, first.y + j));
        }
    }
    return sum / f32(params.block * params.block);
}

@compute @workgroup_size(16, 16)
fn reduce(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.small) {
        return;
    }
    small[id.y * params.small.x + id.x] = mean(id.xy);
}
