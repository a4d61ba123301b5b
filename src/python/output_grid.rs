//! The relation of the given picture to the output: its margin, and its finer pixels.

use crate::optics;
use crate::picture::Size;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The margin and the super-sampling of the given picture relative to the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputGrid {
    /// Pixels of margin on every side, which are not part of the output.
    pub overscan: usize,
    /// Pixels of the picture per pixel of the output, along each axis.
    pub supersample: usize,
}

impl OutputGrid {
    pub fn new(size: Size, overscan: usize, supersample: usize) -> PyResult<OutputGrid> {
        if !(1..=16).contains(&supersample) {
            return Err(PyValueError::new_err(format!(
                "supersample must be from 1 to 16; got {supersample}"
            )));
        }
        if !size.width.is_multiple_of(supersample) || !size.height.is_multiple_of(supersample) {
            return Err(PyValueError::new_err(format!(
                "supersample={supersample} must divide the rows and columns of color; got {} and {}",
                size.height, size.width
            )));
        }
        let smaller = size.width.min(size.height) / supersample;
        if overscan.saturating_mul(2) >= smaller {
            return Err(PyValueError::new_err(format!(
                "overscan must leave a picture: twice {overscan} is not less than {smaller} pixels"
            )));
        }
        Ok(OutputGrid { overscan, supersample })
    }

    /// Size of the output with its margin.
    pub fn resolved(&self, size: Size) -> Size {
        Size { width: size.width / self.supersample, height: size.height / self.supersample, ..size }
    }

    /// The frame for the lens: its field of view spans the output, and the picture subdivides the output's pixels.
    pub fn geometry(&self, size: Size) -> optics::Frame {
        let Size { width, height, .. } = self.resolved(size);
        let (width, height) = (width - 2 * self.overscan, height - 2 * self.overscan);
        optics::Frame { width, height, finer: self.supersample, margin: self.overscan }
    }
}
