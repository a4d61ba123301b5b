// One filter step: five look-ups along y, then along x.

struct Params {
    size: vec2<u32>,
    // Weights of the centre, of the look-ups beside it and of those beyond.
    middle: f32,
    beside: f32,
    beyond: f32,
}

const GROUP: u32 = 16u;
const MARGIN: u32 = 2u;
const SIDE: u32 = GROUP + 2u * MARGIN;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> before: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> after: array<vec4<f32>>;

// The target around the group's pixels, before and after the filter along y.
var<workgroup> around: array<vec4<f32>, SIDE * SIDE>;
var<workgroup> column: array<vec4<f32>, SIDE * GROUP>;

fn step(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>, e: vec4<f32>) -> vec4<f32> {
    return params.middle * c + params.beside * (b + d) + params.beyond * (a + e);
}

@compute @workgroup_size(16, 16)
fn filter_step(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let first = vec2<i32>(group.xy * GROUP) - i32(MARGIN);
    for (var i = local; i < SIDE * SIDE; i += GROUP * GROUP) {
        around[i] = before[index_in(params.size, first.x + i32(i % SIDE), first.y + i32(i / SIDE))];
    }
    workgroupBarrier();
    for (var i = local; i < SIDE * GROUP; i += GROUP * GROUP) {
        column[i] = step(
            around[i],
            around[i + SIDE],
            around[i + 2u * SIDE],
            around[i + 3u * SIDE],
            around[i + 4u * SIDE],
        );
    }
    workgroupBarrier();
    let own = vec2<u32>(local % GROUP, local / GROUP);
    let at = group.xy * GROUP + own;
    if any(at >= params.size) {
        return;
    }
    let i = own.y * SIDE + own.x;
    after[at.y * params.size.x + at.x] =
        step(column[i], column[i + 1u], column[i + 2u], column[i + 3u], column[i + 4u]);
}
