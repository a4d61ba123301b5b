//! Carries out [`plan::poisson`](crate::plan::poisson).

use super::job::Job;
use super::padded_rows::{PaddedRows, block};
use crate::error::Result;
use crate::picture::Size;
use crate::plan::poisson::{LeakTest, Plan, Settings, Tap};
use crate::rows::{greater, interleave, lesser, mix, render_bands, with_channels};

/// Rows that one task processes, or as many as the margin has if that is more.
const BAND: usize = 16;
/// Pixels of a row that are processed together: their sums fit into registers.
const LANES: usize = 16;

/// Renders the picture, interleaved, into `out`.
pub fn render(job: &Job, settings: &Settings, out: &mut [f32]) -> Result<()> {
    let Job { front: layer, size, optics, simd, cancel } = *job;
    let plan = Plan::new(settings, optics);
    // The colours, then disparity, then blurriness.
    let planes = Size { channels: size.channels + 2, ..size };
    let read = |plane: usize, y: usize, out: &mut [f32]| {
        let disparity = &layer.disparity[y * size.width..][..size.width];
        if plane < size.channels {
            out.copy_from_slice(&layer.color[plane * size.pixels() + y * size.width..][..size.width]);
        } else if plane == size.channels {
            out.copy_from_slice(disparity);
        } else {
            simd.run(
                #[inline(always)]
                || blurriness_row(&plan, disparity, out),
            );
        }
    };
    let band = BAND.max(plan.margin);
    render_bands(
        out,
        size,
        band,
        cancel,
        || (PaddedRows::new(planes, band, plan.margin), Extremes::default()),
        |(window, extremes), first, out| {
            let length = size.width * size.channels;
            window.fill(first, out.len() / length, read);
            let (disparity, blurriness) = (window.plane(size.channels), window.plane(size.channels + 1));
            simd.run(
                #[inline(always)]
                || find_extremes(disparity, blurriness, window.stride, extremes),
            );
            for (i, out) in out.chunks_mut(length).enumerate() {
                with_channels!(size.channels, C => simd.run(#[inline(always)] || row::<C>(&plan, window, extremes, first + i, out)));
            }
        },
    )
}

/// The blurriness of a row.
#[inline(always)]
fn blurriness_row(plan: &Plan, disparity: &[f32], out: &mut [f32]) {
    for (blurriness, d) in out.iter_mut().zip(disparity) {
        *blurriness = plan.blurriness(*d);
    }
}

/// The weight of a tap under the leak test, without the tap's own weight.
#[inline(always)]
fn contribution(centre_disparity: f32, tap_disparity: f32, tap_blurriness: f32) -> f32 {
    if tap_disparity > centre_disparity { tap_blurriness } else { 1.0 }
}

/// Interpolates between four neighbours, two above and two below.
#[inline(always)]
fn bilinear(a: f32, b: f32, c: f32, d: f32, right: f32, down: f32) -> f32 {
    mix(mix(a, b, right), mix(c, d, right), down)
}

/// Splits a position less than 2^22 pixels away into whole pixels and the remaining fraction.
#[inline(always)]
fn split(x: f32) -> (i32, f32) {
    // Numbers this large have no fractions, so the sum is rounded to a whole number, which its low bits hold. Rust's
    // own conversions saturate, and are not vectorised.
    const LARGE: f32 = 12_582_912.0;
    let rounded = x + LARGE;
    let (nearest, whole) = (rounded - LARGE, rounded.to_bits().wrapping_sub(LARGE.to_bits()).cast_signed());
    let beyond = x - nearest;
    if beyond < 0.0 { (whole - 1, beyond + 1.0) } else { (whole, beyond) }
}

/// The positions at which one tap reads, for the pixels of a block.
enum Places {
    /// All pixels have the same circle of confusion, so the offset is the same for all.
    Same(Place),
    /// The offsets have only a few values: many blocks are so smooth that a tap has the same neighbours for most
    /// pixels.
    Few(Few, EachPlace),
    Each(EachPlace),
}

/// A position between pixels.
#[derive(Clone, Copy)]
struct Place {
    /// The upper left of the four neighbours, relative to the pixel.
    offset: i32,
    /// The fractions of a pixel from there to the position.
    right: f32,
    down: f32,
}

/// A [`Place`] for each pixel of a block.
struct EachPlace {
    offset: [i32; LANES],
    right: [f32; LANES],
    down: [f32; LANES],
}

impl Places {
    /// The positions of a tap if the pattern is scaled by `scale_px`.
    #[inline(always)]
    fn new(tap: &Tap, scale_px: &Scales, stride: usize) -> Places {
        let place = |scale_px: f32| {
            let ((column, right), (row, down)) = (split(tap.x * scale_px), split(tap.y * scale_px));
            Place { offset: row * stride as i32 + column, right, down }
        };
        if scale_px.all_alike {
            return Places::Same(place(scale_px.each[0]));
        }
        let mut each = EachPlace { offset: [0; LANES], right: [0.0; LANES], down: [0.0; LANES] };
        for i in 0..LANES {
            Place { offset: each.offset[i], right: each.right[i], down: each.down[i] } =
                place(scale_px.each[i]);
        }
        match Few::of(&each.offset) {
            Some(few) => Places::Few(few, each),
            None => Places::Each(each),
        }
    }
}

/// The blocks of the four neighbours; the upper left one has this offset from index `at`.
#[inline(always)]
fn neighbours(plane: &[f32], at: usize, offset: i32, stride: usize) -> [&[f32; LANES]; 4] {
    let first = at.wrapping_add_signed(offset as isize);
    let (above, below) = (&plane[first..][..LANES + 1], &plane[first + stride..][..LANES + 1]);
    [block(above, 0), block(above, 1), block(below, 0), block(below, 1)]
}

impl Place {
    /// Bilinear look-ups for a block that starts at index `at`.
    #[inline(always)]
    fn read(&self, plane: &[f32], at: usize, stride: usize) -> [f32; LANES] {
        let [a, b, c, d] = neighbours(plane, at, self.offset, stride);
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = bilinear(a[i], b[i], c[i], d[i], self.right, self.down);
        }
        out
    }
}

impl EachPlace {
    /// Bilinear look-ups for a block that starts at index `at`.
    #[inline(always)]
    fn read(&self, plane: &[f32], at: usize, stride: usize) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            let first = (at + i).wrapping_add_signed(self.offset[i] as isize);
            // Two slices, so that bounds are checked for them only and not for each of the four values.
            let (above, below) = (&plane[first..first + 2], &plane[first + stride..first + stride + 2]);
            out[i] = bilinear(above[0], above[1], below[0], below[1], self.right[i], self.down[i]);
        }
        out
    }

    /// The same, if these are all offsets that occur.
    #[inline(always)]
    fn read_few(&self, few: &Few, plane: &[f32], at: usize, stride: usize) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        for &offset in &few.found[..few.count] {
            let [a, b, c, d] = neighbours(plane, at, offset, stride);
            for i in 0..LANES {
                let v = bilinear(a[i], b[i], c[i], d[i], self.right[i], self.down[i]);
                out[i] = if self.offset[i] == offset { v } else { out[i] };
            }
        }
        out
    }
}

