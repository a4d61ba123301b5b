// The layer in front over the rest of the picture.

@group(0) @binding(5) var<storage, read> color_sums: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> seen_sums: array<f32>;
@group(0) @binding(7) var<storage, read_write> picture: array<f32>;

// The sum over a row up to a point between the corners of pixels.
fn sum_up_to(row: u32, x: f32) -> Light {
    let column = u32(x);
    let at = row * (params.size.x + 1u) + column;
    // At the last corner there is no next one.
    let next = select(at, at + 1u, column < params.size.x);
    let fraction = x - f32(column);
    return mixed(Light(color_sums[at], seen_sums[at]), Light(color_sums[next], seen_sums[next]), fraction);
}

// The mean of what is not in front over the square around a pixel that is as large as a disc: what is seen, and how much
// of it.
fn around(at: vec2<u32>, radius: f32) -> Light {
    let half = radius * 0.886226925;
    let centre = vec2<f32>(at) + 0.5;
    let first = max(centre - half, vec2(0.0));
    let end = min(centre + half, vec2<f32>(params.size));
    var sum = Light();
    for (var row = u32(first.y); f32(row) < end.y; row++) {
        let down = min(f32(row) + 1.0, end.y) - max(f32(row), first.y);
        let left = sum_up_to(row, first.x);
        let right = sum_up_to(row, end.x);
        sum.color += down * (right.color - left.color);
        sum.coverage += down * (right.coverage - left.coverage);
    }
    let extent = end - first;
    let share = 1.0 / (extent.x * extent.y);
    // Differences of sums leave a rounding error where nothing is seen.
    if share * sum.coverage < 1e-6 {
        return Light();
    }
    return Light(share * sum.color, share * sum.coverage);
}

// The light in front over what is not. A pixel that lies in front itself is as opaque as it is there, and lets past
// what is seen around it.
fn over(at: vec2<u32>, coc: f32, light: Light, rest: vec4<f32>) -> vec4<f32> {
    // Sprites of several depths cover a pixel once.
    let excess = max(light.coverage, 1.0);
    let value = light.color / excess + (1.0 - light.coverage / excess) * rest;
    if coc >= 0.0 || drawn(coc) == 0.0 {
        return value;
    }
    let seen = around(at, -coc);
    let total = light.coverage + seen.coverage;
    return value + drawn(coc) * ((light.color + seen.color) / total - value);
}

@compute @workgroup_size(16, 16)
fn in_front(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let light = light_at(id.xy);
    if light.coverage <= 0.0 {
        return;
    }
    let pixel = id.y * params.size.x + id.x;
    var rest = vec4<f32>();
    for (var c = 0u; c < CHANNELS; c++) {
        rest[c] = picture[pixel * CHANNELS + c];
    }
    let value = over(id.xy, coc_of(pixel), light, rest);
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
