// Cells as they are drawn, sharpened against the blur of drawing them at fractions of a pixel:
// cpu/lens/padded_colors.rs.

struct Params {
    size: vec2<u32>,
    layers: u32,
    connected_px: f32,
    // How far neighbours exchange light: as their own values allow, as those of the guide allow, or never towards the
    // brighter one.
    rule: u32,
    // The channels of the guide that hold light; they are the first.
    lights: u32,
    @align(16) footprint: Footprint,
}

const GUIDED: u32 = 1u;
const NEVER: u32 = 2u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
// The colours of the picture that carries the channels.
@group(0) @binding(5) var<storage, read> guide: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> drawn: array<vec4<f32>>;

// The amount that sharpening by `kappa` moves from a cell to a neighbour; at most a quarter of the cell's light.
fn flow(kappa: f32, own: vec4<f32>, other: vec4<f32>) -> vec4<f32> {
    let wanted = kappa * (other - own);
    let light = 0.25 * max(min(own, other), vec4<f32>());
    let most = select(vec4<f32>(3.4e38), light, kappa > 0.0);
    return max(min(wanted, most), -most);
}

// The part of `kappa` that the light of the guide allows, by which channels that it carries move between two of its cells.
fn guided(kappa: f32, own: vec4<f32>, other: vec4<f32>) -> f32 {
    let is_light = select(vec4<f32>(), vec4<f32>(1.0), vec4(0u, 1u, 2u, 3u) < vec4(params.lights));
    let wanted = dot(abs(kappa * (other - own)), is_light);
    let most = dot(0.25 * max(min(own, other), vec4<f32>()), is_light);
    if kappa > 0.0 && wanted > most {
        return kappa * (most / wanted);
    }
    return kappa;
}

// What a cell gives to a neighbour.
fn given(kappa: f32, own: u32, other: u32) -> vec4<f32> {
    if params.rule == GUIDED {
        return guided(kappa, guide[own], guide[other]) * (colors[other] - colors[own]);
    }
    return flow(select(kappa, min(kappa, 0.0), params.rule == NEVER), colors[own], colors[other]);
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
        sum += given(kappa, own, neighbour(id.z, p, s, p - 1u));
    }
    if id.x + 1u < width {
        sum += given(kappa, own, neighbour(id.z, p, s, p + 1u));
    }
    if id.y > 0u {
        sum += given(kappa, own, neighbour(id.z, p, s, p - width));
    }
    if id.y + 1u < params.size.y {
        sum += given(kappa, own, neighbour(id.z, p, s, p + width));
    }
    drawn[own] = color - sum;
}
