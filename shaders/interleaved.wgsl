// A picture whose channels follow one another. The pass that includes this file defines `picture` and `CHANNELS`.

// All channels of a pixel; channels that the picture does not have are 0. They are written by name: see picture.wgsl.
fn picture_at(pixel: u32) -> vec4<f32> {
    let first = pixel * CHANNELS;
    var value = vec4(picture[first], 0.0, 0.0, 0.0);
    if CHANNELS > 1u {
        value.y = picture[first + 1u];
    }
    if CHANNELS > 2u {
        value.z = picture[first + 2u];
    }
    if CHANNELS > 3u {
        value.w = picture[first + 3u];
    }
    return value;
}
