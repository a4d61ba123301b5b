// For every sample, the nearest cell that each pixel's ray meets: cpu/lens/sweep.rs.
//
// A sample's trace through the depths is the same for all pixels: segments of codes, each at one offset. A workgroup
// sweeps half a tile. It first picks the segments that contain any cell near it. Then every thread follows these
// segments for four pixels, with their sums in registers.

struct Params {
    size: vec2<u32>,
    // Margin of the blocks in pixels, and number of blocks in a row.
    pad: u32,
    blocks_across: u32,
    block: u32,
    layers: u32,
    // Whether rays that meet no cell are transparent, rather than unknown.
    missed: u32,
    // The samples of each tile that this pass adds.
    first_sample: u32,
    end_sample: u32,
}

// A tile, its samples, and the depths that occur within reach, one bit for each value of a code's high byte.
struct Tile {
    origin: vec2<u32>,
    first_sample: u32,
    samples: u32,
    occupied: array<u32, 8>,
}

// At code u the ray is at `slope u + base - cell` from the centre of the cell; the slope differs in front of the
// focus and behind it. Then the sample's segments, near to far, the first one behind the focus, and the columns of
// each row that see the sample; 0 if all do.
struct LensSample {
    in_front: vec2<f32>,
    behind: vec2<f32>,
    first: u32,
    focus: u32,
    end: u32,
    columns: u32,
}

// Over codes `from .. to` (low and high half), cells at this offset are met: x in the low half, y in the high half.
struct Segment {
    cell: u32,
    codes: u32,
    base: vec2<f32>,
}

const MISSED_NOTHING: u32 = 1u;
const BATCH: u32 = 64u;
const CAPACITY: u32 = 16u;
// Number of pixels of a thread, four rows apart. Each has a named sum of its own, so that all stay in registers.
const ROWS: u32 = 4u;
const NO_CELL: u32 = 0xffffffffu;

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> codes: array<u32>;
@group(0) @binding(2) var<storage, read> drawn: array<vec4<f32>>;
// For each cell 0, or one more than the index of its half-plane; then the half-planes.
@group(0) @binding(3) var<storage, read> half_planes: array<u32>;
// Lens samples, then segments, then the columns of each sample.
@group(0) @binding(4) var<storage, read> traces: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> tiles: array<Tile>;
// For each block of the padded frame and each layer: the depths in a tile that begins there, in the form of `Tile`.
@group(0) @binding(6) var<storage, read> windows: array<u32>;
// For each pixel, the number of samples that do not count; between passes the picture holds sums.
@group(0) @binding(7) var<storage, read_write> left_out_before: array<f32>;
@group(0) @binding(8) var<storage, read_write> picture: array<f32>;

// The segments and layers in which each sample of a batch may meet cells, and the first segment not yet tested.
var<workgroup> met: array<vec2<u32>, 1024>;
var<workgroup> met_count: array<u32, BATCH>;
var<workgroup> first_untested: array<u32, BATCH>;

var<private> place: vec2<i32>;
var<private> sum_0: vec4<f32>;
var<private> sum_1: vec4<f32>;
var<private> sum_2: vec4<f32>;
var<private> sum_3: vec4<f32>;
// One bit per row: whether its pixel has not met a cell yet.
var<private> waiting: u32;

fn lens_sample_at(i: u32) -> LensSample {
    let slopes = bitcast<vec4<f32>>(traces[2u * i]);
    let words = traces[2u * i + 1u];
    return LensSample(slopes.xy, slopes.zw, words.x, words.y, words.z, words.w);
}

fn segment_at(i: u32) -> Segment {
    let words = traces[i];
    return Segment(words.x, words.y, bitcast<vec2<f32>>(words.zw));
}

fn offset_of(segment: Segment) -> vec2<i32> {
    let cell = bitcast<i32>(segment.cell);
    return vec2((cell << 16u) >> 16u, cell >> 16u);
}

// The bins of the first and the last depth of a segment's codes.
fn bins_of(segment: Segment) -> vec2<u32> {
    return vec2(segment.codes & 0xffffu, (segment.codes >> 16u) - 1u) >> vec2(8u);
}

// The bits of these bins in a word of a set of depths.
fn bits_of(bins: vec2<u32>, word: u32) -> u32 {
    let low = max(bins.x, 32u * word) - 32u * word;
    let high = min(bins.y, 32u * word + 31u) - 32u * word;
    return (0xffffffffu << low) & (0xffffffffu >> (31u - high));
}

