//! Pixels whose colour is NaN or infinite, such as a path tracer leaves: refused, or filled.

use super::errors::choice;
use crate::picture::Size;
use pyo3::exceptions::{PyUserWarning, PyValueError};
use pyo3::prelude::*;
use std::ffi::CString;

/// The treatment of invalid colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InvalidColor {
    /// Refuse the picture; the error says how many invalid pixels there are and where the first one is.
    Raise,
    /// Give each invalid pixel the mean of the valid ones around it.
    Fill,
}

/// The treatment of invalid colour.
pub fn read_invalid_color(name: &str) -> PyResult<InvalidColor> {
    choice("invalid_color", name, &[("raise", InvalidColor::Raise), ("fill", InvalidColor::Fill)])
}

/// The invalid pixels of a picture: how many, and which is the first.
#[derive(Debug, Clone, Copy)]
pub struct InvalidPixels {
    pub count: usize,
    first: usize,
}

impl InvalidPixels {
    /// All invalid pixels of this one and of a layer behind it.
    pub fn and(self, behind: InvalidPixels) -> InvalidPixels {
        InvalidPixels { count: self.count + behind.count, ..self }
    }

    /// "3 pixels that are ...; the first is at ..."
    fn describe(&self, size: Size, what: &str) -> String {
        let InvalidPixels { count, first } = *self;
        let (pixels, are) = if count == 1 { ("pixel", "is") } else { ("pixels", "are") };
        let (row, column) = (first / size.width, first % size.width);
        format!(
            "color has {count} {pixels} that {are} not finite (or too large for float32){what}; the first is at row \
             {row}, column {column}"
        )
    }

    /// The error that refuses them.
    pub fn error(&self, size: Size) -> PyErr {
        let text = self.describe(size, "");
        PyValueError::new_err(format!(
            "{text}. Pass invalid_color=\"fill\" to give such pixels the mean of those around them"
        ))
    }

    /// Warns that they were filled.
    pub fn warn(&self, py: Python<'_>, size: Size) -> PyResult<()> {
        let text = CString::new(self.describe(size, " and took the mean of those around"))?;
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
    }
}

/// Whether all channels of each pixel are finite.
fn finite_pixels(planes: &[f32], size: Size) -> Vec<bool> {
    let mut finite = vec![true; size.pixels()];
    for plane in planes.chunks(size.pixels()) {
        finite.iter_mut().zip(plane).for_each(|(finite, v)| *finite &= v.is_finite());
    }
    finite
}

/// The invalid pixels of some colour planes; `None` if all are valid.
pub fn find(planes: &[f32], size: Size) -> Option<InvalidPixels> {
    let finite = finite_pixels(planes, size);
    let first = finite.iter().position(|finite| !finite)?;
    Some(InvalidPixels { count: finite.iter().filter(|finite| !**finite).count(), first })
}

/// Gives each invalid pixel the mean of the valid ones among its eight neighbours, in all channels. Of a patch, the
/// pixels on its rim come first, and each round then counts as valid.
pub fn fill(planes: &mut [f32], size: Size) -> PyResult<()> {
    let pixels = size.pixels();
    let mut finite = finite_pixels(planes, size);
    if !finite.contains(&true) {
        return Err(PyValueError::new_err(
            "color has no finite pixel that invalid_color=\"fill\" could spread",
        ));
    }
    let around = |i: usize| {
        let (x, y) = (i % size.width, i / size.width);
        let rows = y.saturating_sub(1)..(y + 2).min(size.height);
        rows.flat_map(move |row| {
            (x.saturating_sub(1)..(x + 2).min(size.width)).map(move |column| row * size.width + column)
        })
    };
    let mut rim: Vec<usize> = (0..pixels).filter(|&i| !finite[i] && around(i).any(|n| finite[n])).collect();
    while !rim.is_empty() {
        for plane in planes.chunks_mut(pixels) {
            let mean = |&i: &usize| {
                let valid = around(i).filter(|&n| finite[n]).map(|n| f64::from(plane[n]));
                let (sum, count) = valid.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
                (sum / count) as f32
            };
            let means: Vec<f32> = rim.iter().map(mean).collect();
            rim.iter().zip(means).for_each(|(&i, mean)| plane[i] = mean);
        }
        rim.iter().for_each(|&i| finite[i] = true);
        rim = rim.iter().flat_map(|&i| around(i)).filter(|&n| !finite[n]).collect();
        rim.sort_unstable();
        rim.dedup();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 5, height: 4, channels: 2 };

    #[test]
    fn the_rim_of_a_patch_comes_first_and_all_channels_of_a_pixel_are_filled() {
        let mut planes: Vec<f32> = (0..40).map(|i| (i % 20) as f32).collect();
        let valid = planes.clone();
        // The first column and half of the next.
        for i in [0, 1, 5, 6, 10, 15] {
            planes[i] = f32::NAN;
        }
        planes[20 + 8] = f32::INFINITY;
        let found = find(&planes, SIZE).unwrap();
        assert_eq!((found.count, found.first), (7, 0));
        fill(&mut planes, SIZE).unwrap();
        assert!(find(&planes, SIZE).is_none());
        for channel in planes.chunks(20) {
            assert_eq!(channel[1], (2.0 + 7.0) / 2.0);
            assert_eq!(channel[6], (2.0 + 7.0 + 11.0 + 12.0) / 4.0);
            assert_eq!(channel[0], (channel[1] + channel[6] + channel[5]) / 3.0);
            assert_eq!(channel[8], (2.0 + 3.0 + 4.0 + 7.0 + 9.0 + 12.0 + 13.0 + 14.0) / 8.0);
            assert_eq!(channel[9], valid[9]);
        }
    }

    #[test]
    fn nothing_can_be_spread_where_nothing_is_valid() {
        assert!(fill(&mut [f32::NAN; 40], SIZE).is_err());
    }
}
