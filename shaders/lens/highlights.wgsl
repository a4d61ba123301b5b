// Highlights as exact discs of which a part is visible: cpu/lens/highlights.rs.

struct Params {
    size: vec2<u32>,
    // The padded frame.
    padded: vec2<u32>,
    pad: i32,
    block: i32,
    layers: u32,
    s_focus: f32,
    // The largest shift of any cell.
    reach_px: f32,
    // The coding of shifts: s = s_min + (code - 1) step.
    s_min: f32,
    step: f32,
    // The gaps up to which depth spans are on one surface, and from which on they are on two.
    same_surface_px: f32,
    other_surface_px: f32,
    @align(16) second_stop: SecondStop,
}

// A highlight: its light, its pixel, its shift, the discs between which its own lies with the share of the second, and
// the middle of its cluster.
struct Highlight {
    light: vec4<f32>,
    place: vec2<i32>,
    t: f32,
    share: f32,
    kernels: vec2<u32>,
    middle: u32,
    // Its own code in the low half, and the nearest of its span in the high half.
    codes: u32,
    // The farthest code of its span in the low half, and in the high half its layer, or `NOT_HIDDEN`.
    farthest_and_layer: u32,
    // The part of the light that is not swept.
    drawn: f32,
}

// A tile, the range of its highlights that this pass draws, and whether it is swept.
struct Tile {
    origin: vec2<u32>,
    first: u32,
    count: u32,
    is_swept: u32,
}

// In place of the layer: nothing hides any part of the cluster.
const NOT_HIDDEN: u32 = 0xffffu;

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> codes: array<u32>;
@group(0) @binding(2) var<storage, read> half_planes: array<u32>;
@group(0) @binding(3) var<storage, read> kernels: array<u32>;
@group(0) @binding(4) var<storage, read> highlights: array<Highlight>;
@group(0) @binding(5) var<storage, read> tiles: array<Tile>;
// The indices of the highlights of each tile.
@group(0) @binding(6) var<storage, read> lists: array<u32>;
// The nearest code in each block of the padded frame.
@group(0) @binding(7) var<storage, read> block_nearest: array<u32>;
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

// Whether another layer has a cell at the highlight's own pixel, in front of it by no more than `within` pixels.
fn is_covered(highlight: Highlight, within: f32) -> bool {
    let pixel = index_in(params.size, highlight.place.x, highlight.place.y);
    let own = highlight.codes & 0xffffu;
    for (var layer = 0u; layer < params.layers; layer++) {
        let lo = farthest(codes[layer * params.size.x * params.size.y + pixel]);
        if layer != highlight.farthest_and_layer >> 16u && lo > own && f32(lo - own) * params.step <= within {
            return true;
        }
    }
    return false;
}

