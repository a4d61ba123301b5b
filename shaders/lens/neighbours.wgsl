// Which cells continue a surface at the pixels beside it: scene/depth_spans.rs. The parameters of the pass that includes
// this file have the frame's `size`, the number of `layers`, and `connected_px`.

// In place of where the bits of a layer begin. Its cells are no pixels of the picture; or it is a holdout.
const NO_EDGES: u32 = 0xffffffffu;
const OF_HOLDOUT: u32 = 0xfffffffeu;

@group(0) @binding(2) var<storage, read> shifts: array<f32>;
// For each layer where its bits begin, or one of the constants; then for each pixel of these layers whether a surface ends
// around it.
@group(0) @binding(3) var<storage, read> edges: array<u32>;

fn is_edge(first: u32, pixel: u32) -> bool {
    return (edges[first + pixel / 32u] & (1u << (pixel % 32u))) != 0u;
}

// Whether two layers are both holdouts or both not: one does not continue the other otherwise.
fn are_alike(a: u32, b: u32) -> bool {
    return (edges[a] == OF_HOLDOUT) == (edges[b] == OF_HOLDOUT);
}

// The cell at pixel `beside` that continues the surface of a layer's cell at pixel `own`, whose shift is `s`. If there is
// no such cell, the cell itself.
//
// Surfaces may be steep: pixels beside each other of which neither is at an edge are one surface.
fn neighbour(layer: u32, own: u32, s: f32, beside: u32) -> u32 {
    let pixels = params.size.x * params.size.y;
    let there = layer * pixels + beside;
    if abs(shifts[there] - s) < params.connected_px {
        return there;
    }
    let first = edges[layer];
    if first < OF_HOLDOUT && !is_edge(first, own) && !is_edge(first, beside) && shifts[there] < NOWHERE {
        return there;
    }
    for (var other = 0u; other < params.layers; other++) {
        let cell = other * pixels + beside;
        if other != layer && abs(shifts[cell] - s) < params.connected_px && are_alike(layer, other) {
            return cell;
        }
    }
    return layer * pixels + own;
}
