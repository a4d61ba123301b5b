// For every sample, the nearest cell that each pixel's ray meets: cpu/lens/sweep.rs.
//
// A sample's trace through the depths is the same for all pixels: segments of codes, each at one offset. A workgroup
// sweeps half a tile. It first picks the segments that contain any cell near it. Then every thread follows these
// segments for four pixels, with their sums in registers.

struct Params {
    size: vec2<u32>,
    // Margin of the blocks in pixels, the last place in them where a tile is inside, and number of blocks in a row.
    pad: vec2<u32>,
    last: vec2<u32>,
    blocks_across: u32,
    block: u32,
    layers: u32,
    // Whether rays that meet no cell are transparent, rather than unknown.
    missed: u32,
    // The samples of each tile that this pass adds.
    first_sample: u32,
    end_sample: u32,
    // The first cell of the picture's first layer.
    front: u32,
    // The first tile of this pass.
    first_tile: u32,
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

// The colour of a cell that a ray meets, and how much of its light arrives.
struct Met {
    color: vec4<f32>,
    weight: f32,
}

const MISSED_NOTHING: u32 = 1u;
const BATCH: u32 = 64u;
const CAPACITY: u32 = 16u;
// Number of pixels of a thread, four rows apart. Each has a named sum of its own, so that all stay in registers.
const ROWS: u32 = 4u;

override CHANNELS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> codes: array<u32>;
@group(0) @binding(2) var<storage, read> drawn: array<vec4<f32>>;
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
// What is left of each row's ray behind what it has met: all of it, or none if the pixel does not see the sample.
var<private> left_0: f32;
var<private> left_1: f32;
var<private> left_2: f32;
var<private> left_3: f32;

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

// The place inside the blocks where a tile shows the same as at a place: mirror images repeat after twice the frame.
fn inside(place: vec2<i32>) -> vec2<u32> {
    let period = 2 * vec2<i32>(params.size);
    let repeated = (place % period + period) % period;
    let is_inside = (place >= vec2(0)) & (place <= vec2<i32>(params.last));
    return vec2<u32>(select(repeated, place, is_inside));
}

fn is_in_window(origin: vec2<u32>, segment: Segment, layer: u32) -> bool {
    let at = inside(vec2<i32>(origin + params.pad) + offset_of(segment)) / params.block;
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

// The fraction of a ray's light that a cell stops: none where it passes beside what the cell covers.
fn opacity_of(cell: u32, at: vec2<i32>, slope: vec2<f32>, segment: Segment) -> f32 {
    let number = half_planes[cell];
    if number == 0u {
        return 1.0;
    }
    let plane = half_plane(number, at);
    let ray = slope * f32(farthest(codes[cell])) + segment.base;
    let is_beside = plane.normal.x * ray.x + plane.normal.y * ray.y > plane.cut;
    return select(plane.opacity, 0.0, is_beside);
}

// A segment of a sample, in one layer.
struct Step {
    segment: Segment,
    slope: vec2<f32>,
    // The cell that the first row's pixel would meet, and its column in the frame.
    first: vec2<i32>,
    column: u32,
    layer: u32,
}

fn step_at(sample: LensSample, i: u32, layer: u32) -> Step {
    let segment = segment_at(i);
    let slope = select(sample.behind, sample.in_front, i < sample.focus);
    let first = place + offset_of(segment);
    return Step(segment, slope, first, u32(mirrored(first.x, i32(params.size.x))), layer);
}

// The cell that a row's pixel would meet.
fn cell_of(step: Step, row: i32) -> u32 {
    let line = step.layer * params.size.y + u32(mirrored(step.first.y + 4 * row, i32(params.size.y)));
    return line * params.size.x + step.column;
}

// Whether a row's ray meets a cell in a step.
fn is_met(step: Step, cell: u32) -> bool {
    let depths = codes[cell];
    return nearest(depths) >= (step.segment.codes & 0xffffu) && farthest(depths) < (step.segment.codes >> 16u);
}

// Whether two cells are one surface, if they are beside each other. The cells of a slope span the depths up to half-way to
// their neighbours, where they touch.
fn touch(a: u32, b: u32) -> bool {
    let depths_a = codes[a];
    let depths_b = codes[b];
    return depths_b != 0u
        && farthest(depths_a) <= nearest(depths_b) + 1u && farthest(depths_b) <= nearest(depths_a) + 1u;
}

// Whether a ray that comes from the pixel of one of two cells to that of the other, where it begins with the code before
// `to`, is behind the surface there.
fn is_behind(a: u32, b: u32, to: u32) -> bool {
    return to <= max(farthest(codes[a]), farthest(codes[b]));
}

// Whether a row's ray crosses the surface of a cell in step `i`: it enters the pixel in front of the surface and leaves it
// behind. On a slope, a ray may meet several cells of a surface that it crosses once.
fn crosses(sample: LensSample, i: u32, step: Step, cell: u32, row: i32) -> bool {
    if i > sample.first {
        let cell_before = cell_of(step_at(sample, i - 1u, step.layer), row);
        if touch(cell, cell_before) && is_behind(cell, cell_before, step.segment.codes >> 16u) {
            return false;
        }
    }
    if i + 1u < sample.end {
        let after = step_at(sample, i + 1u, step.layer);
        let cell_after = cell_of(after, row);
        return !touch(cell, cell_after) || is_behind(cell, cell_after, after.segment.codes >> 16u);
    }
    return true;
}

// What a pixel meets in one step, of whose light the part `left` would arrive: its colour, and how much of that does
// arrive.
fn met_by(row: i32, left: f32, sample: LensSample, i: u32, step: Step) -> Met {
    if left <= 0.0 {
        return Met();
    }
    let cell = cell_of(step, row);
    if !is_met(step, cell) {
        return Met();
    }
    let opacity = opacity_of(cell, vec2(step.first.x, step.first.y + 4 * row), step.slope, step.segment);
    if opacity <= 0.0 || (opacity < 1.0 && !crosses(sample, i, step, cell, row)) {
        return Met();
    }
    return Met(drawn[cell], left * opacity);
}

// Looks up the cells that the pixels meet in one segment of one layer, and adds their light.
fn meet(sample: LensSample, i: u32, layer: u32) {
    let step = step_at(sample, i, layer);
    let met_0 = met_by(0, left_0, sample, i, step);
    let met_1 = met_by(1, left_1, sample, i, step);
    let met_2 = met_by(2, left_2, sample, i, step);
    let met_3 = met_by(3, left_3, sample, i, step);
    sum_0 += met_0.weight * met_0.color;
    sum_1 += met_1.weight * met_1.color;
    sum_2 += met_2.weight * met_2.color;
    sum_3 += met_3.weight * met_3.color;
    left_0 -= met_0.weight;
    left_1 -= met_1.weight;
    left_2 -= met_2.weight;
    left_3 -= met_3.weight;
}

// Whether nothing is left of any ray.
fn is_over() -> bool {
    return max(max(left_0, left_1), max(left_2, left_3)) <= 0.0;
}

// Follows one sample, whose segments have been picked.
fn follow(tile: u32, sample: LensSample, slot: u32) {
    for (var i = 0u; i < met_count[slot] && !is_over(); i++) {
        let found = met[slot * CAPACITY + i];
        meet(sample, found.x, found.y);
    }
    for (var i = first_untested[slot]; i < sample.end && !is_over(); i++) {
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
    return drawn[params.front + pixel];
}

// 1 for each row that has a bit.
fn ones_of(rows: u32) -> vec4<f32> {
    return vec4<f32>((vec4(rows) >> vec4(0u, 1u, 2u, 3u)) & vec4(1u));
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
    if (rows & (1u << row)) == 0u {
        return vec4<f32>();
    }
    return picture_at(pixel_of(own, row));
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
    let tile = params.first_tile + group.x;
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
            let seeing = ones_of(rows_that_see(sample, rows));
            left_0 = seeing.x;
            left_1 = seeing.y;
            left_2 = seeing.z;
            left_3 = seeing.w;
            follow(tile, sample, slot);
            let missed = select(vec4(left_0, left_1, left_2, left_3), vec4<f32>(), params.missed == MISSED_NOTHING);
            left_out += ones_of(rows) - seeing + missed;
        }
    }
    let is_last = count == tiles[tile].samples;
    write(rows, own, 0u, sum_0, left_out.x, f32(count), is_last);
    write(rows, own, 1u, sum_1, left_out.y, f32(count), is_last);
    write(rows, own, 2u, sum_2, left_out.z, f32(count), is_last);
    write(rows, own, 3u, sum_3, left_out.w, f32(count), is_last);
}
