// Replaces the colours of some cells.

struct Params {
    count: u32,
}

struct Replacement {
    color: vec4<f32>,
    index: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> replacements: array<Replacement>;
@group(0) @binding(2) var<storage, read_write> colors: array<vec4<f32>>;

@compute @workgroup_size(16, 16)
fn replace_colors(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * 16u * groups.x + id.x;
    if i < params.count {
        colors[replacements[i].index] = replacements[i].color;
    }
}
