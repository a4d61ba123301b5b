// The second pass: blurs and adds the targets, and composites the light in front over the rest.

@group(0) @binding(4) var<storage, read> first: array<Texel>;
@group(0) @binding(5) var<storage, read> second: array<Texel>;
@group(0) @binding(6) var<storage, read_write> picture: array<f32>;

fn parts_of(target_index: u32, i: u32) -> vec4<f32> {
    if target_index == 0u {
        return first[i].parts;
    }
    return second[i].parts;
}

fn near_radius(target_index: u32, at: vec2<i32>, coc: f32) -> f32 {
    return parts_of(target_index, frame_index(at)).y;
}

fn near_light(target_index: u32, at: vec2<i32>, coc: f32) -> Near {
    let i = frame_index(at);
    if target_index == 0u {
        return Near(first[i].near, first[i].parts.x);
    }
    return Near(second[i].near, second[i].parts.x);
}

fn rest_light(target_index: u32, at: vec2<i32>, coc: f32) -> Rest {
    let i = frame_index(at);
    if target_index == 0u {
        return Rest(first[i].rest, first[i].parts.z);
    }
    return Rest(second[i].rest, second[i].parts.z);
}

// Composites the layers.
fn over(sums: Sums, sharp: vec4<f32>, coc: f32) -> vec4<f32> {
    let near = params.scale * sums.near.color;
    let coverage = params.scale * sums.near.coverage;
    let rest = params.scale * sums.rest.color;
    if coc < 0.0 {
        // A surface in front is as opaque as its coverage; the light that passes it is the visible light around it.
        return (near + rest) / (coverage + params.scale * sums.rest.seen);
    }
    // Blurred and sharp colours are blended over the first pixel of the circle of confusion.
    let behind = sharp + min(coc, 1.0) * (rest - sharp);
    let excess = max(coverage, 1.0);
    return near / excess + (1.0 - coverage / excess) * behind;
}

@compute @workgroup_size(16, 16)
fn shade(@builtin(global_invocation_id) id: vec3<u32>) {
    let place = vec2(id.x, params.top + id.y);
    if any(place >= params.size) {
        return;
    }
    let at = vec2<i32>(place);
    let pixel = place.y * params.size.x + place.x;
    let own = coc_of(pixel);
    var sums = Sums();
    for (var line = 0u; line < params.count; line++) {
        sums = add_line(sums, params.lines[line], at, own);
    }
    let value = over(sums, color_at(params.size, pixel), own);
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
