//! The shadows that nearer surfaces cast on the disc of a cluster of highlights.
//!
//! A pixel `p` sees a highlight at `q`, of shift `t`, through the lens point `(q - p) / t`. The rays of the pixel are a
//! beam as wide as the pixel at every depth. On its way from the highlight to the lens the beam gains shift; where it has
//! gained `u |t|`, it has moved from `q` to `q + u e`. Here `e` is `p - q` for a highlight behind the focus, and `q - p`
//! for one in front of it.
//!
//! So a cell at the offset `d` from the highlight, which the beam passes at `u`, shades the pixels near `e = d / u`. All
//! cells in front of the highlight are asked once which pixels they shade: the cost is that of the surfaces before the
//! disc, whatever their distance.

use super::padded::Padded;
use crate::plan::lens::highlights::{Cluster, Highlight, OTHER_SURFACE_PX, SAME_SURFACE_PX, same_surface};
use crate::rows::greater;
use crate::scene::depth_bounds::any_bin;
use crate::scene::grid::{BLOCK, TILE};
use crate::scene::layer::Role;
use std::cmp::Ordering;
use std::ops::{Range, RangeInclusive};

/// The part of each pixel's beam that is hidden, over one tile. Cells beside one another may hide more than all of it.
pub type Hidden = [f32; TILE.0 * TILE.1];

/// Columns and rows of the pixels of a tile.
pub type Pixels = [Range<i32>; 2];

/// So little of a beam's way is its beginning, where it is still at the highlight.
const TINY: f32 = 1e-6;

/// What rounding may add to a distance in pixels.
const SLACK: f32 = 1.0 / 16.0;

/// Rounds to the nearest integer, up to 2^22.
#[inline(always)]
fn nearest_integer(v: f32) -> f32 {
    // Adding one and a half times 2^23 rounds.
    const ROUND: f32 = 12_582_912.0;
    (v + ROUND) - ROUND
}

/// A cell in front of a highlight.
struct Cell {
    /// Its index in the padded frame.
    index: usize,
    layer: usize,
    /// Its offset from the highlight.
    d: [i32; 2],
    /// The codes of its span of depth.
    lo: u16,
    hi: u16,
}

/// A highlight, from which beams go to the pixels of a tile.
#[derive(Clone, Copy)]
pub struct Shadows<'a> {
    padded: &'a Padded,
    cluster: &'a Cluster,
    layer: usize,
    /// The highlight's pixel in the padded frame, and in the tile.
    place: [i32; 2],
    in_tile: [i32; 2],
    /// The sign of the offsets `e` for pixels to the right of the highlight and below it.
    sign: i32,
    /// The code of its depth.
    code: f32,
    /// Its own span of depth, in pixels of shift.
    own_span_px: f32,
    /// The code from which on a cell of its own layer may hide a part of it: what is nearer to its depth is of its
    /// surface.
    hiding: u16,
    /// What a code adds to `u`, and the greatest `u`.
    u_per_code: f32,
    u_max: f32,
}

