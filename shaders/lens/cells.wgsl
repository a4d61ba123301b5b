// The cells of one layer: those of the picture, and in the place of some of them those that are listed.

struct Params {
    size: vec2<u32>,
    // The layer's first cell, and the first of the picture's planes that it has, or `NO_PLANES`.
    first: u32,
    planes: u32,
    // Whether pixels of the picture that have no coverage are empty.
    covered: u32,
    // Whether only listed cells have a shift.
    listed_shifts: u32,
    // Words of a listed cell: its colour, its shift and the number of its half-plane. Each may be missing.
    color_words: u32,
    shift_words: u32,
    number_words: u32,
}

// In place of the first plane: cells that are not listed have no colour.
const NO_PLANES: u32 = 0xffffffffu;

@group(0) @binding(0) var<uniform> params: Params;
// For every 32 pixels: which of their cells are listed, one bit each, and how many were before.
@group(0) @binding(2) var<storage, read> listed: array<u32>;
@group(0) @binding(3) var<storage, read> words: array<u32>;
@group(0) @binding(4) var<storage, read_write> colors: array<vec4<f32>>;
// As bits, of which those of NaN stand for an empty cell: comparing floats, shaders cannot rely on it.
@group(0) @binding(5) var<storage, read_write> shifts: array<u32>;
// For each cell 0, or one more than the index of its half-plane.
@group(0) @binding(6) var<storage, read_write> half_planes: array<u32>;

fn is_nan(bits: u32) -> bool {
    return (bits & 0x7fffffffu) > 0x7f800000u;
}

fn word_color(first: u32) -> vec4<f32> {
    var value = vec4(bitcast<f32>(words[first]), 0.0, 0.0, 0.0);
    if CHANNELS > 1u {
        value.y = bitcast<f32>(words[first + 1u]);
    }
    if CHANNELS > 2u {
        value.z = bitcast<f32>(words[first + 2u]);
    }
    if CHANNELS > 3u {
        value.w = bitcast<f32>(words[first + 3u]);
    }
    return value;
}

fn picture_color(pixel: u32) -> vec4<f32> {
    if params.planes == NO_PLANES {
        return vec4<f32>();
    }
    let color = color_at(params.size, params.planes * params.size.x * params.size.y + pixel);
    let is_empty = params.covered != 0u && color[CHANNELS - 1u] <= 0.0;
    return select(color, vec4<f32>(), is_empty);
}

@compute @workgroup_size(16, 16)
fn cells(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = id.y * params.size.x + id.x;
    let cell = params.first + pixel;
    var color = picture_color(pixel);
    var shift = bitcast<u32>(NOWHERE);
    if params.listed_shifts == 0u && !is_nan(shifts[cell]) {
        shift = shifts[cell];
    }
    var number = 0u;
    let in_record = params.color_words + params.shift_words + params.number_words;
    if in_record > 0u {
        let bits = listed[2u * (pixel / 32u)];
        let before = listed[2u * (pixel / 32u) + 1u];
        let bit = 1u << (pixel % 32u);
        if (bits & bit) != 0u {
            var at = in_record * (before + countOneBits(bits & (bit - 1u)));
            if params.color_words > 0u {
                color = word_color(at);
                at += params.color_words;
            }
            if params.shift_words > 0u {
                shift = words[at];
                at++;
            }
            if params.number_words > 0u {
                number = words[at];
            }
        }
    }
    colors[cell] = color;
    shifts[cell] = shift;
    half_planes[cell] = number;
}
