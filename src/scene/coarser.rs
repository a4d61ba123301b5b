//! The scene at half the size, for what is blurred so widely that it has nothing finer to say.
//!
//! Four cells become one. Where they are one surface, it is their mean. Where a surface ends among them, its part becomes
//! a cell that covers its pixel in part, and what is seen beside it becomes the cell behind: the light of the pinhole's
//! picture, and the area of the surface in front, stay what they are.

use super::colors::{CellColor, Colors};
use super::edges::{self, CONNECTED_PX};
use super::half_plane::{self, HalfPlane};
use super::layer::{Role, SceneLayer, Surfaces};
use super::layered::LayeredScene;
use crate::memory::Buffer;
use crate::mirror::mirrored;
use crate::picture::Size;
use crate::rows::bands;
use crate::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Cells along each axis that become one.
const SIDE: usize = 2;
/// In the units of the finer scene: up to this difference of shifts, what becomes one cell is one surface.
const ONE_SURFACE_PX: f32 = SIDE as f32 * CONNECTED_PX;
/// Parts of a block that nobody sees beside the surface in front of it.
const UNSEEN: f32 = 1e-6;

/// A scene at half the size, and how its colours follow from those of the finer one.
pub struct Coarser {
    /// The cells, without colours.
    pub scene: LayeredScene,
    finer: Size,
    /// The cells of each layer that are not the mean of four cells of the first one.
    mixed: [Mixed; 2],
}

/// Cells of the coarser scene, made of some cells of the finer one.
#[derive(Default)]
struct Mixed {
    /// The index of each, and where its parts end.
    cells: Vec<(u32, u32)>,
    parts: Vec<Part>,
}

impl Mixed {
    fn push(&mut self, index: usize, parts: &[Part]) {
        self.parts.extend(parts);
        self.cells.push((index as u32, self.parts.len() as u32));
    }

    fn append(&mut self, other: &Mixed) {
        let first = self.parts.len() as u32;
        self.parts.extend(&other.parts);
        self.cells.extend(other.cells.iter().map(|(index, end)| (*index, first + end)));
    }

    /// The index of cell number `i`, and its parts.
    fn get(&self, i: usize) -> (usize, &[Part]) {
        let start = i.checked_sub(1).map_or(0, |before| self.cells[before].1);
        let (index, end) = self.cells[i];
        (index as usize, &self.parts[start as usize..end as usize])
    }
}

/// A part of a coarser cell: a cell of the finer scene, and its share.
#[derive(Clone, Copy)]
struct Part {
    layer: u8,
    index: u32,
    share: f32,
}

impl Part {
    fn shift(&self, layers: &[SceneLayer]) -> f32 {
        layers[usize::from(self.layer)].s[self.index as usize]
    }
}

/// A surface of a block.
struct SurfaceOf {
    s: f32,
    parts: Vec<Part>,
}

impl SurfaceOf {
    /// The surface of some parts and their weights; `None` if nothing is seen of it.
    ///
    /// Its shift is the mean of those that are on one surface with the weighted median: no shift lies between two surfaces,
    /// where nothing is.
    fn new(layers: &[SceneLayer], mut parts: Vec<Part>) -> Option<SurfaceOf> {
        let sum: f32 = parts.iter().map(|part| part.share).sum();
        if sum <= UNSEEN {
            return None;
        }
        parts.retain(|part| part.share > 0.0);
        parts.iter_mut().for_each(|part| part.share /= sum);
        let s = |part: &Part| part.shift(layers);
        parts.sort_by(|a, b| s(a).total_cmp(&s(b)));
        let mut before = 0.0;
        let reaches_half = |part: &&Part| {
            before += part.share;
            before >= 0.5
        };
        let median = s(parts.iter().find(reaches_half).unwrap_or(&parts[0]));
        let on_it = parts.iter().filter(|part| (s(part) - median).abs() < ONE_SURFACE_PX);
        let (sum, share) =
            on_it.fold((0.0, 0.0), |(sum, all), part| (sum + part.share * s(part), all + part.share));
        Some(SurfaceOf { s: sum / share, parts })
    }
}

/// What four cells become.
struct Block {
    front: SurfaceOf,
    /// How much of the pixel the surface in front covers.
    coverage: f32,
    back: Option<SurfaceOf>,
}