fn is_occupied(tile: u32, segment: Segment) -> bool {
    let bins = bins_of(segment);
    for (var word = bins.x / 32u; word <= bins.y / 32u; word++) {
        if (tiles[tile].occupied[word] & bits_of(bins, word)) != 0u {
            return true;
        }
    }
    return false;
}

fn is_in_window(origin: vec2<u32>, segment: Segment, layer: u32) -> bool {
    let at = vec2<u32>(vec2<i32>(origin + params.pad) + offset_of(segment)) / params.block;
    let window = 8u * ((at.y * params.blocks_across + at.x) * params.layers + layer);
    let bins = bins_of(segment);
    for (var word = bins.x / 32u; word <= bins.y / 32u; word++) {
        if (windows[window + word] & bits_of(bins, word)) != 0u {
            return true;
        }
    }
    return false;
}

// Picks segments of a sample, as many as there is room for.
fn pick_segments(tile: u32, sample: u32, slot: u32) {
    var count = 0u;
    let path = lens_sample_at(sample);
    var i = path.first;
    while i < path.end && count + params.layers <= CAPACITY {
        let segment = segment_at(i);
        if is_occupied(tile, segment) {
            for (var layer = 0u; layer < params.layers; layer++) {
                if is_in_window(tiles[tile].origin, segment, layer) {
                    met[slot * CAPACITY + count] = vec2(i, layer);
                    count++;
                }
            }
        }
        i++;
    }
    met_count[slot] = count;
    first_untested[slot] = i;
}

// The rows that see a sample, one bit per row.
fn rows_that_see(sample: LensSample, rows: u32) -> u32 {
    if sample.columns == 0u {
        return rows;
    }
    var seen = 0u;
    for (var row = 0u; row < ROWS; row++) {
        if (rows & (1u << row)) != 0u {
            let y = u32(place.y) + 4u * row;
            let columns = traces[sample.columns + y / 4u][y % 4u];
            let x = u32(place.x);
            seen |= select(0u, 1u << row, x >= (columns & 0xffffu) && x < (columns >> 16u));
        }
    }
    return seen;
}

// Whether a ray passes through the part of its pixel that a cell covers.
fn is_covered(cell: u32, at: vec2<i32>, slope: vec2<f32>, segment: Segment) -> bool {
    let number = half_planes[cell];
    if number == 0u {
        return true;
    }
    let words = params.layers * params.size.x * params.size.y + 3u * (number - 1u);
    let normal = vec2(bitcast<f32>(half_planes[words]), bitcast<f32>(half_planes[words + 1u]))
        * mirroring(params.size, at.x, at.y);
    let ray = slope * f32(farthest(codes[cell])) + segment.base;
    return normal.x * ray.x + normal.y * ray.y <= bitcast<f32>(half_planes[words + 2u]);
}

// The cell that a pixel meets in one segment of one layer, if the pixel has not met one yet.
fn cell_met(row: u32, slope: vec2<f32>, segment: Segment, first: vec2<i32>, column: u32, layer: u32) -> u32 {
    if (waiting & (1u << row)) == 0u {
        return NO_CELL;
    }
    let at = vec2(first.x, first.y + 4 * i32(row));
    let line = layer * params.size.y + u32(mirrored(at.y, i32(params.size.y)));
    let cell = line * params.size.x + column;
    let depths = codes[cell];
    let hit = nearest(depths) >= (segment.codes & 0xffffu) && farthest(depths) < (segment.codes >> 16u);
    if !hit || !is_covered(cell, at, slope, segment) {
        return NO_CELL;
    }
    waiting &= ~(1u << row);
    return cell;
}

// The colour of a cell, or 0 if there is no cell.
fn color_of(cell: u32) -> vec4<f32> {
    if cell == NO_CELL {
        return vec4<f32>();
    }
    return drawn[cell];
}

// Looks up the cells that the waiting pixels meet in one segment of one layer, and adds their colours.
fn meet(sample: LensSample, i: u32, layer: u32) {
    let segment = segment_at(i);
    let slope = select(sample.behind, sample.in_front, i < sample.focus);
    let first = place + offset_of(segment);
    let column = u32(mirrored(first.x, i32(params.size.x)));
    sum_0 += color_of(cell_met(0u, slope, segment, first, column, layer));
    sum_1 += color_of(cell_met(1u, slope, segment, first, column, layer));
    sum_2 += color_of(cell_met(2u, slope, segment, first, column, layer));
    sum_3 += color_of(cell_met(3u, slope, segment, first, column, layer));
}

