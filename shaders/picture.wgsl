// The picture and its depth, as planes.

override CHANNELS: u32 = 3u;

@group(0) @binding(1) var<storage, read> color: array<f32>;
@group(0) @binding(2) var<storage, read> disparity: array<f32>;

// All channels of a pixel; channels that the picture does not have are 0.
fn color_at(size: vec2<u32>, pixel: u32) -> vec4<f32> {
    var value = vec4<f32>();
    for (var c = 0u; c < CHANNELS; c++) {
        value[c] = color[c * size.x * size.y + pixel];
    }
    return value;
}
