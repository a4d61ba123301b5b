// The first pass: both targets, gathered from the picture. The second target also has the lines of the first.

@group(0) @binding(4) var<storage, read_write> first: array<Texel>;
@group(0) @binding(5) var<storage, read_write> second: array<Texel>;

fn near_radius(target_index: u32, at: vec2<i32>, coc: f32) -> f32 {
    return max(-coc, 0.0);
}

fn near_light(target_index: u32, at: vec2<i32>, coc: f32) -> Near {
    let color = color_at(params.size, index_in(params.size, at.x, at.y));
    return Near(color / -coc, 1.0 / -coc);
}

fn rest_light(target_index: u32, at: vec2<i32>, coc: f32) -> Rest {
    if coc < 0.0 {
        return Rest();
    }
    return Rest(color_at(params.size, index_in(params.size, at.x, at.y)), 1.0);
}

@compute @workgroup_size(16, 16)
fn gather(@builtin(global_invocation_id) id: vec3<u32>) {
    let place = vec2(id.x, params.top + id.y);
    if any(place >= params.frame) {
        return;
    }
    let at = vec2<i32>(place) - vec2<i32>(params.origin);
    let own = coc_of(index_in(params.size, at.x, at.y));
    let i = frame_index(at);
    var sums = Sums();
    for (var line = 0u; line < params.count; line++) {
        sums = add_line(sums, params.lines[line], at, own);
        // Divided by its radius, like the picture's own light.
        let share = select(0.0, 1.0 / sums.radius, sums.radius > 0.0);
        let parts = vec4<f32>(share * sums.near.coverage, sums.radius, sums.rest.seen, 0.0);
        let texel = Texel(share * sums.near.color, sums.rest.color, parts);
        if params.lines[line].z == 0u {
            first[i] = texel;
        } else {
            second[i] = texel;
        }
    }
}