// Follows one sample, whose segments have been picked.
fn follow(tile: u32, sample: LensSample, slot: u32) {
    for (var i = 0u; i < met_count[slot] && waiting != 0u; i++) {
        let found = met[slot * CAPACITY + i];
        meet(sample, found.x, found.y);
    }
    for (var i = first_untested[slot]; i < sample.end && waiting != 0u; i++) {
        if is_occupied(tile, segment_at(i)) {
            for (var layer = 0u; layer < params.layers; layer++) {
                meet(sample, i, layer);
            }
        }
    }
}

// The mean over all samples that count.
fn mean(sum: vec4<f32>, count: f32, pixel: u32) -> vec4<f32> {
    if count > 0.0 {
        return sum / count;
    }
    // If no sample met a cell, the pixel keeps the colour of its own cell.
    return drawn[pixel];
}

fn pixel_of(own: vec2<u32>, row: u32) -> u32 {
    return (own.y + 4u * row) * params.size.x + own.x;
}

// The number of samples that earlier passes left out for a pixel.
fn left_out_at(rows: u32, own: vec2<u32>, row: u32) -> f32 {
    if (rows & (1u << row)) == 0u {
        return 0.0;
    }
    return left_out_before[pixel_of(own, row)];
}

// The sum of earlier passes for a pixel.
fn sum_at(rows: u32, own: vec2<u32>, row: u32) -> vec4<f32> {
    var sum = vec4<f32>();
    if (rows & (1u << row)) != 0u {
        for (var c = 0u; c < CHANNELS; c++) {
            sum[c] = picture[pixel_of(own, row) * CHANNELS + c];
        }
    }
    return sum;
}

// Writes a pixel: the mean after the last sample, and the sum so far before it.
fn write(rows: u32, own: vec2<u32>, row: u32, sum: vec4<f32>, left_out: f32, count: f32, is_last: bool) {
    if (rows & (1u << row)) == 0u {
        return;
    }
    let pixel = pixel_of(own, row);
    var value = sum;
    if is_last {
        value = mean(sum, count - left_out, pixel);
    } else {
        left_out_before[pixel] = left_out;
    }
    for (var c = 0u; c < CHANNELS; c++) {
        picture[pixel * CHANNELS + c] = value[c];
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
    if params.first_sample >= tiles[tile].samples {
        // An earlier pass was the last one of this tile.
        return;
    }
    // The rows that are inside the frame.
    var rows = 0u;
    for (var row = 0u; row < ROWS; row++) {
        rows |= select(0u, 1u << row, all(vec2(own.x, own.y + 4u * row) < params.size));
    }
    var left_out = vec4<f32>();
    if params.first_sample > 0u {
        left_out = vec4(
            left_out_at(rows, own, 0u),
            left_out_at(rows, own, 1u),
            left_out_at(rows, own, 2u),
            left_out_at(rows, own, 3u),
        );
        sum_0 = sum_at(rows, own, 0u);
        sum_1 = sum_at(rows, own, 1u);
        sum_2 = sum_at(rows, own, 2u);
        sum_3 = sum_at(rows, own, 3u);
    }
    let count = min(tiles[tile].samples, params.end_sample);
    for (var batch = params.first_sample; batch < count; batch += BATCH) {
        workgroupBarrier();
        let first = tiles[tile].first_sample + batch;
        let here = min(BATCH, count - batch);
        if index < here {
            pick_segments(tile, first + index, index);
        }
        workgroupBarrier();
        for (var slot = 0u; slot < here; slot++) {
            let sample = lens_sample_at(first + slot);
            let seeing = rows_that_see(sample, rows);
            waiting = seeing;
            follow(tile, sample, slot);
            let missed = select(waiting, 0u, params.missed == MISSED_NOTHING);
            let out = (rows & ~seeing) | missed;
            left_out += vec4<f32>((vec4(out) >> vec4(0u, 1u, 2u, 3u)) & vec4(1u));
        }
    }
    let is_last = count == tiles[tile].samples;
    write(rows, own, 0u, sum_0, left_out.x, f32(count), is_last);
    write(rows, own, 1u, sum_1, left_out.y, f32(count), is_last);
    write(rows, own, 2u, sum_2, left_out.z, f32(count), is_last);
    write(rows, own, 3u, sum_3, left_out.w, f32(count), is_last);
}
