// Light that travels along lines to a pixel, from circles of confusion that reach it: plan/hexagonal.rs. The pass
// that includes this file defines `near_radius`, `near_light` and `rest_light`, which read the picture or a target.

// One look-up along a line.
struct Tap {
    dx: i32,
    dy: i32,
    share: f32,
    from_px: f32,
    step_px: f32,
}

struct Params {
    size: vec2<u32>,
    // Targets have a margin around the picture: their size, and the position of the picture's first pixel.
    frame: vec2<u32>,
    origin: vec2<u32>,
    count: u32,
    // One over the number of parallelograms in the sum.
    scale: f32,
    // For each line: its first tap, the one after its last, and the index of its target.
    lines: array<vec4<u32>, 4>,
    max_coc_px: f32,
    // The first row of this pass.
    top: u32,
    @align(16) shift: Defocus,
}

// A pixel of a target: light in front over its radius, and the visible light of the rest. `parts` holds the coverage
// and the radius of the light in front, and the visible part of the rest.
struct Texel {
    near: vec4<f32>,
    rest: vec4<f32>,
    parts: vec4<f32>,
}

// Light in front of the focus, divided by its radius.
struct Near {
    color: vec4<f32>,
    coverage: f32,
}

// Everything that is not in front: its colour times the visible part of it, and that part.
struct Rest {
    color: vec4<f32>,
    seen: f32,
}

// The sums over the lines of a pixel.
struct Sums {
    near: Near,
    // The largest circle of confusion of the light in front.
    radius: f32,
    rest: Rest,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read> taps: array<Tap>;

// The signed radius of the circle of confusion.
fn coc_of(pixel: u32) -> f32 {
    return clamp(-defocus_at(params.shift, disparity[pixel]), -params.max_coc_px, params.max_coc_px);
}

fn frame_index(at: vec2<i32>) -> u32 {
    let place = vec2<u32>(at + vec2<i32>(params.origin));
    return place.y * params.frame.x + place.x;
}

// The fraction of a line's step that a circle of confusion reaches, times the step's share.
fn part(tap: Tap, radius: f32) -> f32 {
    return tap.share * clamp(radius - tap.from_px, 0.0, tap.step_px);
}

// The weight of light that is not in front, for a pixel with the circle of confusion `own`. A pixel behind the focus
// receives light from circles smaller than twice its own. A pixel in front gathers the light behind itself as far as
// its own circle reaches.
fn rest_weight(tap: Tap, own: f32, coc: f32) -> f32 {
    if own < 0.0 {
        return part(tap, -own);
    }
    return select(0.0, part(tap, coc) / max(coc, 1e-30), coc > 0.0 && coc < 2.0 * own);
}

// Adds one line of a target at a pixel.
fn add_line(sums: Sums, line: vec4<u32>, at: vec2<i32>, own: f32) -> Sums {
    var out = sums;
    var along = Rest();
    var total = 0.0;
    for (var i = line.x; i < line.y; i++) {
        let tap = taps[i];
        let from_at = at + vec2<i32>(tap.dx, tap.dy);
        let coc = coc_of(index_in(params.size, from_at.x, from_at.y));
        let radius = near_radius(line.z, from_at, coc);
        let reached = part(tap, radius);
        if reached > 0.0 {
            let near = near_light(line.z, from_at, coc);
            out.near.color += reached * near.color;
            out.near.coverage += reached * near.coverage;
            out.radius = max(out.radius, radius);
        }
        let weight = rest_weight(tap, own, coc);
        if weight > 0.0 {
            let rest = rest_light(line.z, from_at, coc);
            along.color += weight * rest.color;
            along.seen += weight * rest.seen;
            total += weight;
        }
    }
    // A pixel that no light reaches shows itself. The visible part of a pixel behind the focus is its own.
    let itself = rest_light(line.z, at, own);
    out.rest.color += select(itself.color, along.color / max(total, 1e-30), total > 0.0);
    let behind = select(0.0, along.seen / max(total, 1e-30), total > 0.0);
    out.rest.seen += select(itself.seen, behind, own < 0.0);
    return out;
}
