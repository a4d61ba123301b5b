// For each workgroup, the number of its points that are drawn into each layer.

@group(0) @binding(5) var<storage, read_write> counts: array<vec2<u32>>;

var<workgroup> in_front: atomic<u32>;
var<workgroup> behind: atomic<u32>;

@compute @workgroup_size(256)
fn count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let chunk = group.y * params.groups_across + group.x;
    let layers = layers_of(256u * chunk + thread);
    if layers.x {
        atomicAdd(&in_front, 1u);
    }
    if layers.y {
        atomicAdd(&behind, 1u);
    }
    workgroupBarrier();
    if thread == 0u {
        counts[chunk] = vec2(atomicLoad(&in_front), atomicLoad(&behind));
    }
}
