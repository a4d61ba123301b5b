// Light along lines, from circles of confusion that reach a pixel: plan/hexagonal.rs. Of the pass that uses this are
// `near_radius`, `near_light` and `rest_light`: what a place holds, of the picture or of a target.

// One look-up on the way along a line.
struct Tap {
    dx: i32,
    dy: i32,
    share: f32,
    from_px: f32,
    step_px: f32,
}

struct Params {
    size: vec2<u32>,
    // Targets have a margin around the picture: their size, and the place of the picture's first pixel.
    frame: vec2<u32>,
    origin: vec2<u32>,
    count: u32,
    // One over the number of parallelograms in the sum.
    scale: f32,
    // First tap of each line, the one after its last, and the target that it belongs to.
    lines: array<vec4<u32>, 4>,
    max_coc_px: f32,
    @align(16) shift: Defocus,
}

// What a target holds of a pixel: light in front over its radius, what is seen of the rest, and in `parts` the coverage and
// the radius of the light in front, and how much is seen of the rest.
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

// What is not in front, times the part of it that is seen, and that part.
struct Rest {
    color: vec4<f32>,
    seen: f32,
}

// What lines bring to a pixel.
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

// How much of a step of a line a circle of confusion reaches, times the step's share.
fn part(tap: Tap, radius: f32) -> f32 {
    return tap.share * clamp(radius - tap.from_px, 0.0, tap.step_px);
}

// The weight of what is not in front, as seen from a pixel with the circle of confusion `own`: one behind the focus sees
// what circles of less than twice its own bring, one in front looks behind itself as far as its own reaches.
fn rest_weight(tap: Tap, own: f32, coc: f32) -> f32 {
    if own < 0.0 {
        return part(tap, -own);
    }
    return select(0.0, part(tap, coc) / max(coc, 1e-30), coc > 0.0 && coc < 2.0 * own);
}

// What one line of a target brings to a pixel.
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
    // Where nothing reaches a pixel, it sees itself; what is behind the focus is seen as much as itself.
    let itself = rest_light(line.z, at, own);
    out.rest.color += select(itself.color, along.color / max(total, 1e-30), total > 0.0);
    let behind = select(0.0, along.seen / max(total, 1e-30), total > 0.0);
    out.rest.seen += select(itself.seen, behind, own < 0.0);
    return out;
}
