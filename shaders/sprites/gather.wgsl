// The light of one layer: every texel of the target adds up the sprites that cover it.
//
// A workgroup owns a tile of texels, and goes through the bins of points around it, row by row. Of a bin that reaches
// the tile it holds the points in shared memory, where each texel reads those that are near enough. A sum is made for
// each bin and added to those before: a sum of few numbers loses less precision than one of thousands, and has the
// same bits wherever passes are cut.

// A point, as it is drawn.
struct Point {
    // Colour times the part that is drawn.
    color: vec4<f32>,
    // The first texel of its sprite, and the sprite's size.
    corner: vec2<i32>,
    extent: vec2<u32>,
    // The part that is drawn, and the index of the sprite's first weight.
    coverage: f32,
    first: u32,
}

struct Light {
    color: vec4<f32>,
    coverage: f32,
}

// Side of a tile.
const GROUP: u32 = 16u;

@group(0) @binding(5) var<storage, read> bins: array<Bin>;
@group(0) @binding(6) var<storage, read> weights: array<f32>;
@group(0) @binding(7) var<storage, read_write> light: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> coverage: array<f32>;

var<workgroup> points: array<Point, 256>;

fn point_at(place: vec2<i32>) -> Point {
    let pixel = pixel_at(place);
    let sprite = sprite_of(pixel, place);
    let part = drawn(coc_of(pixel));
    return Point(
        part * color_at(params.size, pixel),
        (place >> vec2(1u)) + vec2(sprite.left, sprite.top),
        vec2(sprite.across, sprite.down),
        part,
        sprite.first,
    );
}

// What a point adds to a texel.
fn light_of(point: u32, texel: vec2<i32>) -> Light {
    // Left of the sprite or above it, these are large numbers.
    let d = vec2<u32>(texel - points[point].corner);
    let extent = points[point].extent;
    if any(d >= extent) {
        return Light();
    }
    let weight = weights[points[point].first + d.y * extent.x + d.x];
    return Light(weight * points[point].color, weight * points[point].coverage);
}

// What the points of a bin add to a texel.
fn light_of_bin(i: u32, origin: vec2<i32>, texel: vec2<i32>) -> Light {
    // A point is in the texel from which the sprite's own is as far as the sprite reaches, or nearer.
    let last = bin_size() - 1;
    let start = max(2 * (texel - bins[i].greatest) - origin, vec2(0));
    let stop = min(2 * (texel - bins[i].least) + 1 - origin, last);
    var sum = Light();
    if any(start > stop) {
        return sum;
    }
    let columns = (~0u << u32(start.x)) & (~0u >> u32(last.x - stop.x));
    for (var y = start.y; y <= stop.y; y++) {
        var row = bins[i].rows[y] & columns;
        while row != 0u {
            let own = light_of(u32(y) * BIN_COLUMNS + firstTrailingBit(row), texel);
            sum = Light(sum.color + own.color, sum.coverage + own.coverage);
            row &= row - 1u;
        }
    }
    return sum;
}

// Whether a sprite of a bin may cover a texel of a tile.
fn reaches(i: u32, origin: vec2<i32>, tile: vec2<i32>) -> bool {
    let last = origin + bin_size() - 1;
    return all((origin >> vec2(1u)) + bins[i].least < tile + i32(GROUP))
        && all((last >> vec2(1u)) + bins[i].greatest >= tile);
}

@compute @workgroup_size(16, 16)
fn gather(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let tile = vec2<i32>(GROUP * group.xy + vec2(0u, params.top));
    let texel = tile + vec2<i32>(local.xy);
    let is_inside = all(vec2<u32>(texel) < params.half);
    let at = u32(texel.y) * params.half.x + u32(texel.x);
    var sum = Light();
    if is_inside && params.first_row > 0 {
        sum = Light(light[at], coverage[at]);
    }
    // The bins that the largest sprite could reach the tile from.
    let shift = vec2(firstTrailingBit(BIN_COLUMNS), firstTrailingBit(BIN_ROWS));
    let first = ((2 * tile - params.reach) >> shift) - params.first_bin;
    let end = ((2 * (tile + i32(GROUP)) + params.reach) >> shift) + 1 - params.first_bin;
    let own = vec2(thread % BIN_COLUMNS, thread / BIN_COLUMNS);
    let end_row = min(min(first.y + params.end_row, end.y), i32(params.bins.y));
    for (var y = first.y + params.first_row; y < end_row; y++) {
        for (var x = first.x; x < min(end.x, i32(params.bins.x)); x++) {
            let bin = vec2(u32(x), u32(y));
            let i = index_of_bin(params.layer, bin);
            let origin = origin_of_bin(bin);
            if !reaches(i, origin, tile) {
                continue;
            }
            // The points of the bin before have been read.
            workgroupBarrier();
            if (bins[i].rows[own.y] >> own.x & 1u) == 1u {
                points[thread] = point_at(origin + vec2<i32>(own));
            }
            workgroupBarrier();
            let added = light_of_bin(i, origin, texel);
            sum = Light(sum.color + added.color, sum.coverage + added.coverage);
        }
    }
    if is_inside {
        light[at] = sum.color;
        coverage[at] = sum.coverage;
    }
}
