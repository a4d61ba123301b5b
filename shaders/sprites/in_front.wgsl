// Composites the layer in front over the rest of the picture.

@group(0) @binding(5) var<storage, read> color_sums: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> seen_sums: array<f32>;
@group(0) @binding(7) var<storage, read_write> picture: array<f32>;

// The sum over a span up to a position between the corners of its pixels.
fn sum_up_to(row: u32, span: u32, x: f32) -> Light {
    let column = u32(x);
    let at = first_sum(row, span) + column;
    // There is no corner after the last one.
    let columns = min(params.size.x - span * SPAN, SPAN);
    let next = select(at, at + 1u, column < columns);
    let fraction = x - f32(column);
    return mixed(Light(color_sums[at], seen_sums[at]), Light(color_sums[next], seen_sums[next]), fraction);
}

// The sum over a row between two positions, which are counted from the left side of a column.
fn sum_between(row: u32, column: u32, left: f32, right: f32) -> Light {
    var sum = Light();
    let first = i32(column) + i32(floor(left));
    let last = i32(column) + i32(ceil(right)) - 1;
    for (var span = u32(first) / SPAN; span <= u32(last) / SPAN; span++) {
        // Small numbers, which lose little.
        let shift = f32(i32(column) - i32(span * SPAN));
        let before = sum_up_to(row, span, max(shift + left, 0.0));
        let all = sum_up_to(row, span, min(shift + right, f32(SPAN)));
        sum.color += all.color - before.color;
        sum.coverage += all.coverage - before.coverage;
    }
    return sum;
}

// The mean of everything that is not in front, over the square around a pixel with the area of a disc: the light, and
// how much of it is seen.
fn around(at: vec2<u32>, radius: f32) -> Light {
    let half = radius * 0.886226925;
    let left = max(0.5 - half, -f32(at.x));
    let right = min(0.5 + half, f32(params.size.x - at.x));
    let rows = i32(ceil(half - 0.5));
    var sum = Light();
    var down = 0.0;
    for (var dy = -rows; dy <= rows; dy++) {
        let y = i32(at.y) + dy;
        if y < 0 || y >= i32(params.size.y) {
            continue;
        }
        let part = min(f32(dy) + 0.5, half) - max(f32(dy) - 0.5, -half);
        let of_row = sum_between(u32(y), at.x, left, right);
        sum.color += part * of_row.color;
        sum.coverage += part * of_row.coverage;
        down += part;
    }
    let share = 1.0 / (down * (right - left));
    // Differences of sums leave a rounding error where nothing is seen.
    if share * sum.coverage < 1e-6 {
        return Light();
    }
    return Light(share * sum.color, share * sum.coverage);
}

// Composites the light in front over the rest. A pixel in front itself is as opaque as that light, and the light that
// passes it is the light seen around it.
fn over(at: vec2<u32>, coc: f32, light: Light, rest: vec4<f32>) -> vec4<f32> {
    // Sprites of several depths cover a pixel only once.
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
    let at = vec2(id.x, params.top + id.y);
    if any(at >= params.size) {
        return;
    }
    let light = light_at(at);
    if light.coverage <= 0.0 {
        return;
    }
    let pixel = at.y * params.size.x + at.x;
    let value = over(at, coc_of(pixel), light, picture_at(pixel));
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
