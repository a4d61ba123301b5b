//! The pixels that are drawn.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::optics::Optics;
use crate::picture::{Layer, Size};
use crate::plan::sprites::{Settings, Sprite, step};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;

/// A pixel to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    pub column: u32,
    pub step: i32,
    /// Its signed circle of confusion.
    pub coc_px: f32,
    /// How much of it is drawn.
    pub drawn: f32,
}

impl Point {
    pub fn is_in_front(&self) -> bool {
        self.coc_px < 0.0
    }
}

/// The pixels to be drawn, row by row in scan order, and what they are drawn as.
pub struct List {
    pub rows: Vec<Vec<Point>>,
    /// The lowest step, which is negative if anything is in front, and the sprites of all steps from there.
    lowest: i32,
    sprites: Vec<Option<[Sprite; 4]>>,
    /// Pixels of the picture that the largest sprite reaches.
    pub reach: usize,
}

impl List {
    pub fn new(
        layer: &Layer,
        size: Size,
        optics: &Optics,
        settings: &Settings,
        cancel: &Cancel,
    ) -> Result<List> {
        let point = |(column, &d): (usize, &f32)| {
            let coc_px = settings.cut(-optics.shift_px(f64::from(d)));
            let drawn = settings.drawn(coc_px);
            (drawn > 0.0).then(|| Point { column: column as u32, step: step(coc_px), coc_px, drawn })
        };
        let rows: Vec<Vec<Point>> = layer
            .disparity
            .par_chunks(size.width)
            .map(|row| row.iter().enumerate().filter_map(point).collect())
            .collect();
        let steps_of = |row: &Vec<Point>| -> BTreeSet<i32> {
            row.chunk_by(|a, b| a.step == b.step).map(|run| run[0].step).collect()
        };
        let steps = rows.par_iter().map(steps_of).reduce(BTreeSet::new, |mut a, mut b| {
            a.append(&mut b);
            a
        });
        let (lowest, highest) = (steps.first().copied().unwrap_or(0), steps.last().copied().unwrap_or(0));
        let sprites: Vec<Option<[Sprite; 4]>> = (lowest..=highest)
            .into_par_iter()
            .map(|step| {
                cancel.check()?;
                Ok(steps.contains(&step).then(|| settings.sprites(step)))
            })
            .collect::<Result<_>>()?;
        let reach_of = |s: &Sprite| {
            let (right, bottom) = (s.left + s.across as i32, s.top + s.down() as i32);
            2 * (1 - s.left).max(1 - s.top).max(right).max(bottom)
        };
        let reach = sprites.iter().flatten().flatten().map(reach_of).max().unwrap_or(0) as usize;
        Ok(List { rows, lowest, sprites, reach })
    }

    pub fn any_in_front(&self) -> bool {
        self.lowest < 0
    }

    /// The sprite of a point that lies at `(x, y)`, or is mirrored there.
    #[inline(always)]
    pub fn sprite(&self, point: &Point, (x, y): (i64, i64)) -> &Sprite {
        let sprites = self.sprites[(point.step - self.lowest) as usize].as_ref();
        &sprites.expect("made for every step on the list")[(2 * (y & 1) + (x & 1)) as usize]
    }
}

/// What lies in a row of the picture, or the mirror image of it that is so far to the side.
pub struct Image {
    /// Column `x` of the picture is at `origin + direction x`.
    origin: i64,
    direction: i64,
    /// The columns that come within reach of the picture.
    columns: Range<i64>,
}

impl Image {
    /// All images of rows of `width` pixels that come within `reach` of them.
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

    /// Where the image of a point is.
    #[inline(always)]
    pub fn column(&self, point: &Point) -> i64 {
        self.origin + self.direction * i64::from(point.column)
    }
}
