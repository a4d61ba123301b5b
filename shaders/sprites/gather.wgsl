// The light of one layer: every texel of the target adds up the sprites that cover it.
//
// A workgroup owns a tile of texels, and goes through the bins of points around it, row by row. It lists those that
// reach the tile, and holds their points in shared memory, of as many bins at a time as there is room for. Of these
// points each texel reads those that are near enough. A sum is made for each bin and added to those before: a sum of few
// numbers loses less precision than one of thousands, and it has the same bits wherever passes are cut.

struct Light {
    color: vec4<f32>,
    coverage: f32,
}

// The bins from which the largest sprite could reach a tile, as far as this pass goes through them.
struct Window {
    tile: vec2<i32>,
    // Column and row of the first bin among all, and the numbers of columns and bins.
    first: vec2<u32>,
    columns: u32,
    count: u32,
}

// Side of a tile.
const GROUP: u32 = 16u;
// The largest number of bins that are listed at a time, and of points that are held.
const CAPACITY: u32 = 256u;

@group(0) @binding(5) var<storage, read> bins: array<Bin>;
@group(0) @binding(6) var<storage, read> weights: array<f32>;
@group(0) @binding(7) var<storage, read_write> light: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> coverage: array<f32>;

// Which of the next bins reach the tile, a bit for each; then these bins and their numbers of points.
var<workgroup> reached: array<atomic<u32>, 8>;
var<workgroup> listed: array<vec3<u32>, 256>;
// The points that are held: colour times the part that is drawn, and that part.
var<workgroup> colors: array<vec4<f32>, 256>;
var<workgroup> parts: array<f32, 256>;
// The first texel of a point's sprite and the sprite's size, and the index of its first weight.
var<workgroup> boxes: array<vec4<i32>, 256>;
var<workgroup> first_weights: array<u32, 256>;

fn added(a: Light, b: Light) -> Light {
    return Light(a.color + b.color, a.coverage + b.coverage);
}

fn window_of(tile: vec2<i32>) -> Window {
    // Shifts round down, beyond the border too.
    let shift = vec2(firstTrailingBit(BIN_COLUMNS), firstTrailingBit(BIN_ROWS));
    let first = ((2 * tile - params.reach) >> shift) - params.first_bin;
    let last = ((2 * tile + 2 * i32(GROUP) + params.reach) >> shift) - params.first_bin;
    let end = min(last + 1, vec2<i32>(params.bins));
    let top = min(first.y + params.first_row, end.y);
    let rows = min(first.y + params.end_row, end.y) - top;
    let columns = u32(end.x - first.x);
    return Window(tile, vec2<u32>(vec2(first.x, top)), columns, columns * u32(rows));
}

fn bin_of(window: Window, k: u32) -> vec2<u32> {
    return window.first + vec2(k % window.columns, k / window.columns);
}

// Number of points of a bin, if any of its sprites may cover a texel of the tile.
fn points_of(window: Window, bin: vec2<u32>) -> u32 {
    let i = index_of_bin(params.layer, bin);
    let origin = origin_of_bin(bin);
    let last = origin + bin_size() - 1;
    let reaches = all((origin >> vec2(1u)) + bins[i].least < window.tile + i32(GROUP))
        && all((last >> vec2(1u)) + bins[i].greatest >= window.tile);
    return select(0u, bins[i].count, reaches);
}

// Lists the bins that reach the tile among those from `first` on, one for each thread. Returns their number.
fn list_bins(window: Window, first: u32, thread: u32) -> u32 {
    if thread < 8u {
        atomicStore(&reached[thread], 0u);
    }
    workgroupBarrier();
    let bin = bin_of(window, first + thread);
    // The word and the bit of the thread's own bin.
    let own = vec2(thread / 32u, 1u << (thread % 32u));
    var points = 0u;
    if first + thread < window.count {
        points = points_of(window, bin);
    }
    if points > 0u {
        atomicOr(&reached[own.x], own.y);
    }
    workgroupBarrier();
    var before = 0u;
    var count = 0u;
    for (var word = 0u; word < 8u; word++) {
        let bits = atomicLoad(&reached[word]);
        if word == own.x {
            before = count + countOneBits(bits & (own.y - 1u));
        }
        count += countOneBits(bits);
    }
    if points > 0u {
        listed[before] = vec3(bin, points);
    }
    workgroupBarrier();
    return count;
}

