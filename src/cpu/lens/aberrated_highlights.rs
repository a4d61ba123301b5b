//! Highlights through a lens with transverse aberrations: images of points, each for its place in the frame.
//!
//! All of them are added up for the whole frame before its tiles are rendered. What hides a part of a cluster is found
//! for each cell of the opening.

use super::frame::Frame;
use super::group::Group;
use super::shadows::{Hidden, Shadows};
use super::tile_color::TileColor;
use crate::error::Result;
use crate::plan::lens::aberrated::Aberrated;
use crate::plan::lens::disc::APART;
use crate::plan::lens::highlights::{Cluster, Highlight};
use crate::plan::lens::kernels;
use crate::plan::lens::point_image::{Cells, PointImage};
use crate::plan::lens::tiles::Tile;
use crate::rows::bands;
use crate::scene::grid::TILE;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Clusters whose images are at hand at the same time: it bounds their memory.
const AT_ONCE: usize = 64;
/// Rows of a frame to which a worker adds images.
const ROWS: usize = 16;

/// The light of a frame's aberrated highlights in the channels of each group that holds light.
pub struct AberratedLight {
    size: (usize, usize),
    groups: Vec<Planes>,
}

/// Planes of the frame: of the light that tiles draw that are swept, and of all of it.
struct Planes {
    /// By channel; the second of each is the whole light.
    of_channels: Vec<[Vec<f32>; 2]>,
}

/// An image of which members of a cluster have shares.
struct Image<'a> {
    cluster: &'a Cluster,
    of: Of,
    of_point: PointImage,
}

/// What an image is of.
#[derive(Debug, Clone, Copy)]
enum Of {
    /// A shift that all members have.
    Shift,
    /// A radius step.
    Step(i32),
}

impl Of {
    /// The share that a highlight has of the image.
    fn share(self, h: &Highlight) -> f32 {
        match self {
            Of::Shift => 1.0,
            Of::Step(step) => h.discs().filter(|(own, _)| *own == step).map(|(_, share)| share).sum(),
        }
    }
}

/// The parts of a cluster's light that the cells of the opening do not let through.
struct Shade {
    radius: i32,
    /// By row and column; `None` if nothing is hidden.
    hidden: Option<Vec<f32>>,
}

impl Shade {
    fn new(frame: &Frame, cluster: &Cluster, middle: &Highlight, radius: i32) -> Shade {
        if !cluster.hidden_in_part {
            return Shade { radius, hidden: None };
        }
        let across = (2 * radius + 1) as usize;
        let mut all = vec![0.0; across * across];
        let mut tile: Box<Hidden> = Box::new([0.0; TILE.0 * TILE.1]);
        for (y0, x0) in
            (0..across).step_by(TILE.1).flat_map(|y| (0..across).step_by(TILE.0).map(move |x| (y, x)))
        {
            let (columns, rows) = (TILE.0.min(across - x0), TILE.1.min(across - y0));
            let in_tile = [x0, y0].map(|first| radius - first as i32);
            let shadows = Shadows::on_opening(cluster, middle, radius, in_tile, &frame.padded);
            tile.fill(0.0);
            frame.simd.run(
                #[inline(always)]
                || shadows.cast(&[0..columns as i32, 0..rows as i32], &mut tile),
            );
            for (y, row) in tile.chunks_exact(TILE.0).take(rows).enumerate() {
                all[(y0 + y) * across + x0..][..columns].copy_from_slice(&row[..columns]);
            }
        }
        Shade { radius, hidden: Some(all) }
    }

    /// The part of the light that is visible through a lens point.
    fn visible(&self, l: [f64; 2]) -> f64 {
        let Some(hidden) = &self.hidden else { return 1.0 };
        let last = 2 * self.radius as usize;
        let [(x, fx), (y, fy)] = l.map(|v| {
            let at = ((v + 1.0) * f64::from(self.radius)).clamp(0.0, last as f64);
            let first = (at as usize).min(last - 1);
            (first, at - first as f64)
        });
        let at = |x: usize, y: usize| (1.0 - f64::from(hidden[y * (last + 1) + x])).max(0.0);
        let row = |y: usize| at(x, y) + fx * (at(x + 1, y) - at(x, y));
        row(y) + fy * (row(y + 1) - row(y))
    }
}

