// Selects some channels of the cells' colours.

struct Params {
    size: vec2<u32>,
    // The numbers of the channels; 4 stands for none.
    channels: vec2<u32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> chosen: array<vec4<f32>>;

fn channel(color: vec4<f32>, i: u32) -> f32 {
    return select(0.0, color[min(i, 3u)], i < 4u);
}

@compute @workgroup_size(16, 16)
fn choose_channels(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let cell = (id.z * params.size.y + id.y) * params.size.x + id.x;
    let color = colors[cell];
    chosen[cell] = vec4(channel(color, params.channels.x), channel(color, params.channels.y), 0.0, 0.0);
}
