// The points that may be drawn: the picture's pixels, and their mirror images beyond its border.

// The contribution of one point to a target: its first column and row, relative to the texel that contains it, its
// size, and the index of its first weight. There are four for each radius step: for even and odd columns of even
// rows, then of odd rows.
struct Sprite {
    left: i32,
    top: i32,
    across: u32,
    down: u32,
    first: u32,
}

// The points of one layer among 32 columns and 8 rows. Bins begin at multiples of these numbers, so that neither
// the largest sprite nor the band decides in which order sprites are added.
struct Bin {
    // The first and the last texel that any of its sprites covers, relative to the texel that contains its point.
    least: vec2<i32>,
    greatest: vec2<i32>,
    // A bit for every column of each row, set if the point is drawn.
    rows: array<u32, 8>,
    // Number of points before each row, and in all.
    before: array<u32, 8>,
    count: u32,
}

const BIN_COLUMNS: u32 = 32u;
const BIN_ROWS: u32 = 8u;

@group(0) @binding(3) var<storage, read> boundaries: array<f32>;
@group(0) @binding(4) var<storage, read> sprites: array<Sprite>;

fn bin_size() -> vec2<i32> {
    return vec2(i32(BIN_COLUMNS), i32(BIN_ROWS));
}

// The index of a bin in a layer, by its column and row among all bins.
fn index_of_bin(layer: u32, bin: vec2<u32>) -> u32 {
    return (layer * params.bins.y + bin.y) * params.bins.x + bin.x;
}

// The position of the first point of a bin.
fn origin_of_bin(bin: vec2<u32>) -> vec2<i32> {
    return (params.first_bin + vec2<i32>(bin)) * bin_size();
}

fn pixel_at(place: vec2<i32>) -> u32 {
    return index_in(params.size, place.x, place.y);
}

// The radius step of a disparity. It is looked up and not computed: the next step would be another sprite, so
// rounding must not decide.
fn step_of(d: f32) -> u32 {
    var low = 0u;
    var high = params.boundaries;
    while low < high {
        let middle = (low + high) / 2u;
        if d < boundaries[middle] {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return params.first_step + low;
}

fn sprite_of(pixel: u32, place: vec2<i32>) -> Sprite {
    let odd = vec2<u32>(place & vec2(1));
    return sprites[4u * step_of(disparity[pixel]) + 2u * odd.y + odd.x];
}