impl<'a> Shadows<'a> {
    pub fn new(
        cluster: &'a Cluster,
        middle: &Highlight,
        origin: (usize, usize),
        padded: &'a Padded,
    ) -> Shadows<'a> {
        let in_tile = [middle.x - origin.0 as i32, middle.y - origin.1 as i32];
        let sign = if middle.t < 0.0 { 1 } else { -1 };
        Shadows::over(cluster, middle, middle.drawn_px().abs(), (in_tile, sign), padded)
    }

    /// The shadows on the opening itself, divided into cells of which `radius` are in a row from the middle to the rim, as
    /// on the pixels of a tile. The middle of the opening is at `in_tile`.
    pub fn on_opening(
        cluster: &'a Cluster,
        middle: &Highlight,
        radius: i32,
        in_tile: [i32; 2],
        padded: &'a Padded,
    ) -> Shadows<'a> {
        Shadows::over(cluster, middle, f64::from(radius), (in_tile, 1), padded)
    }

    /// The shadows on a grid with so many steps along the radius of the opening.
    fn over(
        cluster: &'a Cluster,
        middle: &Highlight,
        shift_px: f64,
        (in_tile, sign): ([i32; 2], i32),
        padded: &'a Padded,
    ) -> Shadows<'a> {
        let (px_per_code, pad) = (padded.codes.step(), padded.padding.pad.map(|pad| pad as i32));
        let hiding = f64::from(cluster.span[1]) + f64::from(SAME_SURFACE_PX) / px_per_code;
        Shadows {
            padded,
            cluster,
            layer: middle.layer,
            place: [middle.x + pad[0], middle.y + pad[1]],
            in_tile,
            sign,
            code: f32::from(cluster.code),
            own_span_px: (f64::from(cluster.span[1] - cluster.span[0]) * px_per_code) as f32,
            hiding: hiding.min(f64::from(u16::MAX)) as u16,
            u_per_code: (px_per_code / shift_px) as f32,
            u_max: ((padded.reach_px - middle.t) / shift_px) as f32,
        }
    }

    /// Adds what all cells hide of these pixels' beams.
    #[inline(always)]
    pub fn cast(&self, pixels: &Pixels, hidden: &mut Hidden) {
        // The offsets `e` of the pixels: the least and the greatest along each axis.
        let offsets = [0, 1].map(|i| {
            let ends = [pixels[i].start, pixels[i].end - 1].map(|p| self.sign * (p - self.in_tile[i]));
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        });
        let [columns, rows] = [0, 1].map(|i| self.images(i, &offsets));
        // Loops, because a closure would not be compiled for the instructions of its caller.
        for y in rows {
            for x in columns.clone() {
                Shadows { place: [x, y], ..*self }.cast_from(&offsets, hidden);
            }
        }
    }

    /// The columns or rows from which the highlight's beams are cast: its own, and where mirror images are not laid out again,
    /// those so many periods away from which beams come back into the padded frame.
    fn images(&self, i: usize, offsets: &[[i32; 2]; 2]) -> impl Iterator<Item = i32> + Clone + use<> {
        let own = self.place[i];
        let periods = self.padded.padding.periods[i].map(|period| {
            let (first, last) = self.touched(i, 0.0..self.u_max, offsets).into_inner();
            let period = period as i32;
            (period, -last.div_euclid(period)..=(period - 1 - first).div_euclid(period))
        });
        let (period, numbers) = periods.unwrap_or((0, 0..=0));
        numbers.map(move |number| own + number * period)
    }

    /// The columns or rows that beams with these offsets touch: up to one pixel aside.
    #[inline(always)]
    fn touched(&self, i: usize, u: Range<f32>, offsets: &[[i32; 2]; 2]) -> RangeInclusive<i32> {
        let [least, greatest] = offsets[i].map(|e| [u.start * e as f32, u.end * e as f32]);
        let first = least[0].min(least[1]).ceil() as i32 - 1 + self.place[i];
        first..=greatest[0].max(greatest[1]).floor() as i32 + 1 + self.place[i]
    }

    /// Adds what the cells of the padded frame hide of beams with these offsets.
    #[inline(always)]
    fn cast_from(&self, offsets: &[[i32; 2]; 2], hidden: &mut Hidden) {
        let Padded { padding, bounds, layers, .. } = self.padded;
        let touched = |i: usize, u: Range<f32>| {
            let (first, last) = self.touched(i, u, offsets).into_inner();
            // Of what is laid out twice, once.
            let extent = padding.periods[i].unwrap_or([padding.stride, padding.rows][i]);
            first.max(0)..=last.min(extent as i32 - 1)
        };
        let blocks = |i: usize| {
            let cells = touched(i, 0.0..self.u_max);
            *cells.start() as usize / BLOCK..=*cells.end() as usize / BLOCK
        };
        for (by, bx) in blocks(1).flat_map(|by| blocks(0).map(move |bx| (by, bx))) {
            let first = [bx, by].map(|b| (b * BLOCK) as i32);
            let Some(u) = self.passes(first, offsets) else { continue };
            let codes = [u.start, u.end].map(|u| self.code + u / self.u_per_code);
            let codes = [codes[0] as u16, codes[1].ceil() as u16];
            let block = by * bounds.across + bx;
            if bounds.range[block].1 < codes[0] {
                continue;
            }
            for (layer, (planes, bits)) in
                layers.iter().zip(&bounds.occupied[block * bounds.layers..][..bounds.layers]).enumerate()
            {
                let from = if layer == self.layer { codes[0].max(self.hiding) } else { codes[0] };
                if from > codes[1] || !any_bin(bits, usize::from(from >> 8), usize::from(codes[1] >> 8)) {
                    continue;
                }
                let [columns, rows] = [0, 1].map(|i| {
                    let touched = touched(i, u.clone());
                    first[i].max(*touched.start())..=(first[i] + BLOCK as i32 - 1).min(*touched.end())
                });
                // Rows are looked at whole, which compiles to a few instructions.
                let within = columns.fold(0, |bits, x| bits | 1 << (x - first[0]));
                for y in rows {
                    let start = y as usize * padding.stride + first[0] as usize;
                    let row = |codes: &'a [u16]| -> &'a [u16; BLOCK] {
                        codes[start..].first_chunk().expect("a row has whole blocks")
                    };
                    let d = [first[0] - self.place[0], y - self.place[1]];
                    let spans = [row(&planes.lo), row(&planes.hi)];
                    let mut near = within & self.near(spans, d, [from, codes[1]], offsets);
                    if near == 0 {
                        continue;
                    }
                    let own = &layers[self.layer];
                    let own = (layer != self.layer).then(|| [row(&own.lo), row(&own.hi)]);
                    if planes.role == Role::Surface {
                        near &= !self.of_own_surface(spans[0], own, d);
                    }
                    while near != 0 {
                        let x = near.trailing_zeros();
                        near &= near - 1;
                        let index = start + x as usize;
                        let (lo, hi) = (planes.lo[index], planes.hi[index]);
                        let d = [d[0] + x as i32, d[1]];
                        self.shade(&Cell { index, layer, d, lo, hi }, offsets, hidden);
                    }
                }
            }
        }
    }

    /// Which cells of a row are near some of the beams with these offsets, and have one of these codes. The first
    /// cell is at the offset `d`.
    #[inline(always)]
    fn near(
        &self,
        [lo, hi]: [&[u16; BLOCK]; 2],
        d: [i32; 2],
        codes: [u16; 2],
        offsets: &[[i32; 2]; 2],
    ) -> u32 {
        let mut near = 0;
        // The `u` at which an offset is the least, and at which it is the greatest, over a cell's span.
        let [[left, right], [above, below]] =
            offsets.map(|[least, greatest]| [least as f32, greatest as f32]);
        let (dx, dy) = (d[0] as f32, d[1] as f32);
        for i in 0..BLOCK {
            let u = [lo[i], hi[i]].map(|code| greater(f32::from(code) - self.code, 0.0) * self.u_per_code);
            let first = |e: f32| if e < 0.0 { u[1] * e } else { u[0] * e };
            let last = |e: f32| if e < 0.0 { u[0] * e } else { u[1] * e };
            let x = dx + i as f32;
            // Where beams are farther apart than cells, most cells lie between them. The beam that is nearest in the middle
            // of the span is off by no more than a pixel and what the span moves a beam.
            let middle = greater(0.5 * (u[0] + u[1]), TINY);
            let half = 0.5 * (u[1] - u[0]) / greater(u[0], TINY);
            let is_between = |d: f32| {
                let beam = middle * nearest_integer(d / middle);
                (beam - d).abs() > 1.0 + SLACK + half * (d.abs() + 1.0)
            };
            let is_near = (lo[i] <= codes[1])
                & !is_between(x)
                & !is_between(dy)
                & (hi[i] >= codes[0])
                & (x + 1.0 >= first(left))
                & (x - 1.0 <= last(right))
                & (dy + 1.0 >= first(above))
                & (dy - 1.0 <= last(below));
            near |= u32::from(is_near) << i;
        }
        near
    }

    /// Which cells of a row certainly let all light through, as [`Shadows::let_through`] finds it. For another layer than
    /// the highlight's, `own` has the spans of the highlight's layer. The first cell is at the offset `d`.
    #[inline(always)]
    fn of_own_surface(&self, lo: &[u16; BLOCK], own: Option<[&[u16; BLOCK]; 2]>, d: [i32; 2]) -> u32 {
        let px_per_code = self.padded.codes.step() as f32;
        let [farthest, nearest] = self.cluster.span.map(f32::from);
        let mut through = 0;
        for i in 0..BLOCK {
            // Cells are as many steps away as along their longer axis, or along the shorter one if that is one less.
            let steps = (d[0] + i as i32).abs().max(d[1].abs()) as f32;
            let gap_px = px_per_code * (f32::from(lo[i]) - nearest);
            let is_nearer = gap_px - self.own_span_px * (steps - 1.0) <= SAME_SURFACE_PX;
            through |= u32::from(is_nearer) << i;
        }
        let Some([lo, hi]) = own else { return through };
        let mut has_own = 0;
        for i in 0..BLOCK {
            let steps = (d[0] + i as i32).abs().max(d[1].abs()) as f32;
            let gap_px = px_per_code * greater(f32::from(lo[i]) - nearest, farthest - f32::from(hi[i]));
            has_own |= u32::from(gap_px - self.own_span_px * steps < OTHER_SURFACE_PX) << i;
        }
        through & !has_own
    }

    /// Where beams with these offsets pass the block of cells that begins at `first`: from which `u` to which.
    fn passes(&self, first: [i32; 2], offsets: &[[i32; 2]; 2]) -> Option<Range<f32>> {
        let mut u = 0.0..self.u_max;
        for i in 0..2 {
            let d = [first[i] - 1, first[i] + BLOCK as i32].map(|cell| (cell - self.place[i]) as f32);
            // Some beam is there as soon as `u` times the least offset is not beyond the block, and `u` times the
            // greatest not before it.
            for (e, end, beyond) in [(offsets[i][0], d[1], 1.0), (offsets[i][1], d[0], -1.0)] {
                let (e, end) = (beyond * e as f32, beyond * end);
                if e > 0.0 {
                    u.end = u.end.min(end / e);
                } else if e < 0.0 {
                    u.start = u.start.max(end / e);
                } else if end < 0.0 {
                    return None;
                }
            }
        }
        (u.start <= u.end).then_some(u)
    }

    /// Adds what a cell hides of the beams of the pixels at these offsets.
    #[inline(always)]
    fn shade(&self, cell: &Cell, offsets: &[[i32; 2]; 2], hidden: &mut Hidden) {
        if self.is_behind(cell) {
            return;
        }
        // Beams go by one cell at a time along their longer axis, so that a cell is as far away as it is along that axis.
        for longer in 0..2 {
            let steps = cell.d[longer].abs();
            if cell.d[1 - longer].abs() <= steps + 1 {
                let opaque = 1.0 - self.let_through(cell, steps as f32);
                if opaque > 0.0 {
                    self.shade_along(cell, longer, opaque, offsets, hidden);
                }
            }
        }
    }

    /// Adds what a cell, which stops the part `opaque` of the light, hides of beams that are longer along one axis.
    ///
    /// Where the beam passes the cell's column or row, it is in the middle of the cell's span of depth or as near to that
    /// as the span allows. Beams between two cells are hidden by each in part, by the cell that they are nearer to in
    /// the greater part.
    #[inline(always)]
    fn shade_along(
        &self,
        cell: &Cell,
        longer: usize,
        opaque: f32,
        offsets: &[[i32; 2]; 2],
        hidden: &mut Hidden,
    ) {
        let shorter = 1 - longer;
        let (steps, aside) = (cell.d[longer].abs() as f32, cell.d[shorter] as f32);
        let u = [cell.lo, cell.hi].map(|code| (f32::from(code) - self.code).max(0.0) * self.u_per_code);
        let partial = &self.padded.layers[cell.layer].partial;
        for side in [-1, 1] {
            if side * cell.d[longer] < 0 {
                continue;
            }
            // Offsets along the longer axis, counted away from the highlight, for which the beam comes within a pixel.
            let there = offsets[longer].map(|e| side * e);
            // The beam of the highlight's own pixel belongs to one side alone.
            let nearest = if side > 0 { 0.0 } else { 1.0 };
            let least =
                ((steps - 1.0) / u[1].max(TINY)).floor().max(there[0].min(there[1]) as f32).max(nearest);
            let most = ((steps + 1.0) / u[0].max(TINY)).ceil().min(there[0].max(there[1]) as f32);
            for e in least as i32..=most as i32 {
                let away = e as f32;
                // As far as the beam has come along the longer axis.
                let come = steps.max(u[0] * away).min(u[1] * away);
                let share = 1.0 - (come - steps).abs();
                if share <= 0.0 {
                    continue;
                }
                // The steps that the beam takes along the shorter axis in all, to come within a pixel of the cell.
                let scale = come / away.max(1.0);
                if scale <= TINY && aside != 0.0 {
                    continue;
                }
                let [first, last] = [aside - 1.0, aside + 1.0].map(|d| d / scale.max(TINY));
                let (first, last) = (first.ceil(), last.floor());
                // Where both axes are as long, it is the first that counts.
                let longest = if longer == 0 { away } else { away - 1.0 };
                let first = first.max(-longest).max(offsets[shorter][0] as f32) as i32;
                let last = last.min(longest).min(offsets[shorter][1] as f32) as i32;
                for f in first..=last {
                    let beside = scale * f as f32 - aside;
                    let share = share * (1.0 - beside.abs()).max(0.0);
                    let mut at = [beside; 2];
                    at[longer] = side as f32 * (come - steps);
                    let mut pixel = [self.sign * f; 2];
                    pixel[longer] = self.sign * side * e;
                    let [x, y] = [0, 1].map(|i| (self.in_tile[i] + pixel[i]) as usize);
                    hidden[y * TILE.0 + x] += share * opaque * partial.covered(cell.index, at);
                }
            }
        }
    }

    /// Whether a cell is behind the highlight. Of two cells of one pixel, the one in the earlier layer is in front where
    /// their depths meet.
    fn is_behind(&self, cell: &Cell) -> bool {
        if cell.d != [0, 0] {
            return f32::from(cell.hi) < self.code;
        }
        match cell.layer.cmp(&self.layer) {
            Ordering::Less => f32::from(cell.hi) < self.code,
            Ordering::Equal => true,
            Ordering::Greater => f32::from(cell.lo) <= self.code,
        }
    }

    /// The part of the light that a cell so many steps away lets through: it is of the highlight's surface.
    fn let_through(&self, cell: &Cell, steps: f32) -> f32 {
        if cell.d == [0, 0] || self.padded.layers[cell.layer].role == Role::Holdout {
            return 0.0;
        }
        let nearer = self.is_same_surface([cell.lo, u16::MAX], steps);
        if cell.layer == self.layer {
            return nearer;
        }
        // The cluster's surface goes on in another layer where its own layer has another surface.
        let own = &self.padded.layers[self.layer];
        nearer * (1.0 - self.is_same_surface([own.lo[cell.index], own.hi[cell.index]], steps))
    }

    /// How much a cell of this span, so many steps away, is of the highlight's surface.
    fn is_same_surface(&self, [lo, hi]: [u16; 2], steps: f32) -> f32 {
        let [farthest, nearest] = self.cluster.span;
        let gap = lo.saturating_sub(nearest).max(farthest.saturating_sub(hi));
        same_surface(self.padded.codes.step() as f32 * f32::from(gap), self.own_span_px, steps)
    }
}
