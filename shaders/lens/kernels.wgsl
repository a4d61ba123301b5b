// The discs of a frame as words, written by gpu/lens/kernels.rs: a head for each disc, then rows, then single pixels.

struct Kernel {
    // Index of the first row's words.
    rows: u32,
    count: u32,
    first_dy: i32,
    run_weight: f32,
}

// Columns `run.x .. run.y` are covered completely; the others are listed from index `partial` on.
struct KernelRow {
    run: vec2<i32>,
    partial: u32,
    count: u32,
}

fn kernel_at(i: u32) -> Kernel {
    let at = 4u * i;
    return Kernel(kernels[at], kernels[at + 1u], bitcast<i32>(kernels[at + 2u]), bitcast<f32>(kernels[at + 3u]));
}

fn kernel_row(kernel: Kernel, i: u32) -> KernelRow {
    let at = kernel.rows + 4u * i;
    let run = vec2(bitcast<i32>(kernels[at]), bitcast<i32>(kernels[at + 1u]));
    return KernelRow(run, kernels[at + 2u], kernels[at + 3u]);
}

fn partial_dx(row: KernelRow, i: u32) -> i32 {
    return bitcast<i32>(kernels[row.partial + 2u * i]);
}

fn partial_weight(row: KernelRow, i: u32) -> f32 {
    return bitcast<f32>(kernels[row.partial + 2u * i + 1u]);
}
