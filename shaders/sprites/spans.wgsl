// Running sums along rows. They begin anew after every span of pixels: differences of sums over a whole row would lose
// what a few of its pixels are.

const SPAN: u32 = 256u;

// The index of the first sum of a span. There is one sum more than there are pixels in the span.
fn first_sum(row: u32, span: u32) -> u32 {
    let spans = (params.size.x + SPAN - 1u) / SPAN;
    return row * (params.size.x + spans) + span * (SPAN + 1u);
}