/// The few offsets that occur.
struct Few {
    found: [i32; Few::MOST],
    count: usize,
}

impl Few {
    /// If there are more, reading every pixel separately costs less.
    const MOST: usize = 6;

    /// The distinct values in a block, in rising order.
    #[inline(always)]
    fn of(block: &[i32; LANES]) -> Option<Few> {
        let mut few = Few { found: [i32::MAX; Few::MOST], count: 0 };
        let mut last = i32::MIN;
        loop {
            // The least of the values beyond the last one found.
            let mut next = i32::MAX;
            for &v in block {
                next = next.min(if v > last { v } else { i32::MAX });
            }
            if next == i32::MAX {
                return Some(few);
            }
            *few.found.get_mut(few.count)? = next;
            few.count += 1;
            last = next;
        }
    }
}

/// The sums over the taps of a block.
struct Sums<const C: usize> {
    /// Weighted sums of the differences between the taps' colours and the centre's.
    moved: [[f32; LANES]; C],
    total: [f32; LANES],
}

/// The pixels of a block, and the values with which their taps are compared.
struct Centre<'a, const C: usize> {
    planes: [&'a [f32]; C],
    disparities: &'a [f32],
    blurriness: &'a [f32],
    color: [[f32; LANES]; C],
    disparity: [f32; LANES],
    leak_test: LeakTest,
}

