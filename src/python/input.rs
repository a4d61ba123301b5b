//! The picture and its depth as the caller gave them, without a lens.

use super::color::{ColorFormat, brighter_than_usual, color_shape, read_format, read_layer_color};
use super::depth::read_depth;
use super::holdout::Holdout;
use super::invalid_color::{InvalidColor, InvalidPixels};
use super::refine::{Refining, one_layer};
use super::run::installed;
use super::samples::array;
use crate::depth::{DepthKind, Invalid, Rays, disparity_plane};
use crate::memory::Buffer;
use crate::picture::{KnownCoverage, Layer, Picture, Size};
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;

/// Colour and depth as they were read, before they are used with a lens.
pub struct Input {
    pub size: Size,
    pub format: ColorFormat,
    /// The factor by which the given colours are brighter than the rendered ones; a power of two.
    pub brighter: f32,
    /// Number of pixels whose colour was invalid and is the mean of those around.
    pub filled_pixels: usize,
    /// Colour planes of each layer.
    color: Vec<Arc<Buffer<f32>>>,
    /// Raw depth of each layer.
    depth: Vec<Buffer<f32>>,
    /// What refining has found of edges.
    edges: Arc<Vec<KnownCoverage>>,
    /// What blocks its light.
    pub holdout: Option<Holdout>,
}

impl Input {
    /// Reads and checks both arrays, and refines the depth if that is asked for.
    pub fn read(
        color: &Bound<'_, PyAny>,
        (depth, kind): (&Bound<'_, PyAny>, DepthKind),
        alpha: Option<&str>,
        transfer: Option<&str>,
        invalid: InvalidColor,
        refining: Option<Refining>,
    ) -> PyResult<Input> {
        let array = &array("color", color)?;
        let shape = color_shape(array.shape())?;
        let format = read_format(array, &shape, alpha, transfer)?;
        let mut planes = read_depth(depth, kind)?;
        let expected = (shape.layers, shape.size.height, shape.size.width);
        if refining.is_none() && (planes.planes.len(), planes.height, planes.width) != expected {
            return Err(PyValueError::new_err(format!(
                "depth must have the same layers, rows and columns as color, whose shape is {}; got shape {}; \
                 refine=True takes depth of one layer at any size",
                color.getattr("shape")?,
                depth.getattr("shape")?,
            )));
        }
        let (mut largest, mut filled) = (0.0, None);
        let mut color = Vec::new();
        for layer in 0..shape.layers {
            let (planes, of_layer, found) = read_layer_color(array, &shape, layer, &format, invalid)?;
            color.push(planes);
            largest = of_layer.max(largest);
            filled = [filled, found].into_iter().flatten().reduce(InvalidPixels::and);
        }
        if let Some(filled) = filled {
            filled.warn(array.py(), shape.size)?;
        }
        let mut edges = Arc::default();
        if let Some(refining) = refining {
            let lights = format.lights(shape.size) * shape.size.pixels();
            if shape.layers > 1 {
                return Err(one_layer(shape.layers));
            }
            let (refined, found) = refining.refined(array.py(), &planes, &color[0][..lights], shape.size)?;
            planes.planes = vec![refined];
            edges = Arc::new(found.map_or_else(Vec::new, |edges| edges.known()));
        }
        let brighter = brighter_than_usual(largest);
        if brighter > 1.0 {
            let lights = format.lights(shape.size) * shape.size.pixels();
            let planes = color.iter_mut().map(|planes| &mut planes[..lights]);
            planes.for_each(|planes| planes.iter_mut().for_each(|v| *v /= brighter));
        }
        let color = color.into_iter().map(Arc::new).collect();
        let filled_pixels = filled.map_or(0, |filled| filled.count);
        Ok(Input {
            size: shape.size,
            format,
            brighter,
            filled_pixels,
            color,
            depth: planes.planes,
            edges,
            holdout: None,
        })
    }

    /// The raw depth of each layer.
    pub fn depth(&self) -> Vec<&[f32]> {
        self.depth.iter().map(|plane| &plane[..]).collect()
    }

    /// How much of each pixel of each layer a mean counts: its coverage, if the colours have one. Where a holdout blocks what
    /// lies behind it, a mean has to know how much it has seen, if of whole pixels. Empty if all counts alike.
    pub fn seen(&self) -> Vec<Cow<'_, [f32]>> {
        let lights = self.format.lights(self.size) * self.size.pixels();
        let coverage = self.color.iter().map(|planes| &planes[lights..]);
        if lights < self.size.channels * self.size.pixels() {
            coverage.map(Cow::Borrowed).collect()
        } else if self.holdout.is_some() {
            coverage.map(|_| Cow::Owned(vec![1.0; self.size.pixels()])).collect()
        } else {
            Vec::new()
        }
    }

    /// The number of layers.
    pub fn layers(&self) -> usize {
        self.color.len()
    }

    /// The picture with disparity. Kinds of depth that are measured along the ray need `rays`.
    pub fn picture(&self, kind: DepthKind, rays: Option<Rays>, invalid: Invalid) -> PyResult<Picture> {
        let size = self.size;
        let layered = self.color.len() > 1;
        if layered && kind == DepthKind::Relative {
            return Err(PyValueError::new_err(
                "depth_kind=\"relative\" brings one picture's disparity to 0 to 1, and cannot be used with layers; \
                 pass depth_range",
            ));
        }
        let layers = self
            .color
            .iter()
            .zip(&self.depth)
            .map(|(color, depth)| {
                // Where a layer has no surface, its depth is meaningless.
                let mut depth = Cow::Borrowed(depth);
                if layered {
                    let alpha = &color[size.pixels() * (size.channels - 1)..];
                    let values = depth.to_mut().iter_mut();
                    values.zip(alpha).filter(|(_, a)| **a <= 0.0).for_each(|(d, _)| *d = kind.background());
                }
                let disparity = installed(|| disparity_plane(&depth, size.width, kind, rays, invalid))??;
                Ok(Layer::new(Arc::clone(color), disparity))
            })
            .collect::<PyResult<Vec<_>>>()?;
        let holdout = self.holdout.as_ref();
        let holdouts =
            holdout.map_or(Ok(Vec::new()), |holdout| holdout.layers(size.width, kind, rays, invalid));
        Ok(Picture {
            holdouts: Arc::new(holdouts?),
            edges: Arc::clone(&self.edges),
            ..Picture::new(size, layers)
        })
    }
}