// Puts the point of a thread, if it is drawn, behind those that are held.
fn hold(bin: vec2<u32>, held: u32, thread: u32) {
    let i = index_of_bin(params.layer, bin);
    let own = vec2(thread % BIN_COLUMNS, thread / BIN_COLUMNS);
    let row = bins[i].rows[own.y];
    if (row >> own.x & 1u) == 0u {
        return;
    }
    let place = origin_of_bin(bin) + vec2<i32>(own);
    let pixel = pixel_at(place);
    let sprite = sprite_of(pixel, place);
    let part = drawn(coc_of(pixel));
    let corner = (place >> vec2(1u)) + vec2(sprite.left, sprite.top);
    let slot = held + bins[i].before[own.y] + countOneBits(row & ((1u << own.x) - 1u));
    colors[slot] = part * color_at(params.size, pixel);
    parts[slot] = part;
    boxes[slot] = vec4(corner, vec2<i32>(vec2(sprite.across, sprite.down)));
    first_weights[slot] = sprite.first;
}

// What a point adds to a texel.
fn light_of(slot: u32, texel: vec2<i32>) -> Light {
    let box = boxes[slot];
    // Left of the sprite or above it, these are large numbers.
    let d = vec2<u32>(texel - box.xy);
    let size = vec2<u32>(box.zw);
    if any(d >= size) {
        return Light();
    }
    let weight = weights[first_weights[slot] + d.y * size.x + d.x];
    return Light(weight * colors[slot], weight * parts[slot]);
}

// What the points in some slots add to a texel.
fn light_of_points(first: u32, end: u32, texel: vec2<i32>) -> Light {
    var sum = Light();
    for (var slot = first; slot < end; slot++) {
        sum = added(sum, light_of(slot, texel));
    }
    return sum;
}

// What the points of a bin, which are held from a slot on, add to a texel.
fn light_of_bin(bin: vec2<u32>, points: u32, held: u32, texel: vec2<i32>) -> Light {
    if points <= BIN_ROWS {
        // It takes longer to search the rows.
        return light_of_points(held, held + points, texel);
    }
    let i = index_of_bin(params.layer, bin);
    // Points are near enough in these columns and rows: those within the texels from which a sprite that reaches as
    // far as any of the bin covers this texel.
    let origin = origin_of_bin(bin);
    let last = bin_size() - 1;
    let start = max(2 * (texel - bins[i].greatest) - origin, vec2(0));
    let stop = min(2 * (texel - bins[i].least) + 1 - origin, last);
    var sum = Light();
    if any(start > stop) {
        return sum;
    }
    let before = (1u << u32(start.x)) - 1u;
    let columns = ~before & (~0u >> u32(last.x - stop.x));
    for (var y = start.y; y <= stop.y; y++) {
        let row = bins[i].rows[y];
        let first = held + bins[i].before[y] + countOneBits(row & before);
        sum = added(sum, light_of_points(first, first + countOneBits(row & columns), texel));
    }
    return sum;
}

// Adds what the points that are held, of these of the listed bins, add to a texel.
fn with_held(so_far: Light, first: u32, end: u32, texel: vec2<i32>) -> Light {
    var sum = so_far;
    var held = 0u;
    for (var j = first; j < end; j++) {
        sum = added(sum, light_of_bin(listed[j].xy, listed[j].z, held, texel));
        held += listed[j].z;
    }
    return sum;
}

@compute @workgroup_size(16, 16)
fn gather(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let window = window_of(vec2<i32>(GROUP * group.xy + vec2(0u, params.top)));
    let texel = window.tile + vec2<i32>(local.xy);
    let is_inside = all(vec2<u32>(texel) < params.half);
    let at = u32(texel.y) * params.half.x + u32(texel.x);
    var sum = Light();
    if is_inside && params.first_row > 0 {
        sum = Light(light[at], coverage[at]);
    }
    for (var k = 0u; k < window.count; k += CAPACITY) {
        let count = list_bins(window, k, thread);
        var first = 0u;
        var held = 0u;
        for (var j = 0u; j <= count; j++) {
            if j == count || held + listed[j].z > CAPACITY {
                workgroupBarrier();
                sum = with_held(sum, first, j, texel);
                workgroupBarrier();
                first = j;
                held = 0u;
            }
            if j < count {
                hold(listed[j].xy, held, thread);
                held += listed[j].z;
            }
        }
    }
    if is_inside {
        light[at] = sum.color;
        coverage[at] = sum.coverage;
    }
}
