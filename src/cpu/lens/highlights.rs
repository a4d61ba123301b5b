//! Highlights, drawn as exact discs of which a part is visible.

use super::group::Group;
use super::padded::Padded;
use super::shadows::{Hidden, Pixels, Shadows};
use super::tile_color::TileColor;
use crate::plan::lens::disc::APART;
use crate::plan::lens::highlights::{Cluster, Highlights};
use crate::plan::lens::kernels::Kernels;
use crate::plan::lens::optical_vignetting::PupilClip;
use crate::plan::lens::tiles::Tile;
use crate::rows::with_channels;
use crate::scene::grid::TILE;
use crate::simd::Simd;

/// The input for drawing highlights.
pub struct HighlightPass<'a> {
    pub highlights: &'a Highlights,
    pub padded: &'a Padded,
    pub kernels: &'a Kernels,
    pub clip: Option<&'a PupilClip>,
    pub simd: Simd,
}

/// The light of discs in a tile, as differences between neighbouring pixels: a run of pixels is two numbers. Sums of
/// many lights that begin and end elsewhere need `f64`.
#[derive(Default)]
struct Differences {
    /// For each channel and row, one more value than a tile has columns.
    values: Vec<f64>,
    /// For each row, the columns that have light.
    columns: [(usize, usize); TILE.1],
}

impl Differences {
    const ROW: usize = TILE.0 + 1;

    fn clear(&mut self, channels: usize) {
        self.values.clear();
        self.values.resize(channels * TILE.1 * Self::ROW, 0.0);
        self.columns = [(TILE.0, 0); TILE.1];
    }

    /// Adds light to the columns `first .. end` of a row.
    fn add(&mut self, y: usize, (first, end): (i32, i32), weight: f64, light: &[f32; 4]) {
        let [first, end] = [first, end].map(|x| x.clamp(0, TILE.0 as i32) as usize);
        if first < end {
            let columns = &mut self.columns[y];
            *columns = (columns.0.min(first), columns.1.max(end));
            for (plane, light) in self.values.chunks_exact_mut(TILE.1 * Self::ROW).zip(light) {
                let added = weight * f64::from(*light);
                plane[y * Self::ROW + first] += added;
                plane[y * Self::ROW + end] -= added;
            }
        }
    }

    /// The pixels that may have light.
    fn lit(&self) -> Option<Pixels> {
        let rows = || self.columns.iter().enumerate().filter(|(_, columns)| columns.0 < columns.1);
        let (first, last) = (rows().next()?.0, rows().next_back()?.0);
        let columns = rows().map(|(_, &columns)| columns);
        let columns = columns.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        Some([columns.0 as i32..columns.1 as i32, first as i32..last as i32 + 1])
    }

    /// Adds the part of the light that is visible from each pixel of a tile to its picture.
    fn add_to<const C: usize>(&self, out: &mut TileColor, visible: impl Fn(usize) -> f64) {
        for (y, &(first, end)) in self.columns.iter().enumerate() {
            let mut sum = [0.0; C];
            for x in first..end {
                for (c, sum) in sum.iter_mut().enumerate() {
                    *sum += self.values[(c * TILE.1 + y) * Self::ROW + x];
                }
                let at = y * TILE.0 + x;
                let visible = visible(at);
                for (plane, light) in out.planes.iter_mut().zip(sum) {
                    plane[at] += (visible * light) as f32;
                }
            }
        }
    }
}

/// What a worker keeps from tile to tile.
pub struct Scratch {
    differences: Differences,
    hidden: Box<Hidden>,
}

impl Default for Scratch {
    fn default() -> Scratch {
        Scratch { differences: Differences::default(), hidden: Box::new([0.0; TILE.0 * TILE.1]) }
    }
}

