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
        self.assert_inside::<N>(first, at);
        let start = self.values[first * self.len..].as_ptr();
        // SAFETY: all of these values are inside.
        std::array::from_fn(|i| unsafe { &*start.add(i * self.len + at).cast() })
    }

    /// The group of values that starts at `at`, in each of the first planes.
    #[inline(always)]
    pub fn groups_mut<const N: usize>(&mut self, at: usize) -> [&mut [f32; FLOATS]; N] {
        self.assert_inside::<N>(0, at);
        let start = self.values.as_mut_ptr();
        // SAFETY: all of these values are inside, and none is in two planes.
        std::array::from_fn(|i| unsafe { &mut *start.add(i * self.len + at).cast() })
    }

    /// Checks once for all planes, which is what their groups are quick by.
    #[inline(always)]
    fn assert_inside<const N: usize>(&self, first: usize, at: usize) {
        assert!(
            (first + N) * self.len <= self.values.len() && at + FLOATS <= self.len,
            "a group is inside its plane"
        );
    }
}

/// The group of values that starts at `at`.
#[inline(always)]
pub fn group<T>(values: &[T], at: usize) -> &[T; FLOATS] {
    values[at..].first_chunk().expect("planes are longer by a group")
}
