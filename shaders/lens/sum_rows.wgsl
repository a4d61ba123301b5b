// Running sums of the front layer's colours along every row: value x is the sum of the first x cells.

struct Params {
    size: vec2<u32>,
    // The first cell of the front layer.
    front: u32,
}

const THREADS: u32 = 256u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4<f32>>;

var<workgroup> totals: array<vec4<f32>, 256>;

@compute @workgroup_size(256)
fn sum_rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    // Each thread sums a segment of the row.
    let segment = (params.size.x + THREADS - 1u) / THREADS;
    let first = min(thread * segment, params.size.x);
    let end = min(first + segment, params.size.x);
    let row = params.front + group.x * params.size.x;
    var total = vec4<f32>();
    for (var x = first; x < end; x++) {
        total += colors[row + x];
    }
    totals[thread] = total;
    workgroupBarrier();
    // Sums all segments up to each one (a prefix sum); the distance doubles in each step.
    for (var distance = 1u; distance < THREADS; distance *= 2u) {
        var before = vec4<f32>();
        if thread >= distance {
            before = totals[thread - distance];
        }
        workgroupBarrier();
        totals[thread] += before;
        workgroupBarrier();
    }
    var sum = vec4<f32>();
    if thread > 0u {
        sum = totals[thread - 1u];
    }
    let out = group.x * (params.size.x + 1u);
    for (var x = first; x < end; x++) {
        sums[out + x] = sum;
        sum += colors[row + x];
    }
    if end == params.size.x && first < end {
        sums[out + end] = sum;
    }
}
