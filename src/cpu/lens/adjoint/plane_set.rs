//! Planes of values, of which a few beside each other are worked on together.

use crate::cpu::lens::lanes::FLOATS;

/// Some planes of the same length, one after another.
#[derive(Default)]
pub struct PlaneSet {
    values: Vec<f32>,
    len: usize,
}

impl PlaneSet {
    /// So many planes of zeros.
    pub fn zeros(planes: usize, len: usize) -> PlaneSet {
        PlaneSet { values: vec![0.0; planes * len], len }
    }

    /// Makes it so many planes of zeros.
    pub fn clear(&mut self, planes: usize, len: usize) {
        self.values.clear();
        self.values.resize(planes * len, 0.0);
        self.len = len;
    }

    /// The plane of this number.
    #[inline(always)]
    pub fn plane(&self, number: usize) -> &[f32] {
        &self.values[number * self.len..][..self.len]
    }

    #[inline(always)]
    pub fn plane_mut(&mut self, number: usize) -> &mut [f32] {
        &mut self.values[number * self.len..][..self.len]
    }

    /// The group of values that starts at `at`, in each plane from `first` on.
    #[inline(always)]
    pub fn groups<const N: usize>(&self, first: usize, at: usize) -> [&[f32; FLOATS]; N] {
        let mut rest = &self.values[first * self.len..];
        std::array::from_fn(|_| {
            let (plane, others) = rest.split_at(self.len);
            rest = others;
            group(plane, at)
        })
    }

    /// The group of values that starts at `at`, in each of the first planes.
    #[inline(always)]
    pub fn groups_mut<const N: usize>(&mut self, at: usize) -> [&mut [f32; FLOATS]; N] {
        let mut rest = &mut self.values[..];
        std::array::from_fn(|_| {
            let (plane, others) = std::mem::take(&mut rest).split_at_mut(self.len);
            rest = others;
            group_mut(plane, at)
        })
    }
}

/// The group of values that starts at `at`.
#[inline(always)]
pub fn group<T>(values: &[T], at: usize) -> &[T; FLOATS] {
    values[at..].first_chunk().expect("planes are longer by a group")
}

#[inline(always)]
pub fn group_mut(values: &mut [f32], at: usize) -> &mut [f32; FLOATS] {
    values[at..].first_chunk_mut().expect("planes are longer by a group")
}