// The part of a highlight's light that a cell of its own layer lets through, `distance` pixels away.
fn same_surface(highlight: Highlight, lo: u32, distance: f32) -> f32 {
    let nearest_own = highlight.codes >> 16u;
    let own_span = f32(nearest_own - (highlight.farthest_and_layer & 0xffffu)) * params.step;
    let gap = f32(max(lo, nearest_own) - nearest_own) * params.step;
    let beyond = gap - own_span * distance;
    return clamp((params.other_surface_px - beyond) / (params.other_surface_px - params.same_surface_px), 0.0, 1.0);
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

// The fraction of a beam one pixel wide that a cell hides, if the beam passes it at an offset from its centre.
fn covered(cell: u32, at: vec2<i32>, offset: vec2<f32>) -> f32 {
    let number = half_planes[cell];
    if number == 0u {
        return 1.0;
    }
    let words = params.layers * params.size.x * params.size.y + 3u * (number - 1u);
    let normal = vec2(bitcast<f32>(half_planes[words]), bitcast<f32>(half_planes[words + 1u]))
        * mirroring(params.size, at.x, at.y);
    return area_below(normal, bitcast<f32>(half_planes[words + 2u]) - (normal.x * offset.x + normal.y * offset.y));
}

// A lower bound on the number of steps after which a ray from a padded cell leaves its block.
fn steps_inside(cell: vec2<i32>, slope: vec2<f32>) -> i32 {
    var steps = 1e9;
    for (var i = 0; i < 2; i++) {
        let inside = cell[i] % params.block;
        let to_border = select(inside + 1, params.block - inside, slope[i] > 0.0);
        if slope[i] != 0.0 {
            steps = min(steps, f32(to_border - 1) / abs(slope[i]));
        }
    }
    return max(i32(steps), 1);
}

// The fraction of a pixel's rays near lens point `l` that meet nothing before they meet the highlight.
fn visible_from(highlight: Highlight, l: vec2<f32>) -> f32 {
    let longest = max(abs(l.x), abs(l.y));
    if longest == 0.0 {
        return select(1.0, 0.0, is_covered(highlight, 1e30));
    }
    if is_covered(highlight, 0.5 / longest) {
        return 0.0;
    }
    let code_per_step = 1.0 / (longest * params.step);
    let start = f32(highlight.codes & 0xffffu);
    // Steps outwards from the highlight, one cell at a time along the longer axis.
    let slope = l / longest;
    let steps = i32(ceil((params.reach_px - highlight.t) * longest));
    // A straight edge may be met in more than one cell, but must hide its part of the beam only once.
    var visible = 1.0;
    var k = 1;
    while k <= steps {
        let along = f32(k) * slope;
        let moved = vec2(rounded(along.x), rounded(along.y));
        let at = highlight.place + vec2<i32>(moved);
        let padded = at + params.pad;
        if any(padded < vec2(0)) || any(padded >= vec2<i32>(params.padded)) {
            break;
        }
        let from_code = u32(min(start + (f32(k) - 0.5) * code_per_step, 65535.0));
        let to_code = u32(min(start + (f32(k) + 0.5) * code_per_step, 65535.0));
        let block = padded / params.block;
        if block_nearest[u32(block.y) * (params.padded.x / u32(params.block)) + u32(block.x)] < from_code {
            // No cell in this block is near enough, and the ray only comes nearer to the camera.
            k += steps_inside(padded, slope);
            continue;
        }
        let pixel = index_in(params.size, at.x, at.y);
        for (var layer = 0u; layer < params.layers; layer++) {
            let cell = layer * params.size.x * params.size.y + pixel;
            let lo = farthest(codes[cell]);
            if nearest(codes[cell]) >= from_code && lo < to_code {
                // The position of the ray in this cell, relative to the cell's centre; the ray passes through the
                // highlight.
                let t_cell = params.s_min + (f32(lo) - 1.0) * params.step - params.s_focus - highlight.t;
                var hides = 1.0;
                if layer == highlight.farthest_and_layer >> 16u {
                    hides -= same_surface(highlight, lo, f32(k));
                }
                visible = min(visible, 1.0 - covered(cell, at, l * t_cell - moved) * hides);
            }
        }
        if visible == 0.0 {
            break;
        }
        k++;
    }
    return visible;
}

// The part of a cluster's light that is visible at a pixel.
fn visible_part(middle: u32, at: vec2<i32>) -> f32 {
    let highlight = highlights[middle];
    if highlight.farthest_and_layer >> 16u == NOT_HIDDEN {
        return 1.0;
    }
    var drawn_px = max(abs(highlight.t), 0.5);
    if highlight.t < 0.0 {
        drawn_px = -drawn_px;
    }
    return visible_from(highlight, vec2<f32>(highlight.place - at) / drawn_px);
}

// The light of all highlights at one pixel. Those of a cluster follow one another.
fn light_at(at: vec2<i32>, tile: Tile) -> vec4<f32> {
    var sum = vec4<f32>();
    var of_cluster = vec4<f32>();
    var middle = 0u;
    for (var i = 0u; i < tile.count; i++) {
        let highlight = highlights[lists[tile.first + i]];
        if highlight.middle != middle {
            if any(of_cluster != vec4(0.0)) {
                sum += visible_part(middle, at) * of_cluster;
            }
            of_cluster = vec4<f32>();
            middle = highlight.middle;
        }
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
        of_cluster += weight * select(1.0, highlight.drawn, tile.is_swept != 0u) * highlight.light;
    }
    if any(of_cluster != vec4(0.0)) {
        sum += visible_part(middle, at) * of_cluster;
    }
    return sum;
}

@compute @workgroup_size(64, 4)
fn draw_highlights(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) thread: vec3<u32>) {
    let tile = tiles[group.x];
    let at = tile.origin + vec2(thread.x, 4u * group.y + thread.y);
    if any(at >= params.size) {
        return;
    }
    let value = light_at(vec2<i32>(at), tile);
    for (var c = 0u; c < CHANNELS; c++) {
        picture[(at.y * params.size.x + at.x) * CHANNELS + c] += value[c];
    }
}