/// One row of the coarser scene.
#[derive(Default)]
struct Row {
    front: Vec<f32>,
    back: Vec<f32>,
    mixed: [Mixed; 2],
    /// Pixels that the surface in front covers in part.
    partial: Vec<Edge>,
}

/// A pixel that the surface in front covers in part.
#[derive(Clone, Copy)]
struct Edge {
    index: usize,
    /// Half-way between the two surfaces.
    middle: f32,
    coverage: f32,
}

/// A scene of one picture: a surface without gaps, and what it hides.
struct Finer<'a> {
    size: Size,
    /// Columns of the coarser scene.
    across: usize,
    layers: &'a [SceneLayer],
}

impl Finer<'_> {
    /// The columns or rows of a block, of `n`; their mirror images stand in for those beyond the border.
    fn pair(block: usize, n: usize) -> [usize; SIDE] {
        std::array::from_fn(|i| mirrored((SIDE * block + i) as i64, n).0)
    }

    /// The row of blocks number `y`.
    fn row(&self, y: usize) -> Row {
        let (width, across) = (self.size.width, self.across);
        let front = &self.layers[0];
        let lines = Finer::pair(y, self.size.height);
        let shifts = lines.map(|line| &front.s[line * width..][..width]);
        let covered = lines.map(|line| coverage(front, line * width..(line + 1) * width));
        let hidden = lines.map(|line| Some(&self.layers.get(1)?.s[line * width..][..width]));
        let mut row = Row { back: vec![f32::NAN; across], ..Row::default() };
        for x in 0..across {
            let columns = Finer::pair(x, width);
            let at = |of: [&[f32]; SIDE]| [0, 1, 2, 3].map(|i| of[i / SIDE][columns[i % SIDE]]);
            let (s, c) = (at(shifts), at([&covered[0], &covered[1]]));
            let b = hidden[0].zip(hidden[1]).map_or([f32::NAN; 4], |(above, below)| at([above, below]));
            let (least, most) = s.iter().fold((s[0], s[0]), |(lo, hi), &s| (lo.min(s), hi.max(s)));
            let whole = c == [1.0; 4] && most - least < ONE_SURFACE_PX;
            if whole && b.iter().all(|b| b.is_nan()) {
                row.front.push(s.iter().sum::<f32>() / 4.0);
                continue;
            }
            let place = |i: usize| lines[i / SIDE] * width + columns[i % SIDE];
            let Block { front, coverage, back } = self.block((s, c, b), most, place);
            let index = y * across + x;
            if let Some(back) = back {
                row.back[x] = back.s;
                if coverage < 1.0 {
                    row.partial.push(Edge { index, middle: 0.25 * (front.s + back.s), coverage });
                }
                row.mixed[1].push(index, &back.parts);
            }
            row.front.push(front.s);
            if !whole {
                row.mixed[0].push(index, &front.parts);
            }
        }
        // Pixels are twice as large, and shifts half as many of them.
        row.front.iter_mut().chain(&mut row.back).for_each(|s| *s /= SIDE as f32);
        row
    }

    /// The surfaces of a block: shifts and coverage of the cells of the first layer, the greatest of these shifts, and the
    /// shifts of the cells behind. `place` has the index of each.
    fn block(
        &self,
        (s, c, b): ([f32; 4], [f32; 4], [f32; 4]),
        nearest: f32,
        place: impl Fn(usize) -> usize,
    ) -> Block {
        let part = |layer: u8, i: usize, share: f32| Part { layer, index: place(i) as u32, share };
        let is_near = |s: f32| s > nearest - ONE_SURFACE_PX;
        let near = (0..4).filter(|&i| is_near(s[i])).map(|i| part(0, i, c[i]));
        let covered: f32 = near.clone().map(|part| part.share).sum();
        // A block of which nothing is covered has no cells that are covered in part.
        let front = SurfaceOf::new(self.layers, near.collect());
        let mut behind = Vec::new();
        for i in 0..4 {
            let left = 1.0 - c[i];
            if !is_near(s[i]) {
                behind.push(part(0, i, c[i]));
            }
            if !b[i].is_nan() {
                behind.push(part(1, i, left));
            }
        }
        let seen_behind = SurfaceOf::new(self.layers, behind);
        let hidden = || {
            let hidden = (0..4).filter(|&i| !b[i].is_nan()).map(|i| part(1, i, 1.0));
            SurfaceOf::new(self.layers, hidden.collect())
        };
        match (front, seen_behind) {
            (Some(front), Some(back)) => Block { front, coverage: covered / 4.0, back: Some(back) },
            (Some(front), None) => Block { front, coverage: 1.0, back: hidden() },
            (None, back) => {
                let all = || SurfaceOf::new(self.layers, (0..4).map(|i| part(0, i, 1.0)).collect());
                let front = back.or_else(all).expect("four cells have shares");
                Block { front, coverage: 1.0, back: None }
            }
        }
    }
}