impl AberratedLight {
    /// The light; `None` if no highlight is aberrated.
    pub fn new(frame: &Frame, groups: &[Group]) -> Result<Option<AberratedLight>> {
        let highlights = &frame.highlights;
        let of_cluster = |cluster: &Cluster| &highlights.all[cluster.members.clone()];
        let is_aberrated = |cluster: &&Cluster| of_cluster(cluster).iter().any(|h| h.aberrated > 0.0);
        let clusters: Vec<&Cluster> = highlights.clusters.iter().filter(is_aberrated).collect();
        let Some(lens) = frame.aberrated.as_ref().filter(|_| !clusters.is_empty()) else { return Ok(None) };
        let radius = |cluster: &Cluster| {
            let largest = of_cluster(cluster).iter().map(|h| h.radius_px).fold(0.0, f64::max);
            Cells::radius_for(largest)
        };
        let radii: BTreeSet<i32> = clusters.iter().map(|cluster| radius(cluster)).collect();
        let cells: BTreeMap<i32, Cells> =
            radii.into_iter().map(|radius| (radius, Cells::new(lens.aperture(), radius))).collect();
        let size = (frame.scene.size.width, frame.scene.size.height);
        let planes = |group: &Group| {
            let plane = || vec![0.0; size.0 * size.1];
            Planes { of_channels: (0..group.lights).map(|_| [plane(), plane()]).collect() }
        };
        let mut light = AberratedLight { size, groups: groups.iter().map(planes).collect() };
        for clusters in clusters.chunks(AT_ONCE) {
            frame.cancel.check()?;
            let images: Vec<Vec<Image>> = clusters
                .par_iter()
                .map(|cluster| images(frame, lens, cluster, &cells[&radius(cluster)]))
                .collect();
            let images: Vec<Image> = images.into_iter().flatten().collect();
            light.add(frame, groups, &images);
        }
        Ok(Some(light))
    }

    /// Adds images to the frame, in their order.
    fn add(&mut self, frame: &Frame, groups: &[Group], images: &[Image]) {
        let width = self.size.0;
        for (group, planes) in groups.iter().zip(&mut self.groups) {
            let planes = planes.of_channels.iter_mut().flatten().map(|plane| &mut plane[..]);
            bands(planes, ROWS * width).into_par_iter().enumerate().for_each(|(i, mut band)| {
                for image in images {
                    for number in image.cluster.members.clone() {
                        let h = &frame.highlights.all[number];
                        add_image(h, &group.excess[number], image, (i * ROWS, width), &mut band);
                    }
                }
            });
        }
    }

    /// Adds the light to a tile.
    pub fn add_to(&self, tile: &Tile, out: &mut [TileColor]) {
        let (swept, whole) = (1.0 - tile.disc_share() - tile.share_in_focus(), tile.disc_share());
        let (width, height) = self.size;
        let (x0, y0) = tile.origin;
        let columns = TILE.0.min(width - x0);
        for (planes, out) in self.groups.iter().zip(out) {
            for ([drawn, all], out) in planes.of_channels.iter().zip(&mut out.planes) {
                for y in 0..TILE.1.min(height - y0) {
                    let at = (y0 + y) * width + x0;
                    let light = drawn[at..][..columns].iter().zip(&all[at..][..columns]);
                    let row = &mut out[y * TILE.0..][..columns];
                    row.iter_mut()
                        .zip(light)
                        .for_each(|(out, (drawn, all))| *out += swept * drawn + whole * all);
                }
            }
        }
    }
}

/// Adds the image of a highlight to a band of rows, `(first, width)`.
fn add_image(
    h: &Highlight,
    excess: &[f32; 4],
    image: &Image,
    (first, width): (usize, usize),
    band: &mut [&mut [f32]],
) {
    let share = image.of.share(h) * h.aberrated;
    if share == 0.0 {
        return;
    }
    let rows = band[0].len() / width;
    let x = h.x + image.of_point.first[0];
    for (dy, light) in image.of_point.rows() {
        let y = h.y + dy - first as i32;
        if !(0..rows as i32).contains(&y) {
            continue;
        }
        let skipped = (-x).max(0) as usize;
        let start = x.max(0) as usize;
        let columns = light.len().saturating_sub(skipped).min(width.saturating_sub(start));
        let light = &light[skipped.min(light.len())..][..columns];
        for (channel, excess) in band.chunks_exact_mut(2).zip(excess) {
            for (plane, part) in channel.iter_mut().zip([h.drawn, 1.0]) {
                let row = &mut plane[y as usize * width + start.min(width)..][..columns];
                row.iter_mut().zip(light).for_each(|(out, light)| *out += share * part * excess * light);
            }
        }
    }
}

/// The images of a cluster: one if its members have one shift, or one for each of their radius steps.
fn images<'a>(frame: &Frame, lens: &Aberrated, cluster: &'a Cluster, cells: &Cells) -> Vec<Image<'a>> {
    let middle = &frame.highlights.all[cluster.middle];
    let members = || frame.highlights.all[cluster.members.clone()].iter().filter(|h| h.aberrated > 0.0);
    let steps: BTreeSet<i32> = members().flat_map(|h| h.discs().map(|(step, _)| step)).collect();
    let at = [f64::from(middle.x), f64::from(middle.y)];
    let place = lens.at(at);
    let shade = Shade::new(frame, cluster, middle, cells.radius);
    let clip = frame.clip.as_ref().map(|clip| (clip, at));
    let image = |of: Of, t: f64| Image {
        cluster,
        of,
        of_point: PointImage::new(&place, cells, t, clip, |l| shade.visible(l)),
    };
    if members().all(|h| h.t == middle.t) {
        return vec![image(Of::Shift, middle.t)];
    }
    steps.into_iter().map(|step| image(Of::Step(step), kernels::shift(step * APART))).collect()
}
