// The points that may be drawn: the picture's pixels, and their mirror images beyond its border.

// The contribution of one point to a target: its first column and row, relative to the pixel of the target that
// contains it, its size, and the index of its first weight. There are four for each radius step: for even and odd
// columns of even rows, then of odd rows.
struct Sprite {
    left: i32,
    top: i32,
    across: u32,
    down: u32,
    first: u32,
}

@group(0) @binding(3) var<storage, read> boundaries: array<f32>;
@group(0) @binding(4) var<storage, read> sprites: array<Sprite>;

// The position of a point by its number, row by row.
fn place_of(point: u32) -> vec2<i32> {
    let across = params.size.x + 2u * u32(params.reach);
    return vec2<i32>(vec2(point % across, point / across)) - params.reach;
}

// The number of points.
fn all_points() -> u32 {
    let reach = 2u * u32(params.reach);
    return (params.size.x + reach) * (params.size.y + reach);
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

fn sprite_of(step: u32, place: vec2<i32>) -> Sprite {
    let odd = vec2<u32>(place & vec2(1));
    return sprites[4u * step + 2u * odd.y + odd.x];
}

// The pixel of the target at which a sprite begins.
fn corner_of(sprite: Sprite, place: vec2<i32>) -> vec2<i32> {
    return (place >> vec2(1u)) + vec2(sprite.left, sprite.top);
}

// Whether a point is drawn into the layers in front and behind.
fn layers_of(point: u32) -> vec2<bool> {
    if point >= all_points() {
        return vec2(false);
    }
    let place = place_of(point);
    let pixel = pixel_at(place);
    let coc = coc_of(pixel);
    if drawn(coc) == 0.0 {
        return vec2(false);
    }
    let sprite = sprite_of(step_of(disparity[pixel]), place);
    let corner = corner_of(sprite, place);
    let opposite = corner + vec2<i32>(vec2(sprite.across, sprite.down));
    let meets = all(corner < vec2<i32>(params.half)) && all(opposite > vec2(0));
    return vec2(meets && coc < 0.0, meets && coc > 0.0);
}
