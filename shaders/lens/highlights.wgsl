// Highlights as exact discs of which a part is visible: cpu/lens/highlights.rs.

struct Params {
    size: vec2<u32>,
    // The padded frame.
    padded: vec2<u32>,
    pad: vec2<i32>,
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
    // The first tile of this pass.
    first_tile: u32,
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

// A tile, the range of its highlights that this pass draws, and the share of exact discs in it.
struct Tile {
    origin: vec2<u32>,
    first: u32,
    count: u32,
    disc: f32,
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
// The nearest code in each block of the padded frame; then for each layer whether it is a holdout.
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

// Whether a layer is a holdout, which is no part of a highlight's surface.
fn is_holdout(layer: u32) -> bool {
    let blocks = params.padded / u32(params.block);
    return block_nearest[blocks.x * blocks.y + layer] != 0u;
}

// How much a cell of a span of depth, so many pixels away, is of the highlight's surface.
fn is_same_surface(highlight: Highlight, span: vec2<u32>, distance: f32) -> f32 {
    let nearest_own = highlight.codes >> 16u;
    let farthest_own = highlight.farthest_and_layer & 0xffffu;
    let gap = max(max(span.x, nearest_own) - nearest_own, farthest_own - min(span.y, farthest_own));
    let beyond = f32(gap) * params.step - f32(nearest_own - farthest_own) * params.step * distance;
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
    let plane = half_plane(number, at);
    let cut = plane.cut - (plane.normal.x * offset.x + plane.normal.y * offset.y);
    return plane.opacity * area_below(plane.normal, cut);
}

// The number of steps for which a beam and the cells beside it certainly stay in the block of a padded cell; 0 if they
// may lie in two.
fn steps_inside(cell: vec2<i32>, slope: vec2<f32>) -> i32 {
    var steps = f32(params.block);
    for (var i = 0; i < 2; i++) {
        let inside = cell[i] % params.block;
        let last = params.block - 1;
        if inside < 2 || inside > last - 2 {
            return 0;
        }
        // Two cells beside; rounding may gain one step.
        let to_border = select(inside - 2, last - 2 - inside, slope[i] > 0.0);
        if slope[i] != 0.0 {
            steps = min(steps, f32(to_border) / abs(slope[i]));
        }
    }
    return i32(steps);
}

// A beam on its way from a highlight to the lens, one cell at a time along the longer axis of the lens point.
struct Path {
    // The code of the highlight's depth.
    code: f32,
    code_per_step: f32,
    // Cells per step along each axis, and the next cell along the shorter one.
    slope: vec2<f32>,
    aside: vec2<i32>,
    steps: i32,
}

fn path_from(highlight: Highlight, l: vec2<f32>) -> Path {
    // A beam through the middle of the lens stays at its pixel. As a step that takes very long, it needs no case of its
    // own.
    let longest = max(max(abs(l.x), abs(l.y)), 1e-9);
    return Path(
        f32(highlight.codes & 0xffffu),
        1.0 / (longest * params.step),
        select(l / longest, vec2(1.0, 0.0), all(l == vec2<f32>())),
        select(vec2(0, 1), vec2(1, 0), abs(l.y) > abs(l.x)),
        i32(ceil((params.reach_px - highlight.t) * longest)),
    );
}

// The least and the greatest code at which a beam is less than a step away from step `k`.
fn codes_at(path: Path, k: i32) -> vec2<u32> {
    let from_code = max(path.code + f32(k - 1) * path.code_per_step, path.code);
    let to_code = min(path.code + f32(k + 1) * path.code_per_step, 65535.0);
    return vec2(u32(min(from_code, 65535.0)), u32(to_code));
}

// Whether a cell of a layer is behind the highlight. Of two cells of one pixel, the one in the earlier layer is in front
// where their depths meet.
fn is_behind(highlight: Highlight, moved: vec2<i32>, layer: u32, span: vec2<u32>) -> bool {
    let code = highlight.codes & 0xffffu;
    let own_layer = highlight.farthest_and_layer >> 16u;
    if any(moved != vec2(0)) || layer < own_layer {
        return span.y < code;
    }
    return layer == own_layer || span.x <= code;
}

// The fraction of the beam that the cells of a pixel hide, which it passes at step `k`, so many cells away.
fn hidden_by(highlight: Highlight, path: Path, moved: vec2<i32>, k: i32) -> f32 {
    let at = highlight.place + moved;
    let pixel = index_in(params.size, at.x, at.y);
    let near = codes_at(path, k);
    var hidden = 0.0;
    for (var layer = 0u; layer < params.layers; layer++) {
        let cell = layer * params.size.x * params.size.y + pixel;
        let span = vec2(farthest(codes[cell]), nearest(codes[cell]));
        if span.y < near.x || span.x > near.y || is_behind(highlight, moved, layer, span) {
            continue;
        }
        let middle = path.code + f32(k) * path.code_per_step;
        let code = min(max(middle, max(f32(span.x), path.code)), f32(span.y));
        let offset = (code - path.code) / path.code_per_step * path.slope - vec2<f32>(moved);
        let shares = max(vec2(1.0) - abs(offset), vec2<f32>());
        if shares.x * shares.y > 0.0 {
            var let_through = 0.0;
            if any(moved != vec2(0)) && !is_holdout(layer) {
                let_through = is_same_surface(highlight, vec2(span.x, 65535u), f32(k));
                let own_layer = highlight.farthest_and_layer >> 16u;
                if layer != own_layer {
                    // The cluster's surface goes on in another layer where its own layer has another surface.
                    let own = codes[own_layer * params.size.x * params.size.y + pixel];
                    let_through *= 1.0 - is_same_surface(highlight, vec2(farthest(own), nearest(own)), f32(k));
                }
            }
            hidden += shares.x * shares.y * covered(cell, at, offset) * (1.0 - let_through);
        }
    }
    return hidden;
}

// The fraction of a pixel's rays near lens point `l` that meet nothing before they meet the highlight.
fn visible_from(highlight: Highlight, l: vec2<f32>) -> f32 {
    let path = path_from(highlight, l);
    var visible = 1.0;
    var k = 0;
    while k <= path.steps && visible > 0.0 {
        let along = f32(k) * path.slope;
        let moved = vec2<i32>(vec2(rounded(along.x), rounded(along.y)));
        var padded = highlight.place + moved + params.pad;
        if any(padded < vec2(2)) || any(padded >= vec2<i32>(params.padded) - 2) {
            // Mirror images repeat after twice the frame.
            let period = 2 * vec2<i32>(params.size);
            padded = ((padded - 2) % period + period) % period + 2;
            if any(padded >= vec2<i32>(params.padded) - 2) {
                break;
            }
        }
        let inside = steps_inside(padded, path.slope);
        let block = padded / params.block;
        let nearest_there = block_nearest[u32(block.y) * (params.padded.x / u32(params.block)) + u32(block.x)];
        if inside > 0 && nearest_there < codes_at(path, k).x {
            // No cell in this block is near enough, and the beam only comes nearer to the camera.
            k += inside;
            continue;
        }
        // The beam touches cells that it is less than a pixel away from, on its way from the step before to the next one.
        let first = select(moved, vec2<i32>(floor(along)) - 1, path.aside == vec2(1));
        for (var beside = 0; beside < 4; beside++) {
            visible -= hidden_by(highlight, path, first + beside * path.aside, k);
        }
        k++;
    }
    return max(visible, 0.0);
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
        if max(abs(d.x), abs(d.y)) > i32(ceil(abs(highlight.t))) + 2 {
            continue;
        }
        let nearer = weight_at(kernel_at(highlight.kernels.x), d);
        let farther = weight_at(kernel_at(highlight.kernels.y), d);
        var weight = nearer + highlight.share * (farther - nearer);
        if weight > 0.0 && clips(params.second_stop) {
            weight *= clipped_share(params.second_stop, vec2<f32>(at), vec2<f32>(d), highlight.t);
        }
        of_cluster += weight * mix(highlight.drawn, 1.0, tile.disc) * highlight.light;
    }
    if any(of_cluster != vec4(0.0)) {
        sum += visible_part(middle, at) * of_cluster;
    }
    return sum;
}

@compute @workgroup_size(64, 4)
fn draw_highlights(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) thread: vec3<u32>) {
    let tile = tiles[params.first_tile + group.x];
    let at = tile.origin + vec2(thread.x, 4u * group.y + thread.y);
    if any(at >= params.size) {
        return;
    }
    let value = light_at(vec2<i32>(at), tile);
    for (var c = 0u; c < CHANNELS; c++) {
        picture[(at.y * params.size.x + at.x) * CHANNELS + c] += value[c];
    }
}
