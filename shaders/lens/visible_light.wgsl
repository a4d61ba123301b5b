// The light of highlights that the samples of a pixel meet, and the light that they would meet if nothing stood in
// between: cpu/lens/sweep.rs.

struct Params {
    size: vec2<u32>,
    // Margin of the blocks in pixels, and number of blocks in a row.
    pad: u32,
    blocks_across: u32,
    block: u32,
    layers: u32,
    // The samples of each tile that this pass adds.
    first_sample: u32,
    end_sample: u32,
    px_per_code: f32,
    // The gaps up to which depth spans are on one surface, and from which on they are on two.
    same_surface_px: f32,
    other_surface_px: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> codes: array<u32>;
@group(0) @binding(2) var<storage, read> light: array<vec4<f32>>;
// For each cell 0, or one more than the index of its half-plane; then the half-planes.
@group(0) @binding(3) var<storage, read> half_planes: array<u32>;
// Lens samples, then segments, then the columns of each sample.
@group(0) @binding(4) var<storage, read> traces: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> tiles: array<Tile>;
// For each block of the padded frame and each layer: the depths in a tile that begins there, in the form of `Tile`.
@group(0) @binding(6) var<storage, read> windows: array<u32>;
// For each block of the padded frame: whether there may be light in a tile that begins there.
@group(0) @binding(7) var<storage, read> lit: array<u32>;
// For each pixel: the light that is met, and the light that would be met.
@group(0) @binding(8) var<storage, read_write> lights: array<vec4<f32>>;

// A cell that a sample meets: its layer, its offset from the pixel, and its depth span.
struct Cell {
    layer: u32,
    offset: vec2<i32>,
    farthest: u32,
    nearest: u32,
}

var<private> met_light: vec4<f32>;
var<private> all_light: vec4<f32>;
// Whether the current sample has met a cell, and the first one that it has met.
var<private> is_blocked: bool;
var<private> blocker: Cell;

fn is_lit(tile: u32, segment: Segment) -> bool {
    let at = vec2<u32>(vec2<i32>(tiles[tile].origin + params.pad) + offset_of(segment)) / params.block;
    return lit[at.y * params.blocks_across + at.x] != 0u;
}

// The part of a cell's light that the first cell of a sample lets through.
fn visible_part_of(cell: Cell) -> f32 {
    if !is_blocked {
        return 1.0;
    }
    if blocker.layer != cell.layer {
        return 0.0;
    }
    let gap = max(i32(blocker.farthest) - i32(cell.nearest), 0);
    let apart = abs(blocker.offset - cell.offset);
    let distance = f32(max(apart.x, apart.y));
    let own_span = f32(cell.nearest - cell.farthest) * params.px_per_code;
    let beyond = f32(gap) * params.px_per_code - own_span * distance;
    return clamp((params.other_surface_px - beyond) / (params.other_surface_px - params.same_surface_px), 0.0, 1.0);
}

// Looks up the cell that the pixel meets in one segment of one layer.
fn meet(sample: LensSample, i: u32, layer: u32) {
    let segment = segment_at(i);
    let slope = select(sample.behind, sample.in_front, i < sample.focus);
    let offset = offset_of(segment);
    let at = place + offset;
    let index = layer * params.size.x * params.size.y + index_in(params.size, at.x, at.y);
    let span = codes[index];
    let cell = Cell(layer, offset, farthest(span), nearest(span));
    let from_code = segment.codes & 0xffffu;
    let to_code = segment.codes >> 16u;
    let hit = cell.nearest >= from_code && cell.farthest < to_code;
    if !hit || !is_covered(index, at, slope, segment) {
        return;
    }
    let middle = (cell.farthest + cell.nearest) / 2u;
    if all(at >= vec2(0)) && all(at < vec2<i32>(params.size)) && middle >= from_code && middle < to_code {
        all_light += light[index];
        met_light += visible_part_of(cell) * light[index];
    }
    if !is_blocked {
        is_blocked = true;
        blocker = cell;
    }
}

// Follows one sample, whose segments have been picked, to its end.
fn follow(tile: u32, sample: LensSample, slot: u32) {
    for (var i = 0u; i < met_count[slot]; i++) {
        let found = met[slot * CAPACITY + i];
        if !is_blocked || is_lit(tile, segment_at(found.x)) {
            meet(sample, found.x, found.y);
        }
    }
    for (var i = first_untested[slot]; i < sample.end; i++) {
        let segment = segment_at(i);
        if is_occupied(tile, segment) && (!is_blocked || is_lit(tile, segment)) {
            for (var layer = 0u; layer < params.layers; layer++) {
                meet(sample, i, layer);
            }
        }
    }
}

@compute @workgroup_size(64, 4)
fn visible_light(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) thread: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let tile = group.x;
    let own = tiles[tile].origin + vec2(thread.x, 4u * group.y + thread.y);
    place = vec2<i32>(own);
    if params.first_sample >= tiles[tile].samples {
        // An earlier pass was the last one of this tile.
        return;
    }
    let is_inside = all(own < params.size);
    let pixel = own.y * params.size.x + own.x;
    if is_inside && params.first_sample > 0u {
        met_light = lights[2u * pixel];
        all_light = lights[2u * pixel + 1u];
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
            if rows_that_see(sample, select(0u, 1u, is_inside)) != 0u {
                is_blocked = false;
                follow(tile, sample, slot);
            }
        }
    }
    if is_inside {
        lights[2u * pixel] = met_light;
        lights[2u * pixel + 1u] = all_light;
    }
}
