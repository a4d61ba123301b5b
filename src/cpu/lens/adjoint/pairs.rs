//! Pairs of neighbouring pixels that meet two surfaces, or one in cells that are not beside each other: what they change with
//! the shifts of cells. See [`gather`](super::gather).

use super::around::{Around, is_one_surface};
use super::met::Met;
use super::views::{Views, of_share};
use super::window::Region;
use crate::cpu::lens::padded::Padded;
use crate::scene::grid::TILE;

/// Two pixels beside each other along an axis, and what they have met through the lens point of a rank.
pub struct Pair {
    pub pixels: [usize; 2],
    pub mets: [Met; 2],
    /// Where that is around the tile.
    pub at: [usize; 2],
    pub axis: usize,
    pub rank: usize,
}

/// What a function gives for both of a pair.
#[inline(always)]
pub fn both<T>(of: impl Fn(usize) -> T) -> [T; 2] {
    [of(0), of(1)]
}

/// Adds to the cells around a tile what pairs change.
pub struct OfPairs<'a, const C: usize> {
    pub padded: &'a Padded,
    pub around: &'a mut Around,
    pub views: &'a Views,
}

impl<const C: usize> OfPairs<'_, C> {
    /// Adds what the pairs change that wait.
    pub fn add(&mut self, pairs: &mut Vec<Pair>) {
        pairs.drain(..).for_each(|pair| self.add_pair(&pair));
    }

    /// Adds what two pixels change, which meet two surfaces, or one in cells that are not beside each other: the pixel across
    /// which the border lies takes the difference between both.
    #[inline(always)]
    fn add_pair(&mut self, pair: &Pair) {
        let &Pair { pixels, mets, at, axis, rank } = pair;
        let [a, b] = both(|k| mets[k].away());
        let layers = both(|k| &self.around.layers[mets[k].layer()]);
        let [span_a, span_b] = both(|k| layers[k].span[at[k]]);
        // From the one cell to the other. A surface that is seen from the side may show every other cell only, or fewer. It rises
        // by a cell's span from cell to cell.
        let step = both(|along| b[along] - a[along] + i32::from(along == axis));
        let between = (step[0].abs().max(step[1].abs()) - 1).max(0) as u32;
        let is_one = is_one_surface(span_a, span_b, between);
        // Of two surfaces, the rim of the nearer one moves.
        let lens = &self.views.lens[rank];
        let k = usize::from(if is_one { lens[0][axis] > 0.0 } else { span_a.1 <= span_b.1 });
        let layer = layers[k];
        let rim = if is_one { Rim::beside(at[k]) } else { self.rim(mets[k], at[k], (axis, k)) };
        let (lo, hi) = layer.span[rim.at];
        let middle = layer.codes.shift(0.5 * (f32::from(lo) + f32::from(hi)));
        let along = lens[usize::from(middle > 0.0)][axis];
        let is_bottom = !is_one && (rim.is_cut || along * SIGNS[k] > 0.0);
        let t = layer.codes.shift(f32::from(if is_bottom { lo } else { hi }));
        // How far the first of both pixels reaches beyond the border.
        let reach = along * t - mets[k].away()[axis] as f32 - rim.beyond;
        let across = pixels[usize::from(reach <= 0.0)];
        let given = self.views.of_pixel(of_share(across));
        let [before, behind] = both(|k| layers[k].color[at[k]]);
        let mut dot = 0.0;
        for c in 0..C {
            dot += given[c] * (behind[c] - before[c]);
        }
        let (place, side) = [(across % TILE.0, TILE.0), (across / TILE.0, TILE.1)][axis];
        let is_alone = !is_one && (place == 0 || place + 1 == side);
        let times = if is_alone { times_of_unseen(reach) } else { 1.0 };
        let sums = self.around.layers[mets[k].layer()].sums.as_mut().expect("the layer is met");
        let sum = if is_bottom { &mut sums.by_bottom } else { &mut sums.by_top };
        sum.plane_mut(0)[rim.at] += times * along * dot;
    }

    /// The rim behind the cell that is met by the first of two pixels (`k` is 0) or the second.
    #[inline(always)]
    fn rim(&self, met: Met, at: usize, (axis, k): (usize, usize)) -> Rim {
        let Region { stride, .. } = self.around.region;
        let (apart, sign) = ([1, stride][axis], SIGNS[k]);
        let span = &self.around.layers[met.layer()].span;
        let next = if k == 0 { at + apart } else { at - apart };
        // A cell that is covered in part may be passed by.
        let of_next = self.covered(met.layer(), next, (axis, sign));
        if of_next < 1.0 && span[next].1 > 0 && is_one_surface(span[at], span[next], 0) {
            return Rim { at: next, beyond: sign * of_next, is_cut: true };
        }
        let covered = self.covered(met.layer(), at, (axis, sign));
        Rim { at, beyond: sign * (covered - 1.0), is_cut: covered < 1.0 }
    }

    /// How much of a cell is covered along the line through its middle in the direction of an axis, if it is covered where the
    /// line begins; else 1.
    #[inline(always)]
    fn covered(&self, layer: usize, at: usize, (axis, sign): (usize, f32)) -> f32 {
        let Around { region, .. } = &*self.around;
        let (padding, partial) = (&self.padded.padding, &self.padded.layers[layer].partial);
        let cell = region.padded_row(padding, at / region.stride) + at % region.stride;
        partial.line(cell).map_or(1.0, |(normal, cut)| {
            let n = sign * normal[axis];
            if n > 0.0 { (0.5 + cut / n).clamp(0.0, 1.0) } else { 1.0 }
        })
    }
}

/// The direction in which a surface ends that the first of two pixels meets, or the second.
const SIGNS: [f32; 2] = [1.0, -1.0];

/// How often a rim counts that lies across a pixel at the side of a tile.
///
/// Rays start at all places in a pixel. Where they start in front of the rim, it is between this pixel and the next one, and else
/// between this one and that before it. One of both pairs is not looked at. The other one has the rim for a part of the places,
/// by how near the rim is to the side on which it is: one less the `reach` of a pixel beyond it. So it stands for one over this
/// many. An oblique rim is at another place where the ray starts than in the middle of the row, up to half a pixel away: a quarter
/// is the least part for which those at 45 degrees count for one on average, and those along the side for an eighth less.
fn times_of_unseen(reach: f32) -> f32 {
    1.0 / (1.0 - reach.abs()).max(0.25)
}

/// Where a surface ends between two pixels.
struct Rim {
    /// The last cell of the surface.
    at: usize,
    /// How far it ends beyond the border of the cell that is met, along the axis.
    beyond: f32,
    /// Whether it ends inside the cell. Of what such a cell covers it is asked where a ray passes its bottom.
    is_cut: bool,
}

impl Rim {
    /// Behind a cell that is met.
    fn beside(at: usize) -> Rim {
        Rim { at, beyond: 0.0, is_cut: false }
    }
}