/// How much of their pixels some cells of a layer cover.
fn coverage(layer: &SceneLayer, pixels: Range<usize>) -> Vec<f32> {
    let mut covered = vec![1.0; pixels.len()];
    for (index, plane) in layer.partial_in(pixels.clone()) {
        covered[index - pixels.start] = plane.coverage();
    }
    covered
}

/// The half-planes of these pixels, sorted by index; `s` are the shifts of the cells in front.
fn half_planes(size: Size, s: &[f32], edges: &[Edge]) -> Vec<(usize, HalfPlane)> {
    let coverage_of = |index: usize, middle: f32| {
        let own = edges.binary_search_by_key(&index, |edge| edge.index);
        own.map_or_else(|_| f32::from(s[index] > middle), |i| edges[i].coverage)
    };
    let of = |edge: &Edge| {
        let around = half_plane::around(size, edge.index, |q| coverage_of(q, edge.middle));
        (edge.index, HalfPlane::from_coverage(around, edge.index))
    };
    edges.par_iter().map(of).collect()
}

impl Coarser {
    /// Whether a scene has one at half the size: if it is that of one opaque picture.
    pub fn exists(finer: &LayeredScene) -> bool {
        let LayeredScene { layers, front, opaque, .. } = finer;
        let stops_light = |layer: &SceneLayer| layer.partial.iter().all(|(_, plane)| plane.opacity == 1.0);
        let is_picture = *front == 0 && *opaque && layers.len() <= 2 && stops_light(&layers[0]);
        let is_whole = layers.get(1).is_none_or(|behind| behind.partial.is_empty());
        is_picture && is_whole && layers[0].s.par_iter().all(|s| !s.is_nan())
    }

    /// The scene at half the size, which has to exist. It shows so many columns and rows beyond the right and the lower border
    /// of the finer one as well: cells that a border divides do not tell where it is, and so not where the mirror image
    /// begins.
    pub fn new(finer: &LayeredScene, beyond: [usize; 2], simd: Simd) -> Coarser {
        let LayeredScene { size, layers, .. } = finer;
        let [width, height] = [size.width + beyond[0], size.height + beyond[1]].map(|n| n.div_ceil(SIDE));
        let coarse = Size { width, height, ..*size };
        let own = Finer { size: *size, across: width, layers };
        let rows: Vec<Row> = (0..coarse.height).into_par_iter().map(|y| own.row(y)).collect();
        let plane = |of: fn(&Row) -> &[f32]| {
            let rows: Vec<&[f32]> = rows.iter().map(of).collect();
            Buffer::concat(&rows)
        };
        let s = plane(|row| &row.front);
        let edges: Vec<Edge> = rows.iter().flat_map(|row| row.partial.iter().copied()).collect();
        let partial = half_planes(coarse, &s, &edges);
        let connectivity = edges::connectivity(&s, coarse.width, coarse.height);
        let surface = |s: Buffer<f32>, partial, connectivity| SceneLayer {
            role: Role::Surface,
            s: Arc::new(s),
            colors: Colors::of_cells(coarse, Vec::new()),
            carried: Vec::new(),
            partial: Arc::new(partial),
            connectivity: Arc::new(connectivity),
        };
        let behind = rows.iter().any(|row| !row.mixed[1].cells.is_empty()).then(|| plane(|row| &row.back));
        let mut surfaces = vec![surface(s, partial, connectivity)];
        surfaces.extend(behind.map(|s| surface(s, Vec::new(), Vec::new())));
        let mut mixed = [Mixed::default(), Mixed::default()];
        for row in rows {
            mixed.iter_mut().zip(&row.mixed).for_each(|(all, own)| all.append(own));
        }
        let found = finer.highlights(simd).coarser(*size, coarse);
        let surfaces = Surfaces { layers: surfaces, opaque: true };
        let scene = LayeredScene::of_surfaces(coarse, surfaces, None, simd).with_highlights(found);
        Coarser { scene, finer: *size, mixed }
    }