impl<const C: usize> Sums<C> {
    /// Adds a tap; `read` looks it up in a plane.
    #[inline(always)]
    fn add(&mut self, centre: &Centre<C>, weight: f32, read: impl Fn(&[f32]) -> [f32; LANES]) {
        let mut counts = [weight; LANES];
        if centre.leak_test == LeakTest::On {
            let (disparity, blurriness) = (read(centre.disparities), read(centre.blurriness));
            for i in 0..LANES {
                counts[i] *= contribution(centre.disparity[i], disparity[i], blurriness[i]);
            }
        }
        for i in 0..LANES {
            self.total[i] += counts[i];
        }
        for c in 0..C {
            let color = read(centre.planes[c]);
            for i in 0..LANES {
                self.moved[c][i] += counts[i] * (color[i] - centre.color[c][i]);
            }
        }
    }
}

/// The average over all taps, for a block that starts at index `at`.
#[inline(always)]
fn average<const C: usize>(
    plan: &Plan,
    window: &PaddedRows,
    at: usize,
    scale_px: &Scales,
    leak_test: LeakTest,
) -> [[f32; LANES]; C] {
    let mut planes = [window.plane(0); C];
    for c in 1..C {
        planes[c] = window.plane(c);
    }
    let (disparities, blurriness, stride) = (window.plane(C), window.plane(C + 1), window.stride);
    let (color, disparity) = (window.blocks(at), *block(disparities, at));
    let centre = Centre { planes, disparities, blurriness, color, disparity, leak_test };
    let mut sums = Sums { moved: [[0.0; LANES]; C], total: [plan.centre; LANES] };
    for tap in &plan.taps {
        // This is outside the loop over the planes, which then stays small enough to be unrolled.
        match &Places::new(tap, scale_px, stride) {
            Places::Same(place) => sums.add(
                &centre,
                tap.weight,
                #[inline(always)]
                |plane| place.read(plane, at, stride),
            ),
            Places::Few(few, each) => sums.add(
                &centre,
                tap.weight,
                #[inline(always)]
                |plane| each.read_few(few, plane, at, stride),
            ),
            Places::Each(each) => sums.add(
                &centre,
                tap.weight,
                #[inline(always)]
                |plane| each.read(plane, at, stride),
            ),
        }
    }
    let mut out = centre.color;
    for c in 0..C {
        for i in 0..LANES {
            // If no tap counts at all, the pixel keeps its colour.
            let difference = sums.moved[c][i] / sums.total[i].max(f32::MIN_POSITIVE);
            out[c][i] = plan.average(out[c][i], difference);
        }
    }
    out
}

/// The scale of the pattern around each pixel of a block.
struct Scales {
    each: [f32; LANES],
    all_alike: bool,
}

impl Scales {
    #[inline(always)]
    fn new(plan: &Plan, disparity: &[f32; LANES]) -> Scales {
        let (mut each, mut all_alike) = ([0.0; LANES], true);
        for i in 0..LANES {
            each[i] = plan.scale_px(disparity[i]);
        }
        for i in 0..LANES {
            all_alike &= each[i] == each[0];
        }
        Scales { each, all_alike }
    }
}

