//! The cells of a layer that are not the picture's own pixels, as a list in which `shaders/lens/cells.wgsl` looks them up.

use super::edges::BITS;
use crate::scene::given_layers::is_divided;
use crate::scene::layer::{Role, SceneLayer};
use rayon::prelude::*;
use std::ops::Range;

/// Number of pixels whose cells one worker lists at a time.
const PART: usize = 1 << 15;

/// The words of each listed cell; each kind may be missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// Its channels.
    pub color: usize,
    /// Its shift, where only listed cells have one.
    pub shift: usize,
    /// The number of its half-plane.
    pub number: usize,
}

impl Record {
    pub const NOTHING: Record = Record { color: 0, shift: 0, number: 0 };

    fn new(layer: &SceneLayer, pixels: Range<usize>) -> Record {
        let is_surface = layer.role == Role::Surface;
        Record {
            color: if is_surface { layer.colors.channels() } else { 0 },
            shift: usize::from(is_surface && layer.colors.is_list()),
            number: usize::from(layer.covers_partly_any(pixels)),
        }
    }

    fn words(self) -> usize {
        self.color + self.shift + self.number
    }
}

/// The listed cells of a layer.
pub struct Listed {
    pub record: Record,
    /// For every [`BITS`] pixels: which of their cells are listed, and how many were before. Empty if none is.
    pub places: Vec<[u32; 2]>,
    /// The records of the cells, in the order of pixels.
    pub words: Vec<u32>,
}

impl Listed {
    /// Lists the cells of a range of pixels. A layer that is one of several in the picture has a `coverage` there. The
    /// numbers of half-planes begin after `first_number`.
    pub fn new(
        layer: &SceneLayer,
        pixels: Range<usize>,
        coverage: Option<&[f32]>,
        first_number: usize,
    ) -> Listed {
        let record = Record::new(layer, pixels.clone());
        let parts = (pixels.start..pixels.end).into_par_iter().step_by(PART);
        let parts = parts.map(|start| {
            let own = start..(start + PART).min(pixels.end);
            let before = layer.partial_in(pixels.start..start).len();
            let bits = bits_of(layer, own.clone(), coverage);
            let words = records(layer, record, own.start, &bits, first_number + before);
            (bits, words)
        });
        let (bits, words): (Vec<Vec<u32>>, Vec<Vec<u32>>) = parts.unzip();
        let words = words.concat();
        if words.is_empty() {
            return Listed { record, places: Vec::new(), words };
        }
        let mut count = 0;
        let place = |bits: u32| {
            let before = count;
            count += bits.count_ones();
            [bits, before]
        };
        Listed { record, places: bits.concat().into_iter().map(place).collect(), words }
    }
}

/// Which cells of a range of pixels are listed.
fn bits_of(layer: &SceneLayer, pixels: Range<usize>, coverage: Option<&[f32]>) -> Vec<u32> {
    let mut bits = vec![0; pixels.len().div_ceil(BITS)];
    let mut list = |index: usize| {
        let i = index - pixels.start;
        bits[i / BITS] |= 1 << (i % BITS);
    };
    layer.colors.listed(pixels.clone()).iter().for_each(|cell| list(cell.index));
    layer.partial_in(pixels.clone()).iter().for_each(|(index, _)| list(*index));
    let coverage = coverage.into_iter().flat_map(|coverage| pixels.clone().zip(&coverage[pixels.clone()]));
    coverage.filter(|(_, a)| is_divided(**a)).for_each(|(index, _)| list(index));
    bits
}

/// The records of the cells that have a bit, the first of which is that of pixel `first`.
fn records(layer: &SceneLayer, record: Record, first: usize, bits: &[u32], first_number: usize) -> Vec<u32> {
    let all = first..first + BITS * bits.len();
    let mut listed = layer.colors.listed(all.clone()).iter().peekable();
    let mut partial = (1 + first_number as u32..).zip(layer.partial_in(all)).peekable();
    let count: u32 = bits.iter().map(|bits| bits.count_ones()).sum();
    let mut words = Vec::with_capacity(count as usize * record.words());
    for (word, &bits) in bits.iter().enumerate() {
        let mut left = bits;
        while left != 0 {
            let index = first + BITS * word + left.trailing_zeros() as usize;
            left &= left - 1;
            if record.color > 0 {
                let own = listed.next_if(|cell| cell.index == index);
                let color = own.map_or_else(|| layer.colors.at(index), |cell| cell.color);
                words.extend(color[..record.color].iter().map(|v| v.to_bits()));
            }
            if record.shift > 0 {
                words.push(layer.s[index].to_bits());
            }
            if record.number > 0 {
                words.push(partial.next_if(|(_, (own, _))| *own == index).map_or(0, |(number, _)| number));
            }
        }
    }
    words
}
