// Optical vignetting: the part of the opening that the barrel of a lens hides: plan/lens/optical_vignetting.rs. The
// pass that includes this file defines `open_value`, the table of open parts by the direction of the second stop and
// then by its distance.

// The second stop: its displacement across the opening, in radii, and the size and position of the table.
struct SecondStop {
    centre: vec2<f32>,
    per_px: f32,
    first: u32,
    // See `Aperture::leaning`.
    lean: vec2<f32>,
    directions: u32,
    distances: u32,
}

const TAU: f32 = 6.283185307;

fn clips(second_stop: SecondStop) -> bool {
    return second_stop.per_px > 0.0;
}

// The centre of the second stop, as seen from a pixel.
fn stop_of(second_stop: SecondStop, at: vec2<f32>) -> vec2<f32> {
    return second_stop.per_px * (at - second_stop.centre);
}

// The open part for one direction of the table.
fn open_along(second_stop: SecondStop, direction: u32, apart: f32) -> f32 {
    let i = min(u32(apart), second_stop.distances - 1u);
    let at = second_stop.first + (direction % second_stop.directions) * (second_stop.distances + 1u) + i;
    let nearer = open_value(at);
    return nearer + (apart - f32(i)) * (open_value(at + 1u) - nearer);
}

// The part of the opening's light that remains with the second stop at this position.
fn open_part(second_stop: SecondStop, stop: vec2<f32>) -> f32 {
    let farthest = f32(second_stop.distances);
    let apart = min(length(stop) * 0.5 * farthest, farthest);
    var turn = 0.0;
    if any(stop != vec2(0.0)) {
        turn = atan2(stop.y, stop.x) / TAU;
    }
    turn = (turn - floor(turn)) * f32(second_stop.directions);
    let direction = u32(turn);
    let along = open_along(second_stop, direction, apart);
    return along + (turn - f32(direction)) * (open_along(second_stop, direction + 1u, apart) - along);
}

// The weight for a pixel of the lens point from which it sees a highlight at the offset `d`, relative to a pixel that
// sees the whole opening. The opening is drawn `t` pixels large. Where it is inside its own pixel, that pixel has all
// of its light.
fn clipped_share(second_stop: SecondStop, at: vec2<f32>, d: vec2<f32>, t: f32) -> f32 {
    let beyond_pixel = clamp(abs(t) - 0.5, 0.0, 1.0);
    if beyond_pixel == 0.0 {
        return 1.0;
    }
    let l = d / t;
    let stop = stop_of(second_stop, at);
    var pupil = l / (1.0 - length(second_stop.lean) + dot(second_stop.lean, l));
    // A pixel on the rim of the lens itself is evaluated half a pixel inside, where its light is.
    let innermost = max(1.0 - 0.5 / abs(t), 0.0) / max(length(pupil), 1e-9);
    pupil *= min(innermost, 1.0);
    let open = open_part(second_stop, stop);
    var share = 0.0;
    if open > 0.0 {
        share = clamp(0.5 + abs(t) * (1.0 - length(pupil - stop)), 0.0, 1.0) / open;
    }
    return 1.0 + beyond_pixel * (share - 1.0);
}
