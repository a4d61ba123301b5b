//! Highlights: cells so bright that single lens points would show as dots in their discs.
//!
//! What such a cell has above its surroundings is taken out of the sheets and drawn as the exact, area-weighted
//! opening; each pixel of it asks along its own ray how much of something nearer is in the way.

use super::barrel::Clip;
use super::blocks::BLOCK;
use super::colors::{Colors, Own};
use super::kernels::{self, Kernels};
use super::pack::{self, Packed, Padding, TILE};
use super::sheets::{Sheet, Sheets};
use super::sweep::TileColor;
use super::tiles::{IN_FOCUS_PX, Tile};
use crate::cpu::simd::Simd;
use crate::picture::Size;
use rayon::prelude::*;

/// A cell is a highlight when it is brighter than this many times its surroundings. A view of 512 then changes a
/// pixel of the disc by one hundredth of the surroundings when it comes or goes.
const BRIGHTER: f32 = 5.0;
/// Blocks on each side whose mean is "the surroundings".
const AROUND: usize = 2;

/// What highlights are drawn in.
pub struct Scene<'a> {
    pub packed: &'a Packed,
    pub s_focus: f64,
    pub kernels: &'a Kernels,
    pub clip: Option<&'a Clip>,
}

/// The light of one cell above its surroundings, and its disc.
pub struct Highlight {
    /// Place in the padded frame.
    pub x: i32,
    pub y: i32,
    /// Shift in pixels.
    pub t: f64,
    /// The light above its surroundings.
    pub excess: [f32; 4],
    /// Whether anything nearer may be in the way of some part of the disc.
    hidden_in_part: bool,
}

/// Channels that hold light: the last of two or four is coverage, which is not brighter or darker.
fn light_channels(size: Size) -> usize {
    if size.channels == 2 { 1 } else { size.channels.min(3) }
}

/// How bright a colour is.
fn brightness(color: &[f32; 4], lights: usize) -> f32 {
    color[..lights].iter().sum()
}

/// The light of some cells.
#[derive(Clone, Copy, Default)]
struct Light {
    sum: [f32; 4],
    cells: f32,
}

impl Light {
    fn add(&mut self, other: &Light) {
        self.sum.iter_mut().zip(other.sum).for_each(|(sum, v)| *sum += v);
        self.cells += other.cells;
    }

    fn mean(&self) -> [f32; 4] {
        self.sum.map(|sum| sum / self.cells.max(1.0))
    }
}

/// The light of every block of the frame, for telling what stands out.
struct Surroundings {
    size: Size,
    across: usize,
    down: usize,
    /// Light of the cells that are no highlights.
    light: Vec<Light>,
    /// The brightest cell.
    brightest: Vec<f32>,
    /// What is brighter than this is a highlight.
    limit: Vec<f32>,
}

