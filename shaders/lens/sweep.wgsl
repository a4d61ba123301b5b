// For every view, the nearest cell that each pixel's ray meets: cpu/lens/sweep.rs.
//
// A view's way through the depths is the same for all pixels: stretches of codes, each at one offset. A workgroup sweeps
// half a tile. It first picks those stretches in which there is any cell near it, then every thread follows them for
// four pixels, with their sums in registers.

struct Params {
    size: vec2<u32>,
    // Pixels of margin of the blocks, and their number to a row.
    pad: u32,
    blocks_across: u32,
    block: u32,
    sheets: u32,
    // Whether rays that meet nothing are transparent, rather than unknown.
    missed: u32,
}

// A tile, its views, and the depths that occur within reach: a bit for each high byte of a code.
struct Tile {
    origin: vec2<u32>,
    first_view: u32,
    views: u32,
    occupied: array<u32, 8>,
}

// At code u the ray passes the cell at `slope u + base - cell` from its centre. Its stretches, near to far.
struct View {
    slope: vec2<f32>,
    first: u32,
    end: u32,
}

// Codes `from .. to`, in the low and the high half, are met at this offset: x in the low half, y in the high one.
struct Stretch {
    cell: u32,
    codes: u32,
    base: vec2<f32>,
}

const MISSED_NOTHING: u32 = 1u;
const BATCH: u32 = 64u;
const CAPACITY: u32 = 16u;
const ROWS: u32 = 4u;

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> codes: array<u32>;
@group(0) @binding(2) var<storage, read> drawn: array<vec4<f32>>;
// For each cell 0, or one more than the number of its half-plane; these follow.
@group(0) @binding(3) var<storage, read> half_planes: array<u32>;
@group(0) @binding(4) var<storage, read> views: array<View>;
@group(0) @binding(5) var<storage, read> stretches: array<Stretch>;
@group(0) @binding(6) var<storage, read> tiles: array<Tile>;
// For each block of the padded frame and each sheet, the depths in a tile that begins there; as in `Tile`.
@group(0) @binding(7) var<storage, read> windows: array<u32>;
@group(0) @binding(8) var<storage, read_write> picture: array<f32>;

// Stretches and sheets that each view of a batch may meet cells in, and from which stretch on it has not been looked.
var<workgroup> met: array<vec2<u32>, 1024>;
var<workgroup> met_count: array<u32, BATCH>;
var<workgroup> not_looked: array<u32, BATCH>;

var<private> place: vec2<i32>;
var<private> sums: array<vec4<f32>, ROWS>;
var<private> waiting: array<bool, ROWS>;

fn offset_of(stretch: Stretch) -> vec2<i32> {
    let cell = bitcast<i32>(stretch.cell);
    return vec2((cell << 16u) >> 16u, cell >> 16u);
}

// Those bits of a word of depths that the codes of a stretch fall to.
fn bins_of(stretch: Stretch, word: u32) -> u32 {
    let first = (stretch.codes & 0xffffu) >> 8u;
    let last = ((stretch.codes >> 16u) - 1u) >> 8u;
    if first > 32u * word + 31u || last < 32u * word {
        return 0u;
    }
    let low = max(first, 32u * word) - 32u * word;
    let high = min(last, 32u * word + 31u) - 32u * word;
    return (0xffffffffu << low) & (0xffffffffu >> (31u - high));
}

fn is_occupied(tile: u32, stretch: Stretch) -> bool {
    for (var word = 0u; word < 8u; word++) {
        if (tiles[tile].occupied[word] & bins_of(stretch, word)) != 0u {
            return true;
        }
    }
    return false;
}

fn is_in_window(origin: vec2<u32>, stretch: Stretch, sheet: u32) -> bool {
    let at = vec2<u32>(vec2<i32>(origin + params.pad) + offset_of(stretch)) / params.block;
    let window = 8u * ((at.y * params.blocks_across + at.x) * params.sheets + sheet);
    for (var word = 0u; word < 8u; word++) {
        if (windows[window + word] & bins_of(stretch, word)) != 0u {
            return true;
        }
    }
    return false;
}

