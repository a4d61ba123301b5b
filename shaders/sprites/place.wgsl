// Places a quad for every point on the list.

struct Point {
    number: u32,
    step: u32,
}

@group(0) @binding(5) var<storage, read> list: array<Point>;

@vertex
fn place(@builtin(instance_index) instance: u32, @builtin(vertex_index) vertex: u32) -> Corner {
    let from_end = all_points() - 1u - instance;
    let point = list[select(instance, from_end, params.layer == BEHIND)];
    let at = place_of(point.number);
    let pixel = pixel_at(at);
    let sprite = sprite_of(point.step, at);
    let corner = corner_of(sprite, at);
    let extent = vec2(sprite.across, sprite.down) * vec2(vertex & 1u, vertex >> 1u);
    let place = vec2<f32>(corner + vec2<i32>(extent)) / vec2<f32>(params.half);
    let coverage = drawn(coc_of(pixel));
    return Corner(
        vec4(2.0 * place.x - 1.0, 1.0 - 2.0 * place.y, 0.0, 1.0),
        coverage * color_at(params.size, pixel),
        coverage,
        vec4(corner, i32(sprite.across), i32(sprite.first)),
    );
}
