// The blurred copy, interpolated to full size and composited over the picture by blurriness.

struct Params {
    size: vec2<u32>,
    half: vec2<u32>,
    @align(16) defocus: Defocus,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read> blurred: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> picture: array<f32>;

fn mixed(a: vec4<f32>, b: vec4<f32>, fraction: f32) -> vec4<f32> {
    return a + fraction * (b - a);
}

// The blurred copy at column x, interpolated between two of its rows.
fn between_rows(x: i32, above: i32, fraction: f32) -> vec4<f32> {
    return mixed(
        blurred[index_in(params.half, x, above)],
        blurred[index_in(params.half, x, above + 1)],
        fraction,
    );
}

@compute @workgroup_size(16, 16)
fn composite(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    // Pixel p is at texel p / 2 - 1/4: a quarter of a texel before or after the centre of its own texel.
    let own = vec2<i32>(id.xy / 2u);
    let odd = (id.xy & vec2<u32>(1u)) == vec2<u32>(1u);
    let above = select(own.y - 1, own.y, odd.y);
    let fraction = select(0.75, 0.25, odd.y);
    let beside = select(own.x - 1, own.x + 1, odd.x);
    let wide = mixed(
        between_rows(own.x, above, fraction),
        between_rows(beside, above, fraction),
        0.25,
    );
    let pixel = id.y * params.size.x + id.x;
    let blurriness = min(abs(defocus_at(params.defocus, disparity[pixel])), 1.0);
    let value = mixed(color_at(params.size, pixel), wide, blurriness);
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
