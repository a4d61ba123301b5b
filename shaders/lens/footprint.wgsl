// The variance to add to cells by their shift, negative where blur is to be undone: plan/lens/footprint.rs.

struct Footprint {
    s_focus: f32,
    steps_per_px: f32,
    entries: u32,
    // The variance that the four direct neighbours can add.
    next_cells: f32,
}

@group(0) @binding(1) var<storage, read> variances: array<f32>;

fn variance(footprint: Footprint, s: f32) -> f32 {
    let at = abs(s - footprint.s_focus) * footprint.steps_per_px;
    let i = min(u32(at), footprint.entries - 2u);
    let fraction = min(at - f32(i), 1.0);
    return variances[i] + fraction * (variances[i + 1u] - variances[i]);
}
