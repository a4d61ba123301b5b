//! The pixels that are drawn as sprites, and their sprites.

use super::stamp::Stamp;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::sprites::{Settings, step};
use crate::simd::Simd;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;

/// A pixel that is drawn as a sprite.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    pub column: u32,
    step: i32,
    /// Radius of its circle of confusion.
    pub radius_px: f32,
    /// The part of its light that is drawn.
    pub drawn: f32,
}

/// The pixels that are drawn into one layer.
pub struct List {
    /// The points row by row, in the order of columns.
    pub rows: Vec<Vec<Point>>,
    /// The lowest step, and the sprites of all steps from there on: for even and odd columns of even rows, then of
    /// odd rows.
    lowest: i32,
    stamps: Vec<Option<[Stamp; 4]>>,
    /// Number of pixels of the picture that the largest sprite reaches.
    pub reach: usize,
}

impl List {
    /// The lists of the pixels in front of the focus and of those behind it.
    pub fn both(
        layer: &Layer,
        size: Size,
        optics: &Optics,
        settings: &Settings,
        simd: Simd,
        cancel: &Cancel,
    ) -> Result<[List; 2]> {
        let point = |(column, &coc_px): (usize, &f32)| {
            let drawn = settings.drawn(coc_px);
            (drawn > 0.0).then(|| {
                let (column, step, radius_px) = (column as u32, step(coc_px), coc_px.abs());
                Point { column, step, radius_px, drawn }
            })
        };
        let of_row = |coc_px: &mut Vec<f32>, row: &[f32]| {
            simd.run(
                #[inline(always)]
                || {
                    for (coc_px, &d) in coc_px.iter_mut().zip(row) {
                        *coc_px = settings.cut(-optics.shift_px(f64::from(d)));
                    }
                },
            );
            coc_px.iter().enumerate().filter_map(point).partition(|point| point.step < 0)
        };
        let rows = layer.disparity.par_chunks(size.width);
        let (in_front, behind) = rows.map_init(|| vec![0.0; size.width], of_row).unzip();
        Ok([List::new(in_front, settings, cancel)?, List::new(behind, settings, cancel)?])
    }

    fn new(rows: Vec<Vec<Point>>, settings: &Settings, cancel: &Cancel) -> Result<List> {
        let with_row = |mut steps: BTreeSet<i32>, row: &Vec<Point>| {
            steps.extend(row.chunk_by(|a, b| a.step == b.step).map(|run| run[0].step));
            steps
        };
        let with_steps = |mut steps: BTreeSet<i32>, mut more: BTreeSet<i32>| {
            steps.append(&mut more);
            steps
        };
        let steps = rows.par_iter().fold(BTreeSet::new, with_row).reduce(BTreeSet::new, with_steps);
        let (lowest, highest) = (steps.first().copied().unwrap_or(0), steps.last().copied().unwrap_or(-1));
        let stamps: Vec<Option<[Stamp; 4]>> = (lowest..=highest)
            .into_par_iter()
            .map(|step| {
                cancel.check()?;
                Ok(steps.contains(&step).then(|| settings.sprites(step).map(|sprite| Stamp::new(&sprite))))
            })
            .collect::<Result<_>>()?;
        let reach = stamps.iter().flatten().flatten().map(Stamp::reach).max().unwrap_or(0);
        Ok(List { rows, lowest, stamps, reach })
    }

    pub fn is_empty(&self) -> bool {
        self.stamps.is_empty()
    }

    /// The sprite of a point at `(x, y)`, which may be the position of its mirror image.
    #[inline(always)]
    pub fn stamp(&self, point: &Point, (x, y): (i64, i64)) -> &Stamp {
        let stamps = self.stamps[(point.step - self.lowest) as usize].as_ref();
        &stamps.expect("made for every step on the list")[(2 * (y & 1) + (x & 1)) as usize]
    }
}

/// A row of the picture or one of its mirror images to the side.
pub struct Image {
    /// Column `x` of the picture is at `origin + direction x`.
    origin: i64,
    direction: i64,
    /// The columns within reach of the picture.
    columns: Range<i64>,
}

impl Image {
    /// All images of rows of `width` pixels that come within `reach` of the picture.
    pub fn all(width: usize, reach: usize) -> Vec<Image> {
        let (width, reach) = (width as i64, reach as i64);
        let periods = reach / (2 * width) + 1;
        let plain = |k: i64| (2 * k * width, 1);
        let turned = |k: i64| (2 * k * width - 1, -1);
        (-periods..=periods)
            .flat_map(|k| [turned(k), plain(k)])
            .map(|(origin, direction)| {
                let ends = [-reach, width + reach - 1].map(|x| direction * (x - origin));
                Image { origin, direction, columns: ends[0].min(ends[1])..ends[0].max(ends[1]) + 1 }
            })
            .filter(|image| image.columns.start < width && image.columns.end > 0)
            .collect()
    }

    /// The points of a row whose image comes within reach.
    pub fn of<'a>(&self, row: &'a [Point]) -> &'a [Point] {
        let before = |column: i64| row.partition_point(|point| i64::from(point.column) < column);
        &row[before(self.columns.start)..before(self.columns.end)]
    }

    /// The column of the image of a point.
    #[inline(always)]
    pub fn column(&self, point: &Point) -> i64 {
        self.origin + self.direction * i64::from(point.column)
    }
}
