// The depth of the picture.

@group(0) @binding(2) var<storage, read> disparity: array<f32>;
