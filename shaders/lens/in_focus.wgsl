// Tiles in focus, as the pinhole sees them, with the little blur that they have: cpu/lens/in_focus.rs.

struct Params {
    size: vec2<u32>,
    layers: u32,
    // Layers of cells.
    cell_layers: u32,
    // The loss of contrast at a quarter of a cycle, to leading order, per squared pixel of shift, along each axis.
    loss_per_px2: vec2<f32>,
    s_focus: f32,
    // The first tile of this pass.
    first_tile: u32,
    // Channels of the picture itself.
    own_channels: u32,
}

// Rounding of shifts moves a surface in focus by this loss of contrast at most, which is none.
const ROUNDING: f32 = 1e-8;

@group(0) @binding(0) var<uniform> params: Params;
// The planes of the picture itself: the last one of a layer is its coverage.
@group(0) @binding(2) var<storage, read> own_color: array<f32>;
// The first pixel of each tile.
@group(0) @binding(3) var<storage, read> tiles: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> shifts: array<f32>;
@group(0) @binding(5) var<storage, read_write> picture: array<f32>;

// What of what is behind a layer of the picture passes it.
fn passes(layer: u32, pixel: u32) -> f32 {
    let coverage = (layer + 1u) * params.own_channels - 1u;
    return 1.0 - own_color[coverage * params.size.x * params.size.y + pixel];
}

fn composed(x: i32, y: i32) -> vec4<f32> {
    let pixel = index_in(params.size, x, y);
    let layer = CHANNELS * params.size.x * params.size.y;
    var sum = color_at(params.size, pixel);
    var left = 1.0;
    for (var i = 1u; i < params.layers; i++) {
        left *= passes(i - 1u, pixel);
        sum += left * color_at(params.size, i * layer + pixel);
    }
    return sum;
}

// The weights of a neighbour in the same row and in the same column.
fn weights_at(pixel: u32) -> vec2<f32> {
    for (var layer = 0u; layer < params.cell_layers; layer++) {
        let s = shifts[layer * params.size.x * params.size.y + pixel];
        if s < NOWHERE {
            let t = s - params.s_focus;
            let loss = max(params.loss_per_px2 * (t * t) - ROUNDING, vec2<f32>());
            return 0.5 * (loss - loss * loss / 3.0);
        }
    }
    // Empty space has no depth, and no blur.
    return vec2<f32>();
}

@compute @workgroup_size(64, 4)
fn in_focus(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) thread: vec3<u32>) {
    let at = tiles[params.first_tile + group.x] + vec2(thread.x, 4u * group.y + thread.y);
    if any(at >= params.size) {
        return;
    }
    let pixel = at.y * params.size.x + at.x;
    let weights = weights_at(pixel);
    let place = vec2<i32>(at);
    let own = composed(place.x, place.y);
    let beside = (composed(place.x - 1, place.y) - own) + (composed(place.x + 1, place.y) - own);
    let over = (composed(place.x, place.y - 1) - own) + (composed(place.x, place.y + 1) - own);
    let value = own + weights.x * beside + weights.y * over;
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
