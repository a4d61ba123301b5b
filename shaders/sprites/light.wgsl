// The light of one layer at the picture's pixels: colour times coverage, and coverage.

struct Light {
    color: vec4<f32>,
    coverage: f32,
}

@group(0) @binding(3) var<storage, read> light: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> coverage: array<f32>;

fn texel(x: i32, y: i32) -> Light {
    let at = vec2(mirrored(x, i32(params.half.x)), mirrored(y, i32(params.half.y)));
    let i = u32(at.y) * params.half.x + u32(at.x);
    return Light(light[i], coverage[i]);
}

fn mixed(a: Light, b: Light, fraction: f32) -> Light {
    return Light(a.color + fraction * (b.color - a.color), a.coverage + fraction * (b.coverage - a.coverage));
}

// A layer, interpolated between the centres of four of its pixels.
fn light_at(at: vec2<u32>) -> Light {
    // Pixel p is at texel p / 2 - 1/4: a quarter of a texel before or after the centre of its own texel.
    let own = vec2<i32>(at / 2u);
    let odd = (at & vec2(1u)) == vec2(1u);
    let first = select(own - 1, own, odd);
    let fraction = select(vec2(0.75), vec2(0.25), odd);
    let left = mixed(texel(first.x, first.y), texel(first.x, first.y + 1), fraction.y);
    let right = mixed(texel(first.x + 1, first.y), texel(first.x + 1, first.y + 1), fraction.y);
    return mixed(left, right, fraction.x);
}
