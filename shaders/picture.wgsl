// The picture, as planes.

override CHANNELS: u32 = 3u;

@group(0) @binding(1) var<storage, read> color: array<f32>;

// All channels of a pixel; channels that the picture does not have are 0. They are written by name: some compilers cannot
// write a vector at an index that only the running shader knows.
fn color_at(size: vec2<u32>, pixel: u32) -> vec4<f32> {
    let plane = size.x * size.y;
    var value = vec4(color[pixel], 0.0, 0.0, 0.0);
    if CHANNELS > 1u {
        value.y = color[plane + pixel];
    }
    if CHANNELS > 2u {
        value.z = color[2u * plane + pixel];
    }
    if CHANNELS > 3u {
        value.w = color[3u * plane + pixel];
    }
    return value;
}
