// The picture, interpolated between itself and two targets of the chain by its circle of confusion.

struct Params {
    size: vec2<u32>,
    small: vec2<u32>,
    // Pixels of the picture per pixel of a target, along each axis.
    block: u32,
    // Blur begins where this is 1, and is full where it is 2.
    @align(16) beginning: Defocus,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read> half_way: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> last: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> picture: array<f32>;

// Both targets.
struct Targets {
    half_way: vec4<f32>,
    last: vec4<f32>,
}

fn mixed(a: Targets, b: Targets, fraction: f32) -> Targets {
    return Targets(
        a.half_way + fraction * (b.half_way - a.half_way),
        a.last + fraction * (b.last - a.last),
    );
}

fn targets_at(x: i32, y: i32) -> Targets {
    let i = index_in(params.small, x, y);
    return Targets(half_way[i], last[i]);
}

// Both targets, interpolated at a pixel of the picture.
fn enlarged(at: vec2<u32>) -> Targets {
    // Pixel centres are at halves, so twice the position in the target's pixels is this integer over the block's
    // side.
    let twice = 2 * vec2<i32>(at) + 1 - i32(params.block);
    let side = 2 * i32(params.block);
    // Rounded down, because integer division rounds towards zero.
    let first = (twice + side) / side - 1;
    let beyond = vec2<f32>(twice - first * side) / f32(side);
    let left = mixed(targets_at(first.x, first.y), targets_at(first.x, first.y + 1), beyond.y);
    let right = mixed(targets_at(first.x + 1, first.y), targets_at(first.x + 1, first.y + 1), beyond.y);
    return mixed(left, right, beyond.x);
}

// From the sharp picture at level 0 by way of the target at 1/2 to the one at 1.
fn between_levels(level: f32, sharp: vec4<f32>, targets: Targets) -> vec4<f32> {
    if level > 0.5 {
        return targets.half_way + (2.0 * level - 1.0) * (targets.last - targets.half_way);
    }
    return sharp + 2.0 * level * (targets.half_way - sharp);
}

@compute @workgroup_size(16, 16)
fn interpolate(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = id.y * params.size.x + id.x;
    let level = clamp(abs(defocus_at(params.beginning, disparity[pixel])) - 1.0, 0.0, 1.0);
    let value = between_levels(level, color_at(params.size, pixel), enlarged(id.xy));
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
    }
}
