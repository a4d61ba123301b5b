// One widening pass: diffusion to four neighbours at a distance, along each surface: cpu/lens/widen.rs.

struct Params {
    size: vec2<u32>,
    reach: i32,
    // The variance that was added before.
    done: f32,
    // The variance that a unit of weight adds.
    per_weight: f32,
    max_weight: f32,
    // The largest difference in shift between neighbouring cells of one surface.
    connected_px: f32,
    @align(16) footprint: Footprint,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read> shifts: array<f32>;
@group(0) @binding(3) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> widened: array<vec4<f32>>;

// The weight that a cell wants to give its neighbours.
fn wanted(s: f32) -> f32 {
    if s >= NOWHERE {
        return 0.0;
    }
    let left = max(variance(params.footprint, s) - params.footprint.next_cells, 0.0) - params.done;
    return clamp(left * (1.0 / params.per_weight), 0.0, params.max_weight);
}

// What a cell receives from its neighbour on one side.
fn received(id: vec3<u32>, own: u32, own_wanted: f32, side: vec2<i32>) -> vec4<f32> {
    let at = vec2<i32>(id.xy) + params.reach * side;
    if any(at < vec2(0)) || any(at >= vec2<i32>(params.size)) {
        return vec4<f32>();
    }
    let other = (id.z * params.size.y + u32(at.y)) * params.size.x + u32(at.x);
    // The weight of two cells is the mean of what both want.
    if abs(shifts[own] - shifts[other]) < params.connected_px * f32(params.reach) {
        return 0.5 * (own_wanted + wanted(shifts[other])) * (colors[other] - colors[own]);
    }
    return vec4<f32>();
}

@compute @workgroup_size(16, 16)
fn widen(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let own = (id.z * params.size.y + id.y) * params.size.x + id.x;
    let own_wanted = wanted(shifts[own]);
    var color = colors[own];
    color += received(id, own, own_wanted, vec2(1, 0));
    color += received(id, own, own_wanted, vec2(-1, 0));
    color += received(id, own, own_wanted, vec2(0, -1));
    color += received(id, own, own_wanted, vec2(0, 1));
    widened[own] = color;
}
