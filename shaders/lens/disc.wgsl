// Tiles that show one closed surface of nearly constant depth: the exact opening by running sums: cpu/lens/disc.rs.

struct Params {
    size: vec2<u32>,
    s_focus: f32,
    // Radius steps per pixel, below and above `small_px`; discs are `apart` steps apart.
    small_px: f32,
    fine: f32,
    coarse: f32,
    apart: f32,
    // The disc of kernel 0.
    first_step: i32,
    // The rows of the discs that this pass adds.
    first_row: u32,
    end_row: u32,
    // The first cell of the front layer.
    front: u32,
    // The first tile of this pass.
    first_tile: u32,
}

struct Tile {
    origin: vec2<u32>,
    // The kernel of all its pixels; negative if it varies between pixels.
    kernel: i32,
    // The share of discs in the result; the rest has been swept.
    share: f32,
}

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sums: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> shifts: array<f32>;
@group(0) @binding(4) var<storage, read> kernels: array<u32>;
@group(0) @binding(5) var<storage, read> tiles: array<Tile>;
@group(0) @binding(6) var<storage, read_write> picture: array<f32>;

// The sum of the first x cells of a row, which is mirrored at its ends.
fn sum_before(row: u32, x: i32) -> vec4<f32> {
    let width = i32(params.size.x);
    let period = 2 * width;
    let place = ((x % period) + period) % period;
    let repeats = f32((x - place) / period);
    let total = sums[row + params.size.x];
    var sum = 2.0 * repeats * total;
    if place <= width {
        sum += sums[row + u32(place)];
    } else {
        sum += total + (total - sums[row + u32(period - place)]);
    }
    return sum;
}

// The sum of cells `first .. end` of a row, which is mirrored at its ends.
fn sum_between(y: u32, first: i32, end: i32) -> vec4<f32> {
    let row = y * (params.size.x + 1u);
    if first >= 0 && end <= i32(params.size.x) {
        return sums[row + u32(end)] - sums[row + u32(first)];
    }
    return sum_before(row, end) - sum_before(row, first);
}

// The mean over a disc around a pixel, or the contribution of this pass's rows to it.
fn convolved(at: vec2<i32>, kernel: Kernel) -> vec4<f32> {
    var runs = vec4<f32>();
    var edges = vec4<f32>();
    for (var i = params.first_row; i < min(kernel.count, params.end_row); i++) {
        let row = kernel_row(kernel, i);
        let y = u32(mirrored(at.y + kernel.first_dy + i32(i), i32(params.size.y)));
        if row.run.x < row.run.y {
            runs += sum_between(y, at.x + row.run.x, at.x + row.run.y);
        }
        for (var j = 0u; j < row.count; j++) {
            let x = u32(mirrored(at.x + partial_dx(row, j), i32(params.size.x)));
            edges += partial_weight(row, j) * colors[params.front + y * params.size.x + x];
        }
    }
    return kernel.run_weight * runs + edges;
}

// The position of a shift on the scale of the discs between which pixels are interpolated.
fn position(s: f32) -> f32 {
    let t = s - params.s_focus;
    let r = abs(t);
    let far = params.small_px * params.fine + (r - params.small_px) * params.coarse;
    return sign(t) * select(far, r * params.fine, r < params.small_px) / params.apart;
}

fn blurred(at: vec2<u32>, tile: Tile) -> vec4<f32> {
    let place = vec2<i32>(at);
    if tile.kernel >= 0 {
        return convolved(place, kernel_at(u32(tile.kernel)));
    }
    // Interpolates between two discs.
    let p = position(shifts[params.front + at.y * params.size.x + at.x]);
    let below = floor(p);
    let kernel = u32(i32(below) - params.first_step);
    var sum = (1.0 - (p - below)) * convolved(place, kernel_at(kernel));
    if p > below {
        sum += (p - below) * convolved(place, kernel_at(kernel + 1u));
    }
    return sum;
}

@compute @workgroup_size(64, 4)
fn disc(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) thread: vec3<u32>) {
    let tile = tiles[params.first_tile + group.x];
    let at = tile.origin + vec2(thread.x, 4u * group.y + thread.y);
    if any(at >= params.size) {
        return;
    }
    let pixel = at.y * params.size.x + at.x;
    let value = blurred(at, tile);
    for (var c = 0u; c < CHANNELS; c++) {
        var before = 0.0;
        if params.first_row > 0u {
            before = picture[pixel * CHANNELS + c];
        } else if tile.share < 1.0 {
            before = (1.0 - tile.share) * picture[pixel * CHANNELS + c];
        }
        picture[pixel * CHANNELS + c] = before + tile.share * value[c];
    }
}