/// Bounds for the leak test: the extremes over every few columns of a window.
#[derive(Default)]
struct Extremes {
    /// Extremes of each column.
    columns: Vec<f32>,
    nearest: Vec<f32>,
    least_blurred: Vec<f32>,
}

impl Extremes {
    /// Number of columns that share their extremes.
    const CELL: usize = 16;

    /// The leak test for the block that starts at column `x`. It is turned off where it would change nothing.
    #[inline(always)]
    fn leak_test(&self, plan: &Plan, x: usize, disparity: &[f32; LANES]) -> LeakTest {
        let cells = x / Self::CELL..(x + LANES + 2 * plan.margin).div_ceil(Self::CELL);
        let nearest = self.nearest[cells.clone()].iter().fold(f32::NEG_INFINITY, |a, b| greater(a, *b));
        let least_blurred = self.least_blurred[cells].iter().fold(f32::INFINITY, |a, b| lesser(a, *b));
        let farthest = disparity.iter().fold(f32::INFINITY, |a, b| lesser(a, *b));
        // No tap is in front of any pixel, or all taps in front count as much as the others.
        if nearest <= farthest || least_blurred >= 1.0 { LeakTest::Off } else { plan.leak_test }
    }
}

/// Reduces every few columns of a plane with `pick`.
#[inline(always)]
fn reduce(
    plane: &[f32],
    stride: usize,
    columns: &mut Vec<f32>,
    cells: &mut Vec<f32>,
    pick: impl Fn(f32, f32) -> f32,
) {
    columns.clear();
    columns.extend_from_slice(&plane[..stride]);
    for row in plane.chunks_exact(stride).skip(1) {
        for (column, v) in columns.iter_mut().zip(row) {
            *column = pick(*column, *v);
        }
    }
    cells.clear();
    cells.extend(columns.chunks(Extremes::CELL).map(|cell| cell.iter().fold(cell[0], |a, b| pick(a, *b))));
}

/// Finds the extremes of planes of disparity and blurriness.
#[inline(always)]
fn find_extremes(disparity: &[f32], blurriness: &[f32], stride: usize, extremes: &mut Extremes) {
    let Extremes { columns, nearest, least_blurred } = extremes;
    reduce(disparity, stride, columns, nearest, greater);
    reduce(blurriness, stride, columns, least_blurred, lesser);
}

/// One row of the picture.
#[inline(always)]
fn row<const C: usize>(plan: &Plan, window: &PaddedRows, extremes: &Extremes, y: usize, out: &mut [f32]) {
    for (i, out) in out.chunks_mut(LANES * C).enumerate() {
        let at = window.index(i * LANES, y);
        let disparity = block(window.plane(C), at);
        let scale_px = Scales::new(plan, disparity);
        let blurred = if scale_px.all_alike && scale_px.each[0] == 0.0 {
            window.blocks::<C, LANES>(at)
        } else {
            average::<C>(plan, window, at, &scale_px, extremes.leak_test(plan, i * LANES, disparity))
        };
        interleave(blurred.each_ref(), out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_split_into_whole_and_fraction() {
        for x in [0.0f32, 0.25, 0.5, 0.75, 1.0, 1.5, 2.5, -0.25, -0.5, -1.0, -1.5, -2.75, 511.125, -511.125] {
            assert_eq!(split(x), (x.floor() as i32, x - x.floor()), "{x}");
        }
    }

    #[test]
    fn few_offsets_are_found_once_each() {
        let mut offsets = [7; LANES];
        assert_eq!(Few::of(&offsets).map(|f| f.found[..f.count].to_vec()), Some(vec![7]));
        offsets[3] = -20;
        offsets[12] = 9;
        assert_eq!(Few::of(&offsets).map(|f| f.found[..f.count].to_vec()), Some(vec![-20, 7, 9]));
        assert!(Few::of(&std::array::from_fn(|i| i as i32 % 7)).is_none());
    }
}