impl HighlightPass<'_> {
    /// Draws all highlights that reach a tile, which has the number `number`, into the picture of each group. What hides
    /// them is found once for all.
    pub fn draw(
        &self,
        number: usize,
        tile: &Tile,
        groups: &[Group],
        Scratch { differences, hidden }: &mut Scratch,
        out: &mut [TileColor],
    ) {
        let clusters = || self.highlights.of_tile(number);
        if clusters().next().is_none() {
            return;
        }
        for (group, out) in groups.iter().zip(&mut *out).filter(|(group, _)| group.lights > 0) {
            differences.clear(group.lights);
            for cluster in clusters().filter(|cluster| !cluster.hidden_in_part) {
                self.add_discs(cluster, tile, group, differences);
            }
            with_channels!(group.lights, C => differences.add_to::<C>(out, |_| 1.0));
        }
        for cluster in clusters().filter(|cluster| cluster.hidden_in_part) {
            let mut is_cast = false;
            for (group, out) in groups.iter().zip(&mut *out).filter(|(group, _)| group.lights > 0) {
                differences.clear(group.lights);
                self.add_discs(cluster, tile, group, differences);
                let Some(lit) = differences.lit() else { break };
                if !is_cast {
                    let middle = &self.highlights.all[cluster.middle];
                    hidden.fill(0.0);
                    let shadows = Shadows::new(cluster, middle, tile.origin, self.padded);
                    self.simd.run(
                        #[inline(always)]
                        || shadows.cast(&lit, hidden),
                    );
                    is_cast = true;
                }
                let visible = |at: usize| f64::from((1.0 - hidden[at]).max(0.0));
                with_channels!(group.lights, C => differences.add_to::<C>(out, visible));
            }
        }
    }

    /// Adds the rows of a cluster's discs that are inside a tile, in the channels of a group.
    fn add_discs(&self, cluster: &Cluster, tile: &Tile, group: &Group, differences: &mut Differences) {
        for number in cluster.members.clone() {
            let light = &group.excess[number];
            for Disc { step, share } in self.discs(number, tile) {
                self.visit_disc(number, step, share, tile.origin, |y, columns, weight| {
                    differences.add(y, columns, weight, light);
                });
            }
        }
    }

    /// The discs of the highlight of this number, with the parts of its light that they have in a tile.
    pub fn discs(&self, number: usize, tile: &Tile) -> impl Iterator<Item = Disc> + use<> {
        let highlight = &self.highlights.all[number];
        let drawn = (1.0 - highlight.aberrated) * highlight.drawn_in(tile);
        highlight
            .discs()
            .filter(move |_| drawn > 0.0)
            .map(move |(step, share)| Disc { step, share: drawn * share })
    }

    /// Visits the rows of one disc, of the highlight of this number, that are inside the tile at `origin`: the row of the
    /// tile, columns, and the weight of the light there.
    pub fn visit_disc(
        &self,
        number: usize,
        step: i32,
        share: f32,
        origin: (usize, usize),
        mut visit: impl FnMut(usize, (i32, i32), f64),
    ) {
        let highlight = &self.highlights.all[number];
        let kernel = self.kernels.get(step * APART);
        // The highlight in the tile's coordinates. A pixel p sees it at the offset q - p of the kernel.
        let (qx, qy) = (highlight.x - origin.0 as i32, highlight.y - origin.1 as i32);
        // Rows are in the order of dy.
        let first = kernel.rows.partition_point(|row| qy - row.dy >= TILE.1 as i32);
        for row in kernel.rows[first..].iter().take_while(|row| qy - row.dy >= 0) {
            let y = (qy - row.dy) as usize;
            let mut add = |columns: (i32, i32), weight: f32| {
                let weight = f64::from(share) * f64::from(weight);
                let Some(clip) = self.clip else {
                    return visit(y, columns, weight);
                };
                for x in columns.0.max(0)..columns.1.min(TILE.0 as i32) {
                    let l = [qx - x, row.dy].map(|d| f64::from(d) / highlight.t);
                    let place = [origin.0 as f64 + f64::from(x), (origin.1 + y) as f64];
                    let seen = clip.share(place, l, highlight.t);
                    visit(y, (x, x + 1), weight * seen);
                }
            };
            add((qx - row.run.1 + 1, qx - row.run.0 + 1), kernel.run_weight);
            for &(dx, weight) in &row.partial {
                add((qx - dx, qx - dx + 1), weight);
            }
        }
    }
}

/// One of the discs between which that of a highlight lies, and its share of the light.
pub struct Disc {
    pub step: i32,
    pub share: f32,
}
