// A few look-ups around each pixel, mixed with it by blur factors: plan/taps.rs.

struct Params {
    size: vec2<u32>,
    // Number of look-ups without the centre.
    count: u32,
    mix: u32,
    share: f32,
    max_blur: f32,
    // The first row of this pass.
    top: u32,
    @align(16) defocus: Defocus,
}

// One look-up: the pixels that it reads, as offsets from the centre with their weights.
struct Tap {
    dx: vec4<i32>,
    dy: vec4<i32>,
    weight: vec4<f32>,
}

const MIX_BOTH: u32 = 0u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read> taps: array<Tap>;
@group(0) @binding(4) var<storage, read_write> picture: array<f32>;

fn blur(pixel: u32) -> f32 {
    let factor = defocus_at(params.defocus, disparity[pixel]);
    return min(factor * factor, params.max_blur);
}

// The picture at one pixel, mixed from its look-ups.
fn mixed(at: vec2<i32>) -> vec4<f32> {
    let own = index_in(params.size, at.x, at.y);
    let centre = color_at(params.size, own);
    let centre_blur = blur(own);
    if centre_blur == 0.0 {
        return centre;
    }
    var sum = vec4<f32>();
    for (var i = 0u; i < params.count; i++) {
        let tap = taps[i];
        var tap_color = vec4<f32>();
        var tap_blur = 0.0;
        for (var j = 0; j < 4; j++) {
            if tap.weight[j] != 0.0 {
                let pixel = index_in(params.size, at.x + tap.dx[j], at.y + tap.dy[j]);
                tap_color += tap.weight[j] * color_at(params.size, pixel);
                tap_blur += tap.weight[j] * blur(pixel);
            }
        }
        let weight = select(centre_blur, centre_blur * tap_blur, params.mix == MIX_BOTH);
        sum += weight * (tap_color - centre);
    }
    return centre + params.share * sum;
}

@compute @workgroup_size(16, 16)
fn taps_pass(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = vec2(id.x, params.top + id.y);
    if any(at >= params.size) {
        return;
    }
    let value = mixed(vec2<i32>(at));
    for (var c = 0u; c < CHANNELS; c++) {
        picture[(at.y * params.size.x + at.x) * CHANNELS + c] = value[c];
    }
}
