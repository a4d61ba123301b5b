// Averages a super-sampled picture down to the pixels of the output: means of square blocks.

struct Params {
    // Size of the output.
    size: vec2<u32>,
    // Pixels of the picture per pixel of the output, along each axis.
    block: u32,
}

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> full: array<f32>;
@group(0) @binding(2) var<storage, read_write> picture: array<f32>;

fn mean(at: vec2<u32>, c: u32) -> f32 {
    let scale = 1.0 / f32(params.block * params.block);
    var sum = 0.0;
    for (var j = 0u; j < params.block; j++) {
        let row = (at.y * params.block + j) * params.size.x * params.block + at.x * params.block;
        for (var i = 0u; i < params.block; i++) {
            sum += scale * full[(row + i) * CHANNELS + c];
        }
    }
    return sum;
}

@compute @workgroup_size(16, 16)
fn resolve(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    for (var c = 0u; c < CHANNELS; c++) {
        picture[(id.y * params.size.x + id.x) * CHANNELS + c] = mean(id.xy, c);
    }
}
