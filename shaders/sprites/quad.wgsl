// What the corners of a sprite's quad hand to its pixels.

struct Corner {
    @builtin(position) position: vec4<f32>,
    // Colour times how much of the point is drawn, and how much that is.
    @location(0) @interpolate(flat) color: vec4<f32>,
    @location(1) @interpolate(flat) coverage: f32,
    // The target's pixel that the sprite begins at, its columns, and its first weight.
    @location(2) @interpolate(flat) sprite: vec4<i32>,
}