    /// The colours of each layer, from those of the finer scene's layers.
    pub fn colors(&self, finer: &[Colors]) -> Vec<Colors> {
        let channels = finer[0].channels();
        let coarse = Size { channels, ..self.scene.size };
        let mut planes = Buffer::unset(coarse.pixels() * channels);
        let bands = bands(planes.chunks_mut(coarse.pixels()), coarse.width);
        bands.into_par_iter().enumerate().for_each_init(Vec::new, |rows, (y, mut out)| {
            let (width, lines) = (self.finer.width, Finer::pair(y, self.finer.height));
            rows.resize(SIDE * channels * width, 0.0);
            for (line, row) in lines.into_iter().zip(rows.chunks_exact_mut(channels * width)) {
                finer[0].copy_row(line, 0..width, width, row);
            }
            let (above, below) = rows.split_at(channels * width);
            for (c, out) in out.iter_mut().enumerate() {
                let (above, below) = (&above[c * width..][..width], &below[c * width..][..width]);
                for (x, out) in out.iter_mut().enumerate() {
                    let [a, b] = Finer::pair(x, width);
                    *out = 0.25 * ((above[a] + above[b]) + (below[a] + below[b]));
                }
            }
        });
        let color = |(index, parts): (usize, &[Part])| {
            let mut color = [0.0; 4];
            for part in parts {
                let own = finer[usize::from(part.layer)].at(part.index as usize);
                color.iter_mut().zip(own).for_each(|(sum, v)| *sum += part.share * v);
            }
            CellColor { index, color }
        };
        let listed = |layer: usize| {
            let mixed = &self.mixed[layer];
            (0..mixed.cells.len()).into_par_iter().map(|i| color(mixed.get(i))).collect()
        };
        let front = Colors::new(coarse, Arc::new(planes)).with(listed(0));
        let behind = self.scene.layers.get(1).map(|_| Colors::of_cells(coarse, listed(1)));
        std::iter::once(front).chain(behind).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::layered::build;
    use super::*;
    use crate::cancel::Cancel;
    use crate::picture::{Layer, Picture};

    const SIZE: Size = Size { width: 51, height: 38, channels: 1 };

    /// The scene of a picture with these disparities and grey values.
    fn scene(at: impl Fn(usize, usize) -> (f32, f32)) -> LayeredScene {
        let pixels = || (0..SIZE.pixels()).map(|i| at(i % SIZE.width, i / SIZE.width));
        let layer = Layer::new(Arc::new(pixels().map(|p| p.1).collect()), pixels().map(|p| p.0).collect());
        build(&Picture::new(SIZE, vec![layer]), 1, 1.0, Simd::PORTABLE, &Cancel::default()).unwrap()
    }

    fn coarser(finer: &LayeredScene) -> (Coarser, Vec<Colors>) {
        assert!(Coarser::exists(finer));
        let coarser = Coarser::new(finer, [0; 2], Simd::PORTABLE);
        let colors: Vec<Colors> = finer.layers.iter().map(|layer| layer.colors.clone()).collect();
        let colors = coarser.colors(&colors);
        (coarser, colors)
    }

    /// The light that the pinhole sees at a pixel, and how much of it a surface nearer than `s` covers.
    fn seen(layers: &[SceneLayer], colors: &[Colors], index: usize, s: f32) -> [f32; 2] {
        let (mut left, mut light, mut near) = (1.0, 0.0, 0.0);
        for (layer, colors) in layers.iter().zip(colors).filter(|(layer, _)| !layer.s[index].is_nan()) {
            let own = left * layer.half_plane_at(index).map_or(1.0, |plane| plane.coverage());
            light += own * colors.at(index)[0];
            near += if layer.s[index] > s { own } else { 0.0 };
            left -= own;
        }
        [light, near]
    }

    #[test]
    fn light_and_silhouettes_stay_what_they_are() {
        // A slanted bar before a wall, antialiased, and a wire before both.
        let bar = |x: usize, y: usize| {
            (x as f32 - 14.3 - 0.4 * y as f32).clamp(0.0, 1.0)
                * (34.6 + 0.4 * y as f32 - x as f32).clamp(0.0, 1.0)
        };
        let wire = |x: usize, y: usize| x.abs_diff(y + 9) == 0;
        let at = |x: usize, y: usize| match bar(x, y) {
            _ if wire(x, y) => (40.0, 0.9),
            covered => (if covered > 0.5 { 12.0 } else { 0.0 }, 0.2 + 0.5 * covered),
        };
        let finer = scene(at);
        let given: Vec<Colors> = finer.layers.iter().map(|layer| layer.colors.clone()).collect();
        let (coarser, colors) = coarser(&finer);
        let size = coarser.scene.size;
        for index in 0..size.pixels() {
            let (columns, rows) =
                (Finer::pair(index % size.width, SIZE.width), Finer::pair(index / size.width, SIZE.height));
            let parts = rows
                .into_iter()
                .flat_map(|y| columns.map(|x| seen(&finer.layers, &given, y * SIZE.width + x, 26.0)));
            let mean = parts.fold([0.0; 2], |sum, part| [0, 1].map(|i| sum[i] + part[i] / 4.0));
            let own = seen(&coarser.scene.layers, &colors, index, 13.0);
            assert!((0..2).all(|i| (own[i] - mean[i]).abs() < 1e-5), "{index}: {own:?} for {mean:?}");
        }
    }

    #[test]
    fn no_shift_lies_between_two_surfaces() {
        let shift = |x: usize, y: usize| {
            if x.abs_diff(y) < 2 {
                30.0
            } else if x > 25 {
                12.0
            } else {
                -9.0
            }
        };
        let finer = scene(|x, y| (shift(x, y), 0.5));
        let (coarser, _) = coarser(&finer);
        let given = finer.layers.iter().flat_map(|layer| layer.s.iter().copied()).filter(|s| !s.is_nan());
        let given: Vec<f32> = given.collect();
        for s in coarser.scene.layers.iter().flat_map(|layer| layer.s.iter()).filter(|s| !s.is_nan()) {
            assert!(given.iter().any(|given| (given - 2.0 * s).abs() < 1e-4), "{s}");
        }
    }

    #[test]
    fn beyond_the_border_is_the_mirror_image() {
        let finer = scene(|x, y| (1.5 * x as f32, 0.1 + 0.01 * y as f32));
        let given: Vec<Colors> = finer.layers.iter().map(|layer| layer.colors.clone()).collect();
        let coarser = Coarser::new(&finer, [40, 17], Simd::PORTABLE);
        let size = coarser.scene.size;
        assert_eq!((size.width, size.height), (46, 28));
        let colors = coarser.colors(&given);
        let mean = |i: usize, n: usize| {
            let pair = [2 * i, 2 * i + 1].map(|i| mirrored(i as i64, n).0 as f32);
            0.5 * (pair[0] + pair[1])
        };
        for (i, s) in coarser.scene.layers[0].s.iter().enumerate() {
            let [x, y] = [mean(i % size.width, SIZE.width), mean(i / size.width, SIZE.height)];
            assert!((s - 0.75 * x).abs() < 1e-5 && (colors[0].at(i)[0] - 0.1 - 0.01 * y).abs() < 1e-5);
        }
    }

    #[test]
    fn a_slope_stays_a_slope() {
        let finer = scene(|x, _| (1.5 * x as f32, 0.5));
        let (coarser, _) = coarser(&finer);
        let [layer] = &coarser.scene.layers[..] else { panic!() };
        let across = coarser.scene.size.width;
        // The last column of an odd number stands in for the one beyond.
        for (i, s) in layer.s.iter().enumerate().filter(|(i, _)| i % across + 1 < across) {
            assert!((s - 1.5 * (i % across) as f32 - 0.375).abs() < 1e-5);
        }
        assert!(layer.partial.is_empty() && layer.connectivity.iter().all(|c| c & edges::EDGE == 0));
    }
}
