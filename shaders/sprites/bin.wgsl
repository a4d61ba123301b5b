// Which points of every bin are drawn into each layer, and how far their sprites reach.

@group(0) @binding(5) var<storage, read_write> bins: array<Bin>;

// Farther than any sprite reaches: a bin without points reaches nothing.
const BEYOND: i32 = 65536i;

var<workgroup> rows: array<atomic<u32>, 8>;
// Along x and along y.
var<workgroup> least: array<atomic<i32>, 2>;
var<workgroup> greatest: array<atomic<i32>, 2>;

fn put(row: u32, column: u32, sprite: Sprite) {
    atomicOr(&rows[row], 1u << column);
    atomicMin(&least[0], sprite.left);
    atomicMin(&least[1], sprite.top);
    atomicMax(&greatest[0], sprite.left + i32(sprite.across) - 1);
    atomicMax(&greatest[1], sprite.top + i32(sprite.down) - 1);
}

@compute @workgroup_size(32, 8)
fn bin(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    if thread < 2u {
        atomicStore(&least[thread], BEYOND);
        atomicStore(&greatest[thread], -BEYOND);
    }
    workgroupBarrier();
    let place = origin_of_bin(group.xy) + vec2<i32>(local.xy);
    let pixel = pixel_at(place);
    let coc = coc_of(pixel);
    if drawn(coc) > 0.0 && (coc < 0.0) == (group.z == IN_FRONT) {
        put(local.y, local.x, sprite_of(pixel, place));
    }
    workgroupBarrier();
    let i = index_of_bin(group.z, group.xy);
    if thread < BIN_ROWS {
        bins[i].rows[thread] = atomicLoad(&rows[thread]);
    }
    if thread > 0u {
        return;
    }
    bins[i].least = vec2(atomicLoad(&least[0]), atomicLoad(&least[1]));
    bins[i].greatest = vec2(atomicLoad(&greatest[0]), atomicLoad(&greatest[1]));
    var count = 0u;
    for (var y = 0u; y < BIN_ROWS; y++) {
        bins[i].before[y] = count;
        count += countOneBits(atomicLoad(&rows[y]));
    }
    bins[i].count = count;
}
