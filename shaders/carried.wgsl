// Puts a group of channels, which was rendered by itself, among all those that a picture carries.

struct Params {
    size: vec2<u32>,
    // The number of all channels, and the place of the group's first one.
    all: u32,
    first: u32,
}

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> group_of_channels: array<f32>;
@group(0) @binding(2) var<storage, read_write> picture: array<f32>;

@compute @workgroup_size(16, 16)
fn put_among_all(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = id.y * params.size.x + id.x;
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * params.all + params.first + c] = group_of_channels[pixel * CHANNELS + c];
    }
}
