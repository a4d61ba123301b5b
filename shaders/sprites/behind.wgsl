// The picture with the layer behind: pixels behind the focus show the mean of the light in that layer.

@group(0) @binding(5) var<storage, read_write> picture: array<f32>;

fn shown(at: vec2<u32>, pixel: u32) -> vec4<f32> {
    let sharp = color_at(params.size, pixel);
    let coc = coc_of(pixel);
    if coc <= 0.0 || drawn(coc) == 0.0 {
        return sharp;
    }
    let light = light_at(at);
    if light.coverage == 0.0 {
        return sharp;
    }
    return sharp + drawn(coc) * (light.color / light.coverage - sharp);
}

@compute @workgroup_size(16, 16)
fn behind(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = id.y * params.size.x + id.x;
    let value = shown(id.xy, pixel);
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
