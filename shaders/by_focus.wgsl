// Writes one colour, which was rendered separately at its own focus, into the picture: the first channel of its
// render, and coverage if it is this colour's turn.

struct Params {
    size: vec2<u32>,
    // Number of channels of the picture that was rendered for this colour.
    channels: u32,
    color: u32,
    coverage: u32,
}

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> part: array<f32>;
@group(0) @binding(2) var<storage, read_write> picture: array<f32>;

@compute @workgroup_size(16, 16)
fn by_focus(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = id.y * params.size.x + id.x;
    picture[pixel * CHANNELS + params.color] = part[pixel * params.channels];
    if params.coverage != 0u {
        picture[pixel * CHANNELS + CHANNELS - 1u] = part[pixel * params.channels + 1u];
    }
}
