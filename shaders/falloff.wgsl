// Falloff: the picture darkened away from the axis, by the second stop of the lens and by the angle of the light.

struct Params {
    size: vec2<u32>,
    // The pixel on the axis.
    centre: vec2<f32>,
    // One over the focal length in pixels; 0 if the angle of the light is ignored.
    per_focal: f32,
    // Number of channels that hold light.
    lights: u32,
    @align(16) second_stop: SecondStop,
}

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> open: array<f32>;
@group(0) @binding(2) var<storage, read_write> picture: array<f32>;

fn open_value(i: u32) -> f32 {
    return open[i];
}

// The fourth power of the cosine of the angle between the axis and a pixel's ray.
fn cos4(at: vec2<f32>) -> f32 {
    let tan = (at - params.centre) * params.per_focal;
    let per_cos2 = 1.0 + dot(tan, tan);
    return 1.0 / (per_cos2 * per_cos2);
}

@compute @workgroup_size(16, 16)
fn falloff(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let at = vec2<f32>(id.xy);
    var passes = cos4(at);
    if clips(params.second_stop) {
        passes *= open_part(params.second_stop, stop_of(params.second_stop, at));
    }
    for (var c = 0u; c < params.lights; c++) {
        picture[(id.y * params.size.x + id.x) * CHANNELS + c] *= passes;
    }
}
