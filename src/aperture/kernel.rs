//! The image of a point out of focus: the opening, scaled by the shift and averaged over each pixel.

use super::coverage::Coverage;
use super::opening::{Aperture, Shape};
use super::outline::Outline;
use super::picture::Picture;
use super::profile::{Profile, Side};

impl Aperture {
    /// The image of a point under shift `t` pixels: the part of each pixel that the opening, scaled by `t`, covers.
    pub fn kernel(&self, t: f64) -> Kernel {
        self.kernel_on(Side::of(t), t)
    }

    /// The image of a point on one side of the focus plane, whatever the orientation that the sign of `t` gives it.
    pub fn kernel_on(&self, side: Side, t: f64) -> Kernel {
        let reach = (t.abs() + 0.5).ceil() as i32;
        match &self.shape {
            _ if self.is_plain_disc() => disc_kernel(t, reach),
            Shape::Outline(outline) => self.outline_kernel(outline, side, t, reach),
            Shape::Picture(picture) => self.picture_kernel(picture, t, reach),
        }
    }

    pub(super) fn is_plain_disc(&self) -> bool {
        matches!(self.shape, Shape::Outline(Outline::Disc))
            && self.profile == Profile::FLAT
            && self.squeeze == [1.0; 2]
            && self.lean == [0.0; 2]
    }

    /// The kernel of an opening with an outline: a weighted sum of the areas of polygons.
    fn outline_kernel(&self, outline: &Outline, side: Side, t: f64, reach: i32) -> Kernel {
        // Rims are half a pixel apart, so that no step shows, and numerous enough for the moments of small openings.
        let steps = (2.0 * t.abs()) as usize;
        let steps = steps.clamp(64, 512);
        let contour = outline.contour();
        let mut coverage = Coverage::new(reach);
        let stack = self.profile.stack(steps, side);
        // Normalised so that transmission is 1 where most light passes.
        let levels = stack.iter().scan(0.0, |level, s| {
            *level += s.1;
            Some(*level)
        });
        let greatest = levels.fold(0.0, f64::max);
        for &(scale, weight) in &stack {
            let polygon: Vec<_> =
                contour.iter().map(|l| self.placed(l.map(|v| scale * v)).map(|v| t * v)).collect();
            coverage.add(&polygon, weight / greatest);
        }
        let areas = coverage.finish();
        let across = 2 * reach + 1;
        Kernel::from_weights(reach, |dx, dy| {
            let area = areas[((dy + reach) * across + dx + reach) as usize];
            if area == 0.0 { 0.0 } else { area * self.density([dx, dy].map(|d| f64::from(d) / t)) }
        })
    }

    /// The kernel of an opening given by a picture: the light inside each pixel's box.
    fn picture_kernel(&self, picture: &Picture, t: f64, reach: i32) -> Kernel {
        let source = |x: f64, y: f64| self.source([x / t, y / t]);
        // Texels per pixel, so that weights are means.
        let per_pixel = picture.texels() / (4.0 * t * t * self.squeeze[0] * self.squeeze[1]);
        Kernel::from_weights(reach, |dx, dy| {
            let (x, y) = (f64::from(dx), f64::from(dy));
            let columns = [source(x - 0.5, y)[0], source(x + 0.5, y)[0]];
            let rows = [source(x, y - 0.5)[1], source(x, y + 0.5)[1]];
            let least = [columns[0].min(columns[1]), rows[0].min(rows[1])];
            let greatest = [columns[0].max(columns[1]), rows[0].max(rows[1])];
            picture.between(least, greatest) / per_pixel
        })
    }
}

/// The kernel of a clear disc, in closed form.
fn disc_kernel(t: f64, reach: i32) -> Kernel {
    let r = t.abs();
    // The nearest and the farthest point of the unit pixel from the centre decide most cases.
    let nearest = |d: i32| (f64::from(d.abs()) - 0.5).max(0.0);
    let farthest = |d: i32| f64::from(d.abs()) + 0.5;
    let squared = |a: f64, b: f64| a * a + b * b;
    Kernel::from_weights(reach, |dx, dy| {
        if squared(nearest(dx), nearest(dy)) >= r * r {
            0.0
        } else if squared(farthest(dx), farthest(dy)) <= r * r {
            1.0
        } else {
            disc_pixel_area(r, dx, dy)
        }
    })
}

