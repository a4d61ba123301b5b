// The targets without blending, for devices that cannot blend floats: every pixel searches for the points that reach
// it.

@group(0) @binding(5) var<storage, read> weights: array<f32>;
@group(0) @binding(6) var<storage, read_write> light: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> coverage: array<f32>;

// The weight of a point in a pixel of a target.
fn weight_of(place: vec2<i32>, pixel: u32, at: vec2<i32>) -> f32 {
    let sprite = sprite_of(step_of(disparity[pixel]), place);
    let d = at - corner_of(sprite, place);
    if any(d < vec2(0)) || any(d >= vec2<i32>(vec2(sprite.across, sprite.down))) {
        return 0.0;
    }
    return weights[sprite.first + u32(d.y) * sprite.across + u32(d.x)];
}

@compute @workgroup_size(16, 16)
fn gather(@builtin(global_invocation_id) id: vec3<u32>) {
    let texel = vec2(id.x, params.top + id.y);
    if any(texel >= params.half) {
        return;
    }
    let at = vec2<i32>(texel);
    let i = texel.y * params.pitch + texel.x;
    var sum = vec4<f32>();
    var covered = 0.0;
    if params.first_row > -params.reach {
        sum = light[i];
        covered = coverage[i];
    }
    for (var dy = params.first_row; dy < params.end_row; dy++) {
        for (var dx = -params.reach; dx <= params.reach + 1; dx++) {
            let place = 2 * at + vec2(dx, dy);
            let pixel = pixel_at(place);
            let coc = coc_of(pixel);
            if drawn(coc) > 0.0 && (coc < 0.0) == (params.layer == IN_FRONT) {
                let weight = weight_of(place, pixel, at) * drawn(coc);
                sum += weight * color_at(params.size, pixel);
                covered += weight;
            }
        }
    }
    light[i] = sum;
    coverage[i] = covered;
}
