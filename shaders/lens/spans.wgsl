// The depths that each cell spans, as codes: from half-way to the farthest of the neighbours that continue its surface to
// half-way to the nearest one: scene/depth_spans.rs.
//
// Codes are the same as there, bit for bit, because the bounds of depth are found there: no sum has a product that a
// compiler could leave unrounded, but for halves, which are exact.

struct Params {
    size: vec2<u32>,
    layers: u32,
    // The largest difference in shift between neighbouring cells of one surface.
    connected_px: f32,
    // The least shift, and codes a pixel of shift.
    least: f32,
    per_px: f32,
}

// The greatest code is one more.
const MOST: f32 = 65533.0;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> codes: array<u32>;

fn encoded(s: f32) -> u32 {
    return u32(round(clamp((s - params.least) * params.per_px, 0.0, MOST))) + 1u;
}

@compute @workgroup_size(16, 16)
fn spans(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let width = params.size.x;
    let pixels = width * params.size.y;
    let own = id.y * width + id.x;
    let cell = id.z * pixels + own;
    let s = shifts[cell];
    if s >= NOWHERE {
        codes[cell] = 0u;
        return;
    }
    var far = s;
    var near = s;
    if id.x > 0u {
        let half_way = 0.5 * (s + shifts[neighbour(id.z, own, s, own - 1u)]);
        far = min(far, half_way);
        near = max(near, half_way);
    }
    if id.x + 1u < width {
        let half_way = 0.5 * (s + shifts[neighbour(id.z, own, s, own + 1u)]);
        far = min(far, half_way);
        near = max(near, half_way);
    }
    if id.y > 0u {
        let half_way = 0.5 * (s + shifts[neighbour(id.z, own, s, own - width)]);
        far = min(far, half_way);
        near = max(near, half_way);
    }
    if id.y + 1u < params.size.y {
        let half_way = 0.5 * (s + shifts[neighbour(id.z, own, s, own + width)]);
        far = min(far, half_way);
        near = max(near, half_way);
    }
    codes[cell] = encoded(far) | (encoded(near) << 16u);
}
