// The traces of lens samples through the depths, and the segments of them that contain any cell near a tile:
// gpu/lens/traces.rs.
//
// The trace of a sample is the same for all pixels: segments of codes, each at one offset. A workgroup first picks the
// segments that contain any cell near its half of a tile. Then every thread follows these for four pixels.

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

const BATCH: u32 = 64u;
const CAPACITY: u32 = 16u;
// Number of pixels of a thread, four rows apart. Each has a named sum of its own, so that all stay in registers.
const ROWS: u32 = 4u;

// The segments and layers in which each sample of a batch may meet cells, and the first segment not yet tested.
var<workgroup> met: array<vec2<u32>, 1024>;
var<workgroup> met_count: array<u32, BATCH>;
var<workgroup> first_untested: array<u32, BATCH>;

// The pixel of a thread's first row.
var<private> place: vec2<i32>;

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
