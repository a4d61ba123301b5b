// Everything that is not in front, as running sums along every row: value x is the sum of the first x pixels, of
// their colour and of the part of each pixel that counts.

@group(0) @binding(3) var<storage, read> picture: array<f32>;
@group(0) @binding(4) var<storage, read_write> color_sums: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> seen_sums: array<f32>;

const THREADS: u32 = 256u;

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
    // Each thread sums a range of the row.
    let segment = (params.size.x + THREADS - 1u) / THREADS;
    let first = min(thread * segment, params.size.x);
    let end = min(first + segment, params.size.x);
    let y = params.top + group.x;
    let row = y * params.size.x;
    var total = Rest();
    for (var x = first; x < end; x++) {
        total = sum_of(total, rest_of(row + x));
    }
    totals[thread] = total;
    workgroupBarrier();
    // Sums all ranges up to each one (a prefix sum); the distance doubles in each step.
    for (var distance = 1u; distance < THREADS; distance *= 2u) {
        var before = Rest();
        if thread >= distance {
            before = totals[thread - distance];
        }
        workgroupBarrier();
        totals[thread] = sum_of(before, totals[thread]);
        workgroupBarrier();
    }
    var sum = Rest();
    if thread > 0u {
        sum = totals[thread - 1u];
    }
    let out = y * (params.size.x + 1u);
    for (var x = first; x < end; x++) {
        color_sums[out + x] = sum.color;
        seen_sums[out + x] = sum.seen;
        sum = sum_of(sum, rest_of(row + x));
    }
    if end == params.size.x && first < end {
        color_sums[out + end] = sum.color;
        seen_sums[out + end] = sum.seen;
    }
}
