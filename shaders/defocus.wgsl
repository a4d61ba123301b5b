// The defocus of a surface, in the measure of the plan.

struct Defocus {
    // Per pixel of shift and unit of disparity, or per metre.
    scale: f32,
    d_focus: f32,
    measure: u32,
}

const SHIFT: u32 = 0u;
// Stands for an infinite distance from the focus; every value derived from it is limited.
const FARTHEST: f32 = 1e9;

fn defocus_at(defocus: Defocus, d: f32) -> f32 {
    if defocus.measure == SHIFT {
        return defocus.scale * (d - defocus.d_focus);
    }
    if d == defocus.d_focus {
        return 0.0;
    }
    // 1/d - 1/d_focus; either distance may be infinite.
    let product = d * defocus.d_focus;
    let far = abs(product) < 1e-30;
    let distance = (defocus.d_focus - d) / select(product, 1.0, far);
    return clamp(defocus.scale * select(distance, FARTHEST, far), -FARTHEST, FARTHEST);
}
