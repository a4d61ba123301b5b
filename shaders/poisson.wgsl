// Taps scattered over each pixel's circle of confusion: plan/poisson.rs.

struct Params {
    size: vec2<u32>,
    count: u32,
    leak_test: u32,
    // Contribution of the pixel itself.
    centre: f32,
    max_radius_px: f32,
    rounding: f32,
    // The first row of this pass.
    top: u32,
    @align(16) shift: Defocus,
}

struct Tap {
    place: vec2<f32>,
    weight: f32,
}

// A value interpolated between pixels: colour, disparity and blurriness.
struct Sample {
    color: vec4<f32>,
    disparity: f32,
    blurriness: f32,
}

const LEAK_TEST_ON: u32 = 0u;
// If no tap counts at all, the pixel keeps its colour.
const LEAST_TOTAL: f32 = 1.1754944e-38;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read> taps: array<Tap>;
@group(0) @binding(4) var<storage, read_write> picture: array<f32>;

fn sample_at(x: i32, y: i32) -> Sample {
    let pixel = index_in(params.size, x, y);
    let d = disparity[pixel];
    let blurriness = min(abs(defocus_at(params.shift, d)) / params.max_radius_px, 1.0);
    return Sample(color_at(params.size, pixel), d, blurriness);
}

fn mixed(a: Sample, b: Sample, fraction: f32) -> Sample {
    return Sample(
        a.color + fraction * (b.color - a.color),
        a.disparity + fraction * (b.disparity - a.disparity),
        a.blurriness + fraction * (b.blurriness - a.blurriness),
    );
}

// Interpolates between four neighbours; `at` is the upper left one.
fn bilinear(at: vec2<i32>, beyond: vec2<f32>) -> Sample {
    let above = mixed(sample_at(at.x, at.y), sample_at(at.x + 1, at.y), beyond.x);
    let below = mixed(sample_at(at.x, at.y + 1), sample_at(at.x + 1, at.y + 1), beyond.x);
    return mixed(above, below, beyond.y);
}

// The weight of a tap. A sharp surface in front must not leak onto a blurred surface behind it.
fn contribution(centre_disparity: f32, tap: Sample) -> f32 {
    let in_front = params.leak_test == LEAK_TEST_ON && tap.disparity > centre_disparity;
    return select(1.0, tap.blurriness, in_front);
}

// The average over the pixel and its taps.
fn averaged(at: vec2<i32>) -> vec4<f32> {
    let own = index_in(params.size, at.x, at.y);
    let centre = color_at(params.size, own);
    let scale_px = clamp(
        defocus_at(params.shift, disparity[own]),
        -params.max_radius_px,
        params.max_radius_px,
    );
    var total = params.centre;
    var moved = vec4<f32>();
    for (var i = 0u; i < params.count; i++) {
        let tap = taps[i];
        // Whole pixels and fractions are kept separate: far from the origin, a float has few digits left for
        // fractions.
        let offset = scale_px * tap.place;
        let whole = floor(offset);
        let seen = bilinear(at + vec2<i32>(whole), offset - whole);
        let counts = tap.weight * contribution(disparity[own], seen);
        total += counts;
        moved += counts * (seen.color - centre);
    }
    // What rounding leaves below no light is none.
    let average = centre + moved / max(total, LEAST_TOTAL);
    let none = (average < vec4<f32>()) & (average >= -params.rounding * centre);
    return select(average, vec4<f32>(), none);
}

@compute @workgroup_size(16, 16)
fn poisson(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = vec2(id.x, params.top + id.y);
    if any(at >= params.size) {
        return;
    }
    let value = averaged(vec2<i32>(at));
    for (var c = 0u; c < CHANNELS; c++) {
        picture[(at.y * params.size.x + at.x) * CHANNELS + c] = value[c];
    }
}