impl Surroundings {
    /// The surroundings of a sheet's cells: first of all cells, then of those not much brighter than that.
    fn new(size: Size, colors: &Colors, simd: Simd) -> Surroundings {
        let (across, down) = (size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
        let lights = light_channels(size);
        let block_row = |scratch: &mut Vec<f32>, by: usize| {
            let mut blocks = vec![(Light::default(), f32::NEG_INFINITY); across];
            scratch.resize(size.width * size.channels, 0.0);
            for y in by * BLOCK..(by * BLOCK + BLOCK).min(size.height) {
                colors.copy_row(y, 0..size.width, size.width, scratch);
                simd.run(
                    #[inline(always)]
                    || add_row(scratch, size.width, lights, &mut blocks),
                );
            }
            blocks
        };
        let rows: Vec<_> = (0..down).into_par_iter().map_init(Vec::new, block_row).collect();
        let (light, brightest) = rows.into_iter().flatten().unzip();
        let mut all = Surroundings { size, across, down, light, brightest, limit: Vec::new() };
        all.limit = all.limits();
        let dim = |b: usize| {
            if all.brightest[b] <= all.limit[b] {
                return all.light[b];
            }
            let mut light = Light::default();
            let colors = all.cells(b).map(|i| colors.at(i));
            for color in colors.filter(|color| brightness(color, lights) <= all.limit[b]) {
                light.add(&Light { sum: color, cells: 1.0 });
            }
            light
        };
        all.light = (0..across * down).into_par_iter().map(dim).collect();
        all.limit = all.limits();
        all
    }

    /// The mean colour of the blocks around a block, itself among them.
    fn around(&self, b: usize) -> [f32; 4] {
        let (bx, by) = (b % self.across, b / self.across);
        let columns = bx.saturating_sub(AROUND)..(bx + AROUND + 1).min(self.across);
        let mut light = Light::default();
        for y in by.saturating_sub(AROUND)..(by + AROUND + 1).min(self.down) {
            columns.clone().for_each(|x| light.add(&self.light[y * self.across + x]));
        }
        light.mean()
    }

    /// The limits that follow from the light at hand.
    fn limits(&self) -> Vec<f32> {
        let limit = |b: usize| BRIGHTER * brightness(&self.around(b), light_channels(self.size));
        (0..self.light.len()).into_par_iter().map(limit).collect()
    }

    /// The block of a cell.
    fn block_of(&self, index: usize) -> usize {
        index / self.size.width / BLOCK * self.across + index % self.size.width / BLOCK
    }

    /// The cells of a block.
    fn cells(&self, b: usize) -> impl Iterator<Item = usize> + use<> {
        let (x0, y0, width) = (b % self.across * BLOCK, b / self.across * BLOCK, self.size.width);
        let x1 = (x0 + BLOCK).min(width);
        (y0..(y0 + BLOCK).min(self.size.height)).flat_map(move |y| y * width + x0..y * width + x1)
    }
}

/// Adds a row of the frame, all channels one after another, to the blocks that it crosses.
#[inline(always)]
fn add_row(row: &[f32], width: usize, lights: usize, blocks: &mut [(Light, f32)]) {
    for (bx, (light, brightest)) in blocks.iter_mut().enumerate() {
        let columns = bx * BLOCK..(bx * BLOCK + BLOCK).min(width);
        light.cells += columns.len() as f32;
        let mut bright = [0.0f32; BLOCK];
        for c in 0..lights {
            let mut sum = 0.0;
            for (bright, v) in bright.iter_mut().zip(&row[c * width..][columns.clone()]) {
                *bright += v;
                sum += v;
            }
            light.sum[c] += sum;
        }
        *brightest = bright[..columns.len()].iter().fold(*brightest, |m, &v| if v > m { v } else { m });
    }
}

/// A cell that stands out, whatever is in focus.
#[derive(Clone, Copy)]
pub struct Bright {
    index: usize,
    /// Its colour without the light above its surroundings.
    dim: [f32; 4],
    /// That light, of the part of the pixel that the cell covers.
    excess: [f32; 4],
}

/// The cells of each sheet that stand out.
pub fn find(sheets: &Sheets, simd: Simd) -> Vec<Vec<Bright>> {
    let size = sheets.size;
    let lights = light_channels(size);
    let front = Surroundings::new(size, &sheets.sheets[0].colors, simd);
    let of_sheet = |(i, sheet): (usize, &Sheet)| {
        // A real layer has surroundings of its own: the one in front may be dark, or hardly there.
        let own = (i > 0 && !sheet.colors.is_list()).then(|| Surroundings::new(size, &sheet.colors, simd));
        let brighter = |b: usize| match &own {
            Some(own) if own.limit[b] > front.limit[b] => own,
            _ => &front,
        };
        let stands_out = |&index: &usize| {
            let bright = brightness(&sheet.colors.at(index), lights);
            bright > brighter(front.block_of(index)).limit[front.block_of(index)]
        };
        let found: Vec<usize> = if sheet.colors.is_list() {
            let cells = sheet.colors.own(0..size.pixels()).par_iter().map(|cell| cell.index);
            cells.filter(stands_out).collect()
        } else {
            let brightest = &own.as_ref().unwrap_or(&front).brightest;
            let blocks =
                (0..brightest.len()).into_par_iter().filter(|&b| brightest[b] > brighter(b).limit[b]);
            blocks.flat_map_iter(|b| front.cells(b)).filter(stands_out).collect()
        };
        let bright = |index: usize| {
            let b = front.block_of(index);
            let (color, around) = (sheet.colors.at(index), brighter(b).around(b));
            let above = |c: usize| (color[c] - around[c].max(0.0)).max(0.0);
            let excess: [f32; 4] = std::array::from_fn(|c| if c < lights { above(c) } else { 0.0 });
            let area = match sheet.partial.binary_search_by_key(&index, |p| p.0) {
                Ok(i) => sheet.partial[i].1.area,
                Err(_) => 1.0,
            };
            let dim = std::array::from_fn(|c| color[c] - excess[c]);
            Bright { index, dim, excess: excess.map(|e| area * e) }
        };
        found.into_iter().map(bright).collect()
    };
    sheets.sheets.iter().enumerate().map(of_sheet).collect()
}

/// The highlights of a scene under one focus, and for each sheet the colours of their cells without them. Each highlight
/// is taken for one that may be hidden in part.
pub fn extract(
    sheets: &Sheets,
    padding: &Padding,
    s_focus: f64,
    simd: Simd,
) -> (Vec<Highlight>, Vec<Vec<Own>>) {
    let mut highlights = Vec::new();
    let of_sheet = |(sheet, bright): (&Sheet, &Vec<Bright>)| {
        let mut dimmed = Vec::with_capacity(bright.len());
        for &Bright { index, dim, excess } in bright {
            let t = f64::from(sheet.s[index]) - s_focus;
            // An empty cell has a shift of NaN, which compares false.
            if t.abs() > IN_FOCUS_PX {
                dimmed.push(Own { index, color: dim });
                highlights.extend(images(padding, index, t).map(|(x, y)| Highlight {
                    x,
                    y,
                    t,
                    excess,
                    hidden_in_part: true,
                }));
            }
        }
        dimmed
    };
    let all_dimmed = sheets.sheets.iter().zip(&*sheets.bright(simd)).map(of_sheet).collect();
    (highlights, all_dimmed)
}

/// Finds out which highlights anything may be in the way of.
pub fn find_hidden(highlights: &mut [Highlight], packed: &Packed, s_focus: f64) {
    highlights.par_iter_mut().for_each(|h| h.hidden_in_part = h.may_be_hidden(packed, s_focus));
}

/// A pixel and those of its mirror images whose discs reach into the frame, in padded coordinates.
fn images(padding: &Padding, index: usize, t: f64) -> impl Iterator<Item = (i32, i32)> {
    let padding = *padding;
    let reach = t.abs().ceil() as usize + 1;
    let along = move |i: usize, n: usize| {
        pack::images(i, n, reach - 1, n + 2 * reach - 1)
            .map(move |(at, _)| (at + padding.pad + 1 - reach) as i32)
    };
    let (x, y) = (index % padding.width, index / padding.width);
    along(y, padding.height).flat_map(move |y| along(x, padding.width).map(move |x| (x, y)))
}

impl Highlight {
    /// Whether some cell of the scene lies between the highlight and some point of the lens.
    fn may_be_hidden(&self, packed: &Packed, s_focus: f64) -> bool {
        let (blocks, codes) = (&packed.blocks, &packed.codes);
        if self.is_covered(packed, s_focus, f64::INFINITY) {
            return true;
        }
        let reach = packed.reach_px - self.t;
        let range = |v: i32, n: usize| {
            let first = (f64::from(v) - reach).max(0.0) as usize / BLOCK;
            let last = ((f64::from(v) + reach).max(0.0) as usize / BLOCK).min(n / BLOCK - 1);
            first..=last
        };
        let gap = |v: i32, b: usize| {
            let (v, lo, hi) = (v as i64, (b * BLOCK) as i64, (b * BLOCK + BLOCK - 1) as i64);
            (lo - v).max(v - hi).max(0) as f64
        };
        range(self.y, packed.padding.rows).any(|by| {
            range(self.x, packed.padding.stride).any(|bx| {
                let nearest = blocks.range[by * blocks.across + bx].1;
                let in_front = codes.decode(f64::from(nearest)) - s_focus - self.t;
                in_front > 0.5 && in_front + 1.5 >= gap(self.x, bx).hypot(gap(self.y, by))
            })
        })
    }

