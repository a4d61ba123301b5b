// The position in the list at which the points of each workgroup begin, and the number of points to draw.

struct Params {
    groups: u32,
}

const THREADS: u32 = 256u;
// Number of corners of a quad.
const CORNERS: u32 = 4u;

// The arguments of one indirect draw.
struct Draw {
    vertices: u32,
    instances: u32,
    first_vertex: u32,
    first_instance: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> counts: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read_write> draws: array<Draw, 2>;

var<workgroup> totals: array<vec2<u32>, 256>;

@compute @workgroup_size(256)
fn offsets(@builtin(local_invocation_index) thread: u32) {
    // Each thread sums a range of the workgroups.
    let segment = (params.groups + THREADS - 1u) / THREADS;
    let first = min(thread * segment, params.groups);
    let end = min(first + segment, params.groups);
    var total = vec2<u32>();
    for (var i = first; i < end; i++) {
        total += counts[i];
    }
    totals[thread] = total;
    workgroupBarrier();
    // Sums all ranges up to each one (a prefix sum); the distance doubles in each step.
    for (var distance = 1u; distance < THREADS; distance *= 2u) {
        var before = vec2<u32>();
        if thread >= distance {
            before = totals[thread - distance];
        }
        workgroupBarrier();
        totals[thread] += before;
        workgroupBarrier();
    }
    var offset = totals[thread] - total;
    for (var i = first; i < end; i++) {
        let own = counts[i];
        counts[i] = offset;
        offset += own;
    }
    if thread == THREADS - 1u {
        draws[0] = Draw(CORNERS, totals[thread].x, 0u, 0u);
        draws[1] = Draw(CORNERS, totals[thread].y, 0u, 0u);
    }
}
