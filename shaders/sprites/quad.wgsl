// The values that the corners of a sprite's quad pass to its pixels.

struct Corner {
    @builtin(position) position: vec4<f32>,
    // Colour times the part of the point that is drawn, and that part.
    @location(0) @interpolate(flat) color: vec4<f32>,
    @location(1) @interpolate(flat) coverage: f32,
    // The pixel of the target at which the sprite begins, its number of columns, and the index of its first weight.
    @location(2) @interpolate(flat) sprite: vec4<i32>,
}
