// How much of each pixel is drawn as a sprite: plan/sprites.rs.

struct Params {
    size: vec2<u32>,
    // The targets, and the values from one of their rows to the next.
    half: vec2<u32>,
    pitch: u32,
    // Mirrored pixels on every side whose sprites may reach the picture.
    reach: i32,
    // Places in disparity where one step of radius ends and the next begins, from the nearest step on, and the number
    // of that one.
    boundaries: u32,
    first_step: u32,
    // Workgroups to a row of them.
    groups_across: u32,
    layer: u32,
    // The rows around a pixel that one pass gathers.
    first_row: i32,
    end_row: i32,
    threshold_px: f32,
    max_coc_px: f32,
    @align(16) shift: Defocus,
}

const IN_FRONT: u32 = 0u;
const BEHIND: u32 = 1u;

@group(0) @binding(0) var<uniform> params: Params;

// The signed radius of the circle of confusion as it is drawn.
fn coc_of(pixel: u32) -> f32 {
    return clamp(-defocus_at(params.shift, disparity[pixel]), -params.max_coc_px, params.max_coc_px);
}

// How much of a pixel is drawn as a sprite.
fn drawn(coc: f32) -> f32 {
    return clamp(abs(coc) / params.threshold_px - 1.0, 0.0, 1.0);
}
