// Everything that is not in front, as running sums along rows: value x of a span is the sum of its first x pixels, of
// their colour and of the part of each pixel that counts.

@group(0) @binding(3) var<storage, read> picture: array<f32>;
@group(0) @binding(4) var<storage, read_write> color_sums: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> seen_sums: array<f32>;

struct Rest {
    color: vec4<f32>,
    seen: f32,
}

var<workgroup> totals: array<Rest, 256>;

fn rest_of(pixel: u32) -> Rest {
    let coc = coc_of(pixel);
    let seen = select(1.0, 1.0 - drawn(coc), coc < 0.0);
    return Rest(seen * picture_at(pixel), seen);
}

fn sum_of(a: Rest, b: Rest) -> Rest {
    return Rest(a.color + b.color, a.seen + b.seen);
}

@compute @workgroup_size(256)
fn sum_rest(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = vec2(SPAN * group.y + thread, group.x);
    let is_inside = at.x < params.size.x;
    if is_inside {
        totals[thread] = rest_of(at.y * params.size.x + at.x);
    }
    workgroupBarrier();
    // Sums all pixels up to each one (a prefix sum); the distance doubles in each step.
    for (var distance = 1u; distance < SPAN; distance *= 2u) {
        var before = Rest();
        if thread >= distance {
            before = totals[thread - distance];
        }
        workgroupBarrier();
        totals[thread] = sum_of(before, totals[thread]);
        workgroupBarrier();
    }
    let out = first_sum(at.y, group.y);
    if thread == 0u {
        color_sums[out] = vec4<f32>();
        seen_sums[out] = 0.0;
    }
    if is_inside {
        color_sums[out + thread + 1u] = totals[thread].color;
        seen_sums[out + thread + 1u] = totals[thread].seen;
    }
}
