// The contribution of a sprite to one pixel of a target.

struct Added {
    @location(0) color: vec4<f32>,
    @location(1) coverage: f32,
}

@group(0) @binding(6) var<storage, read> weights: array<f32>;

@fragment
fn weigh(corner: Corner) -> Added {
    let at = vec2<i32>(corner.position.xy) - corner.sprite.xy;
    let weight = weights[u32(corner.sprite.w + at.y * corner.sprite.z + at.x)];
    return Added(weight * corner.color, weight * corner.coverage);
}