    /// Whether another sheet has a cell at the highlight's own pixel, in front of it by no more than `within` pixels.
    fn is_covered(&self, packed: &Packed, s_focus: f64, within: f64) -> bool {
        let cell = self.y as usize * packed.padding.stride + self.x as usize;
        let own = packed.codes.encode((self.t + s_focus) as f32);
        packed.sheets.iter().any(|sheet| {
            let lo = sheet.lo[cell];
            lo > own && f64::from(lo - own) * packed.codes.step() <= within
        })
    }

    /// How much of a pixel's rays from about the lens point `l` meets nothing before it meets the highlight.
    ///
    /// The rays of a pixel are a beam as wide as the pixel itself at every depth; what covers a cell in part, and
    /// the beam that passes there in part, lets the rest of it through.
    fn visible_from(&self, packed: &Packed, s_focus: f64, l: [f64; 2]) -> f32 {
        let longest = l[0].abs().max(l[1].abs());
        if self.is_covered(packed, s_focus, 0.5 / longest) {
            return 0.0;
        }
        if longest == 0.0 {
            return 1.0;
        }
        let code_per_step = 1.0 / (longest * packed.codes.step());
        let start = f64::from(packed.codes.encode((self.t + s_focus) as f32));
        let code = |k: f64| (start + k * code_per_step).min(f64::from(u16::MAX)) as u16;
        // Step by step outwards from the highlight, a cell at a time along the longer axis.
        let slope = [l[0] / longest, l[1] / longest];
        let steps = ((packed.reach_px - self.t) * longest).ceil() as i32;
        // A straight edge may be met in more than one cell, and still hides what it hides once.
        let mut visible = 1.0f32;
        let mut k = 1;
        while k <= steps {
            let along = slope.map(|slope| f64::from(k) * slope);
            let cell = [self.x + along[0].round() as i32, self.y + along[1].round() as i32];
            let (stride, rows) = (packed.padding.stride as i32, packed.padding.rows as i32);
            if !(0..stride).contains(&cell[0]) || !(0..rows).contains(&cell[1]) {
                break;
            }
            let (from, to) = (code(f64::from(k) - 0.5), code(f64::from(k) + 0.5));
            let block = cell.map(|v| v as usize / BLOCK);
            if packed.blocks.range[block[1] * packed.blocks.across + block[0]].1 < from {
                // Nothing in this block is near enough, and the ray only comes nearer.
                k += steps_inside(cell, slope);
                continue;
            }
            let index = (cell[1] * stride + cell[0]) as usize;
            for sheet in &packed.sheets {
                let (lo, hi) = (sheet.lo[index], sheet.hi[index]);
                if hi >= from && lo < to {
                    // Where the ray passes this cell, from its centre: on the line through the highlight.
                    let t_cell = packed.codes.decode(f64::from(lo)) - s_focus - self.t;
                    let at = [0, 1].map(|i| (l[i] * t_cell - along[i].round()) as f32);
                    visible = visible.min(1.0 - sheet.partial.covered(index, at));
                }
            }
            if visible == 0.0 {
                break;
            }
            k += 1;
        }
        visible
    }