// Picks the stretches of a view, as many as there is room for.
fn look(tile: u32, view: u32, slot: u32) {
    var count = 0u;
    var i = views[view].first;
    while i < views[view].end && count + params.sheets <= CAPACITY {
        let stretch = stretches[i];
        if is_occupied(tile, stretch) {
            for (var sheet = 0u; sheet < params.sheets; sheet++) {
                if is_in_window(tiles[tile].origin, stretch, sheet) {
                    met[slot * CAPACITY + count] = vec2(i, sheet);
                    count++;
                }
            }
        }
        i++;
    }
    met_count[slot] = count;
    not_looked[slot] = i;
}

// Whether a ray passes through the part of its pixel that a cell covers.
fn is_covered(cell: u32, at: vec2<i32>, view: View, stretch: Stretch) -> bool {
    let number = half_planes[cell];
    if number == 0u {
        return true;
    }
    let words = params.sheets * params.size.x * params.size.y + 3u * (number - 1u);
    let normal = vec2(bitcast<f32>(half_planes[words]), bitcast<f32>(half_planes[words + 1u]))
        * mirroring(params.size, at.x, at.y);
    let ray = view.slope * f32(farthest(codes[cell])) + stretch.base;
    return normal.x * ray.x + normal.y * ray.y <= bitcast<f32>(half_planes[words + 2u]);
}

// Gives the waiting pixels the cells that they meet in one stretch of one sheet.
fn meet(view: View, i: u32, sheet: u32) {
    let stretch = stretches[i];
    let from_code = stretch.codes & 0xffffu;
    let to_code = stretch.codes >> 16u;
    let first = place + offset_of(stretch);
    let column = u32(mirrored(first.x, i32(params.size.x)));
    for (var row = 0u; row < ROWS; row++) {
        if !waiting[row] {
            continue;
        }
        let at = vec2(first.x, first.y + 4 * i32(row));
        let line = sheet * params.size.y + u32(mirrored(at.y, i32(params.size.y)));
        let cell = line * params.size.x + column;
        let hit = nearest(codes[cell]) >= from_code && farthest(codes[cell]) < to_code;
        if hit && is_covered(cell, at, view, stretch) {
            sums[row] += drawn[cell];
            waiting[row] = false;
        }
    }
}

fn is_any_waiting() -> bool {
    return waiting[0] || waiting[1] || waiting[2] || waiting[3];
}

// Follows one view, whose stretches have been picked.
fn follow(tile: u32, view: View, slot: u32) {
    for (var i = 0u; i < met_count[slot] && is_any_waiting(); i++) {
        let found = met[slot * CAPACITY + i];
        meet(view, found.x, found.y);
    }
    for (var i = not_looked[slot]; i < view.end && is_any_waiting(); i++) {
        if is_occupied(tile, stretches[i]) {
            for (var sheet = 0u; sheet < params.sheets; sheet++) {
                meet(view, i, sheet);
            }
        }
    }
}

@compute @workgroup_size(64, 4)
fn sweep(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) thread: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let tile = group.x;
    let own = tiles[tile].origin + vec2(thread.x, ROWS * 4u * group.y + thread.y);
    place = vec2<i32>(own);
    var missed = array<f32, ROWS>();
    let count = tiles[tile].views;
    for (var batch = 0u; batch < count; batch += BATCH) {
        workgroupBarrier();
        let first = tiles[tile].first_view + batch;
        let here = min(BATCH, count - batch);
        if index < here {
            look(tile, first + index, index);
        }
        workgroupBarrier();
        for (var slot = 0u; slot < here; slot++) {
            for (var row = 0u; row < ROWS; row++) {
                waiting[row] = own.x < params.size.x && own.y + 4u * row < params.size.y;
            }
            follow(tile, views[first + slot], slot);
            for (var row = 0u; row < ROWS; row++) {
                missed[row] += select(0.0, 1.0, waiting[row]);
            }
        }
    }
    for (var row = 0u; row < ROWS; row++) {
        let at = vec2(own.x, own.y + 4u * row);
        if any(at >= params.size) {
            continue;
        }
        let pixel = at.y * params.size.x + at.x;
        let met_views = f32(count) - select(missed[row], 0.0, params.missed == MISSED_NOTHING);
        // Where nothing at all was met, the pixel keeps what it saw itself.
        var value = drawn[pixel];
        if met_views > 0.0 {
            value = sums[row] / met_views;
        }
        for (var c = 0u; c < CHANNELS; c++) {
            picture[pixel * CHANNELS + c] = value[c];
        }
    }
}
