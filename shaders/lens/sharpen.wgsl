// Cells as they are drawn, sharpened against the blur of drawing them at fractions of a pixel:
// cpu/lens/padded_colors.rs.

struct Params {
    size: vec2<u32>,
    layers: u32,
    connected_px: f32,
    @align(16) footprint: Footprint,
}

const RIGHT: u32 = 1u;
const DOWN: u32 = 2u;
const EDGE: u32 = 4u;
// The connectivity of a layer whose cells are not pixels of the picture.
const NO_CONNECTIVITY: u32 = 128u;
// The connectivity of a layer that is a holdout.
const OF_HOLDOUT: u32 = 192u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read> shifts: array<f32>;
// Four bytes per word.
@group(0) @binding(3) var<storage, read> connectivity: array<u32>;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> drawn: array<vec4<f32>>;

fn connectivity_of(cell: u32) -> u32 {
    return (connectivity[cell / 4u] >> (8u * (cell % 4u))) & 0xffu;
}

// The amount that sharpening by `kappa` moves from a cell to a neighbour; at most a quarter of the cell's light.
fn flow(kappa: f32, own: vec4<f32>, other: vec4<f32>) -> vec4<f32> {
    let wanted = kappa * (other - own);
    let light = 0.25 * max(min(own, other), vec4<f32>());
    let most = select(vec4<f32>(3.4e38), light, kappa > 0.0);
    return max(min(wanted, most), -most);
}

// Whether two cells are both of holdouts or both not: one does not continue the other otherwise.
fn are_alike(a: u32, b: u32) -> bool {
    return (connectivity_of(a) == OF_HOLDOUT) == (connectivity_of(b) == OF_HOLDOUT);
}

// The cell that continues a cell's surface at pixel `q`; pixel `owner` stores the connection between both. If there
// is no such cell, the cell itself.
fn neighbour(layer: u32, own: u32, s: f32, q: u32, owner: u32, bit: u32) -> u32 {
    let pixels = params.size.x * params.size.y;
    let beside = layer * pixels + q;
    if abs(shifts[beside] - s) < params.connected_px {
        return beside;
    }
    let own_connectivity = connectivity_of(own);
    let connected = (own_connectivity & NO_CONNECTIVITY) == 0u
        && (connectivity_of(layer * pixels + owner) & bit) != 0u
        && ((own_connectivity | connectivity_of(beside)) & EDGE) == 0u
        && shifts[beside] < NOWHERE;
    if connected {
        return beside;
    }
    for (var other = 0u; other < params.layers; other++) {
        let there = other * pixels + q;
        if other != layer && abs(shifts[there] - s) < params.connected_px && are_alike(own, there) {
            return there;
        }
    }
    return own;
}

@compute @workgroup_size(16, 16)
fn sharpen(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let width = params.size.x;
    let p = id.y * width + id.x;
    let own = id.z * width * params.size.y + p;
    let s = shifts[own];
    let color = colors[own];
    if s >= NOWHERE {
        drawn[own] = color;
        return;
    }
    let kappa = -0.5 * min(variance(params.footprint, s), params.footprint.next_cells);
    // A cell exchanges nothing with itself.
    var sum = vec4<f32>();
    if id.x > 0u {
        sum += flow(kappa, color, colors[neighbour(id.z, own, s, p - 1u, p - 1u, RIGHT)]);
    }
    if id.x + 1u < width {
        sum += flow(kappa, color, colors[neighbour(id.z, own, s, p + 1u, p, RIGHT)]);
    }
    if id.y > 0u {
        sum += flow(kappa, color, colors[neighbour(id.z, own, s, p - width, p - width, DOWN)]);
    }
    if id.y + 1u < params.size.y {
        sum += flow(kappa, color, colors[neighbour(id.z, own, s, p + width, p, DOWN)]);
    }
    drawn[own] = color - sum;
}
