// The part of each pixel that is drawn as a sprite: plan/sprites.rs.

struct Params {
    size: vec2<u32>,
    // The size of the targets.
    half: vec2<u32>,
    // The column and the row of the first bin, and their numbers.
    first_bin: vec2<i32>,
    bins: vec2<u32>,
    // The largest distance of a sprite's pixels from its point.
    reach: i32,
    // The disparities at which one radius step ends and the next begins, from the nearest step on, and the number of
    // that step.
    boundaries: u32,
    first_step: u32,
    layer: u32,
    // The rows of bins around a tile that one pass gathers, counted from the first that can reach the tile.
    first_row: i32,
    end_row: i32,
    threshold_px: f32,
    max_coc_px: f32,
    // The first row of this pass, where one is cut.
    top: u32,
    @align(16) shift: Defocus,
}

const IN_FRONT: u32 = 0u;
const BEHIND: u32 = 1u;

@group(0) @binding(0) var<uniform> params: Params;

// The signed radius of the circle of confusion after limiting.
fn coc_of(pixel: u32) -> f32 {
    return clamp(-defocus_at(params.shift, disparity[pixel]), -params.max_coc_px, params.max_coc_px);
}

// The part of a pixel that is drawn as a sprite.
fn drawn(coc: f32) -> f32 {
    return clamp(abs(coc) / params.threshold_px - 1.0, 0.0, 1.0);
}