    /// Adds the part of the disc that lies in a tile.
    fn draw(&self, scene: &Scene, origin: (usize, usize), out: &mut TileColor) {
        let pad = scene.packed.padding.pad as i32;
        // The highlight in the tile's coordinates; a pixel p sees it at the offset q - p of the kernel.
        let (qx, qy) = (self.x - pad - origin.0 as i32, self.y - pad - origin.1 as i32);
        let kernel = scene.kernels.get(kernels::key(self.t));
        for row in &kernel.rows {
            let y = qy - row.dy;
            if !(0..TILE.1 as i32).contains(&y) {
                continue;
            }
            let mut add = |x: i32, weight: f32| {
                let l = [qx - x, row.dy].map(|d| f64::from(d) / self.t);
                let visible =
                    if self.hidden_in_part { self.visible_from(scene.packed, scene.s_focus, l) } else { 1.0 };
                if visible == 0.0 {
                    return;
                }
                let weight = visible * weight;
                let weight = match scene.clip {
                    None => weight,
                    Some(clip) => {
                        let place = [origin.0 as f64 + f64::from(x), origin.1 as f64 + f64::from(y)];
                        weight * clip.share(place, l, self.t) as f32
                    }
                };
                for (plane, e) in out.planes.iter_mut().zip(self.excess) {
                    plane[y as usize * TILE.0 + x as usize] += weight * e;
                }
            };
            // Pixels qx - dx for dx in the run, cut to the tile.
            let first = (qx - row.run.1 + 1).max(0);
            let end = (qx - row.run.0 + 1).min(TILE.0 as i32);
            for x in first..end {
                add(x, kernel.run_weight);
            }
            for &(dx, weight) in &row.partial {
                let x = qx - dx;
                if (0..TILE.0 as i32).contains(&x) {
                    add(x, weight);
                }
            }
        }
    }
}

/// After how many steps at the earliest a ray from `cell` leaves its block.
fn steps_inside(cell: [i32; 2], slope: [f64; 2]) -> i32 {
    let steps = |i: usize| {
        let (inside, block) = (cell[i] % BLOCK as i32, BLOCK as i32);
        let to_border = if slope[i] > 0.0 { block - inside } else { inside + 1 };
        // Rounding to cells may gain one.
        f64::from(to_border - 1) / slope[i].abs()
    };
    (steps(0).min(steps(1)) as i32).max(1)
}

/// The highlights of a frame, by the tiles that their discs reach.
pub struct Highlights {
    pub all: Vec<Highlight>,
    /// For each tile, the highlights that reach it, in order.
    pub by_tile: Vec<Vec<u32>>,
}

impl Highlights {
    /// Sorts highlights into tiles.
    pub fn new(all: Vec<Highlight>, padding: &Padding, tiles: &[Tile]) -> Highlights {
        let (across, pad) = (padding.width.div_ceil(TILE.0), padding.pad as i32);
        let mut by_tile = vec![Vec::new(); tiles.len()];
        let down = tiles.len() / across;
        for (i, h) in all.iter().enumerate() {
            let reach = h.t.abs().ceil() as i32 + 1;
            let range = |v: i32, side: usize, n: usize| {
                let first = (v - pad - reach).max(0) as usize / side;
                let end = ((v - pad + reach).max(-1) + side as i32) as usize / side;
                first..end.min(n)
            };
            for ty in range(h.y, TILE.1, down) {
                for tx in range(h.x, TILE.0, across) {
                    by_tile[ty * across + tx].push(i as u32);
                }
            }
        }
        Highlights { all, by_tile }
    }

    /// The shifts that discs are needed for.
    pub fn shifts(&self) -> impl Iterator<Item = f64> + '_ {
        self.all.iter().map(|h| h.t)
    }

    /// Draws all that reaches tile number `tile`.
    pub fn draw(&self, scene: &Scene, tile: usize, origin: (usize, usize), out: &mut TileColor) {
        for &i in &self.by_tile[tile] {
            self.all[i as usize].draw(scene, origin, out);
        }
    }
}
