// Highlights as exact discs, of which a part is visible: cpu/lens/highlights.rs.

struct Params {
    size: vec2<u32>,
    // Pixels on each side of a pixel whose samples also tell how much light it sees.
    window: i32,
    // The largest difference in shift between neighbouring cells of one surface.
    connected_px: f32,
    // The weight of a pixel's own samples where it shows more than one surface.
    own_weight: f32,
    layers: u32,
    @align(16) second_stop: SecondStop,
}

// A highlight: its light, its pixel, its shift, and the discs between which its own lies with the share of the second.
struct Highlight {
    light: vec4<f32>,
    place: vec2<i32>,
    t: f32,
    share: f32,
    kernels: vec2<u32>,
}

// A tile, the range of its highlights that this pass draws, and whether some of their light may be hidden.
struct Tile {
    origin: vec2<u32>,
    first: u32,
    count: u32,
    is_hidden_in_part: u32,
}

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> kernels: array<u32>;
@group(0) @binding(2) var<storage, read> highlights: array<Highlight>;
@group(0) @binding(3) var<storage, read> tiles: array<Tile>;
// The indices of the highlights of each tile.
@group(0) @binding(4) var<storage, read> lists: array<u32>;
// For each pixel: the light that is met, and the light that would be met if nothing stood in between.
@group(0) @binding(5) var<storage, read> lights: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> shifts: array<f32>;
// For each cell 0, or one more than the index of its half-plane; then the half-planes.
@group(0) @binding(7) var<storage, read> half_planes: array<u32>;
@group(0) @binding(8) var<storage, read_write> picture: array<f32>;

fn open_value(i: u32) -> f32 {
    return bitcast<f32>(kernels[i]);
}

// The part of a pixel that a disc covers, at an offset from the disc's centre.
fn weight_at(kernel: Kernel, d: vec2<i32>) -> f32 {
    let i = d.y - kernel.first_dy;
    if i < 0 || i >= i32(kernel.count) {
        return 0.0;
    }
    let row = kernel_row(kernel, u32(i));
    if d.x >= row.run.x && d.x < row.run.y {
        return kernel.run_weight;
    }
    for (var j = 0u; j < row.count; j++) {
        if partial_dx(row, j) == d.x {
            return partial_weight(row, j);
        }
    }
    return 0.0;
}

// The light of all highlights at one pixel, as if nothing stood before them.
fn light_at(at: vec2<i32>, tile: Tile) -> vec4<f32> {
    var sum = vec4<f32>();
    for (var i = 0u; i < tile.count; i++) {
        let highlight = highlights[lists[tile.first + i]];
        let d = highlight.place - at;
        if max(abs(d.x), abs(d.y)) > i32(ceil(abs(highlight.t))) + 1 {
            continue;
        }
        let nearer = weight_at(kernel_at(highlight.kernels.x), d);
        let farther = weight_at(kernel_at(highlight.kernels.y), d);
        var weight = nearer + highlight.share * (farther - nearer);
        if weight > 0.0 && clips(params.second_stop) {
            weight *= clipped_share(params.second_stop, vec2<f32>(at), vec2<f32>(d), highlight.t);
        }
        sum += weight * highlight.light;
    }
    return sum;
}

// The weight of a neighbour for the visibility at a pixel, by its offset and by how far apart their shifts are.
fn neighbour_weight(offset: vec2<i32>, apart_px: f32) -> f32 {
    let near = vec2(params.window + 1) - abs(offset);
    let distance = f32(max(max(abs(offset.x), abs(offset.y)), 1));
    return f32(near.x * near.y) * clamp(2.0 - apart_px / (params.connected_px * distance), 0.0, 1.0);
}

// The area of a pixel in which `normal . f <= cut`.
fn area_below(normal: vec2<f32>, cut: f32) -> f32 {
    let p = min(abs(normal.x), abs(normal.y));
    let q = max(abs(normal.x), abs(normal.y));
    let moved = max(0.5 * (p + q) - abs(cut), 0.0);
    var area = (moved - 0.5 * p) / q;
    if moved < p {
        area = moved * moved / (2.0 * p * q);
    }
    return select(1.0 - area, area, cut <= 0.0);
}

// The part of a pixel that the first layer covers.
fn coverage(pixel: u32) -> f32 {
    let number = half_planes[pixel];
    if number == 0u {
        return 1.0;
    }
    let words = params.layers * params.size.x * params.size.y + 3u * (number - 1u);
    let normal = vec2(bitcast<f32>(half_planes[words]), bitcast<f32>(half_planes[words + 1u]));
    return area_below(normal, bitcast<f32>(half_planes[words + 2u]));
}

// The visible part around a pixel, as the pixels see it that show only a surface of shift `s`.
fn beside(at: vec2<i32>, s: f32) -> vec4<f32> {
    let first = max(at - params.window, vec2(0));
    let last = min(at + params.window, vec2<i32>(params.size) - 1);
    let own = u32(at.y) * params.size.x + u32(at.x);
    var met_light = params.own_weight * lights[2u * own];
    var all_light = params.own_weight * lights[2u * own + 1u];
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let pixel = u32(y) * params.size.x + u32(x);
            if half_planes[pixel] == 0u {
                let weight = neighbour_weight(vec2(x, y) - at, abs(shifts[pixel] - s));
                met_light += weight * lights[2u * pixel];
                all_light += weight * lights[2u * pixel + 1u];
            }
        }
    }
    // If no sample says anything, nothing is hidden.
    return select(vec4(1.0), met_light / max(all_light, vec4(1e-37)), all_light > vec4(0.0));
}

// The part of the light that is visible at a pixel. Where it shows two surfaces, it is as much as beside the edge, on
// either side.
fn visible_part(at: vec2<i32>) -> vec4<f32> {
    let pixel = u32(at.y) * params.size.x + u32(at.x);
    let front = beside(at, shifts[pixel]);
    let covered = coverage(pixel);
    if covered >= 1.0 || params.layers < 2u {
        return front;
    }
    let s = shifts[params.size.x * params.size.y + pixel];
    if s >= NOWHERE {
        return front;
    }
    let back = beside(at, s);
    return back + covered * (front - back);
}

@compute @workgroup_size(64, 4)
fn draw_highlights(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) thread: vec3<u32>) {
    let tile = tiles[group.x];
    let at = tile.origin + vec2(thread.x, 4u * group.y + thread.y);
    if any(at >= params.size) {
        return;
    }
    var value = light_at(vec2<i32>(at), tile);
    if tile.is_hidden_in_part != 0u && any(value != vec4(0.0)) {
        value *= visible_part(vec2<i32>(at));
    }
    for (var c = 0u; c < CHANNELS; c++) {
        picture[(at.y * params.size.x + at.x) * CHANNELS + c] += value[c];
    }
}