/// Area of the intersection of the disc of radius `r` around the origin with the unit pixel at `(dx, dy)`.
fn disc_pixel_area(r: f64, dx: i32, dy: i32) -> f64 {
    // By symmetry, only the first quadrant is needed; a pixel that an axis cuts in half is two halves.
    let side = |d: i32| {
        let d = f64::from(d.abs());
        if d == 0.0 { (0.0, 0.5, 2.0) } else { (d - 0.5, d + 0.5, 1.0) }
    };
    let ((x0, x1, nx), (y0, y1, ny)) = (side(dx), side(dy));
    let half_chord = |y: f64| (r * r - y * y).max(0.0).sqrt();
    let arc = |x: f64| 0.5 * (x * half_chord(x) + r * r * (x / r).clamp(-1.0, 1.0).asin());
    // Over [x0, full] the pixel's column is covered completely, over [full, end] up to the arc.
    let end = half_chord(y0).min(x1);
    let full = half_chord(y1).clamp(x0, x1).min(end.max(x0));
    let whole = (y1 - y0) * (full - x0);
    let part = if end > full { arc(end) - arc(full) - y0 * (end - full) } else { 0.0 };
    if y0 >= r { 0.0 } else { nx * ny * (whole + part.max(0.0)) }
}

/// One row of a kernel: a run of equal weights, and the pixels with other weights.
#[derive(Debug, Clone, PartialEq)]
pub struct KernelRow {
    /// Row offset.
    pub dy: i32,
    /// Columns `run.0 .. run.1`, which the opening covers completely.
    pub run: (i32, i32),
    /// Column offset and weight of the pixels that it covers partly.
    pub partial: Vec<(i32, f32)>,
}

/// A convolution kernel of sum 1, row by row, in the form that running sums need.
#[derive(Debug, Clone, PartialEq)]
pub struct Kernel {
    /// No weight is farther than this from the centre along either axis.
    pub reach: i32,
    /// Weight of every pixel in a row's run.
    pub run_weight: f32,
    /// The rows from the first to the last that has weights, one after the other.
    pub rows: Vec<KernelRow>,
}

impl Kernel {
    /// The kernel of these weights, each the mean transmission over a pixel.
    pub(super) fn from_weights(reach: i32, weight: impl Fn(i32, i32) -> f64) -> Kernel {
        // A pixel counts as completely covered if only rounding is missing.
        const WHOLE: f64 = 1.0 - 1e-12;
        let raw: Vec<(i32, Vec<(i32, f64)>)> = (-reach..=reach)
            .map(|dy| (dy, (-reach..=reach).map(|dx| (dx, weight(dx, dy))).filter(|w| w.1 > 0.0).collect()))
            .collect();
        // A row without weights stays if it lies between others: rows are found by their number.
        let is_empty = |(_, row): &&(i32, Vec<_>)| row.is_empty();
        let (above, below) =
            (raw.iter().take_while(is_empty).count(), raw.iter().rev().take_while(is_empty).count());
        let raw = raw.get(above..raw.len() - below).unwrap_or_default();
        let total: f64 = raw.iter().flat_map(|(_, row)| row).map(|w| w.1).sum();
        if total <= 0.0 {
            let centre = KernelRow { dy: 0, run: (0, 1), partial: Vec::new() };
            return Kernel { reach: 0, run_weight: 1.0, rows: vec![centre] };
        }
        let rows = raw
            .iter()
            .map(|(dy, row)| {
                let run = longest_run(row, WHOLE);
                let partial = row
                    .iter()
                    .filter(|w| !(run.0..run.1).contains(&w.0))
                    .map(|w| (w.0, (w.1 / total) as f32))
                    .collect();
                KernelRow { dy: *dy, run, partial }
            })
            .collect();
        Kernel { reach, run_weight: (1.0 / total) as f32, rows }
    }

    /// Every weight as `(dx, dy, weight)`.
    pub fn weights(&self) -> impl Iterator<Item = (i32, i32, f32)> + '_ {
        self.rows.iter().flat_map(|row| {
            let run = (row.run.0..row.run.1).map(|dx| (dx, row.dy, self.run_weight));
            run.chain(row.partial.iter().map(|&(dx, w)| (dx, row.dy, w)))
        })
    }
}

/// The longest run of neighbouring pixels of at least this weight; an opening with a hole has two runs in a row.
fn longest_run(row: &[(i32, f64)], whole: f64) -> (i32, i32) {
    let (mut longest, mut run) = ((0, 0), (0, 0));
    for (dx, _) in row.iter().filter(|w| w.1 >= whole) {
        run = if run.1 == *dx && run.0 < run.1 { (run.0, dx + 1) } else { (*dx, dx + 1) };
        if run.1 - run.0 > longest.1 - longest.0 {
            longest = run;
        }
    }
    longest
}
