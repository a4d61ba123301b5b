// The cells of a layer as they are in planes, four channels to a cell.

struct Params {
    size: vec2<u32>,
    // The layer's first cell, and the first of its planes, or `NO_PLANES`.
    first: u32,
    planes: u32,
}

// In place of the first plane: the cells have no colour.
const NO_PLANES: u32 = 0xffffffffu;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read_write> colors: array<vec4<f32>>;

@compute @workgroup_size(16, 16)
fn interleave(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = id.y * params.size.x + id.x;
    var value = vec4<f32>();
    if params.planes != NO_PLANES {
        value = color_at(params.size, params.planes * params.size.x * params.size.y + pixel);
    }
    colors[params.first + pixel] = value;
}
