// Appends every point that is drawn to the list: points in front from its beginning, points behind from its end.
//
// Both stay in the order of the picture, so that sprites are always added in the same order.

struct Point {
    number: u32,
    step: u32,
}

@group(0) @binding(5) var<storage, read> offsets: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> list: array<Point>;

// Number of points up to each thread's: of the layer in front in the low half, of the layer behind in the high half.
var<workgroup> totals: array<u32, 256>;

@compute @workgroup_size(256)
fn append(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let chunk = group.y * params.groups_across + group.x;
    let number = 256u * chunk + thread;
    let layers = layers_of(number);
    let own = select(0u, 1u, layers.x) | select(0u, 1u << 16u, layers.y);
    totals[thread] = own;
    workgroupBarrier();
    for (var distance = 1u; distance < 256u; distance *= 2u) {
        var before = 0u;
        if thread >= distance {
            before = totals[thread - distance];
        }
        workgroupBarrier();
        totals[thread] += before;
        workgroupBarrier();
    }
    if own == 0u {
        return;
    }
    let before = totals[thread] - own;
    let slot = offsets[chunk] + vec2(before & 0xffffu, before >> 16u);
    let point = Point(number, step_of(disparity[pixel_at(place_of(number))]));
    if layers.x {
        list[slot.x] = point;
    } else {
        list[all_points() - 1u - slot.y] = point;
    }
}
