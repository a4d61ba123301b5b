//! Holdouts: what blocks the light of a picture and is not seen itself; read and checked.

use super::depth::read_planes;
use super::errors::{reworded, shown};
use super::run::installed;
use crate::depth::{DepthKind, Invalid, Rays, disparity_plane};
use crate::memory::Buffer;
use crate::method::Method;
use crate::picture::{Layer, Size};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};
use std::sync::Arc;

/// The arrays of a holdout as they were read, before they are used with a lens.
pub struct Holdout {
    /// Coverage and raw depth of each layer.
    layers: Vec<(Arc<Buffer<f32>>, Buffer<f32>)>,
}

impl Holdout {
    /// Reads a pair of alpha and depth for a picture of this size.
    pub fn read(given: &Bound<'_, PyAny>, size: Size) -> PyResult<Holdout> {
        let is_sequence = given.is_instance_of::<PyTuple>() || given.is_instance_of::<PyList>();
        if !is_sequence || given.len()? != 2 {
            return Err(PyTypeError::new_err(format!(
                "holdout must be a pair (alpha, depth) of arrays; got {}",
                shown(given)
            )));
        }
        let alpha = read_planes("alpha of holdout", &given.get_item(0)?)?;
        let depth = read_planes("depth of holdout", &given.get_item(1)?)?;
        let (width, height) = (size.width, size.height);
        for (name, planes) in [("alpha", &alpha), ("depth", &depth)] {
            let shape = (planes.planes.len(), planes.height, planes.width);
            if shape != (alpha.planes.len(), height, width) {
                return Err(PyValueError::new_err(format!(
                    "{name} of holdout must have the rows and columns of color, {height} x {width}, and alpha and \
                     depth as many layers; got {} x {} in {} layers",
                    shape.1, shape.2, shape.0
                )));
            }
        }
        for plane in &alpha.planes {
            if let Some(i) = plane.iter().position(|a| !(0.0..=1.0 + 1e-3).contains(a)) {
                return Err(PyValueError::new_err(format!(
                    "alpha of holdout must be from 0 to 1; got {} at row {}, column {}",
                    plane[i],
                    i / width,
                    i % width
                )));
            }
        }
        let alpha = alpha.planes.into_iter().map(Arc::new);
        let layers = alpha.zip(depth.planes).filter(|(alpha, _)| alpha.iter().any(|a| *a > 0.0));
        Ok(Holdout { layers: layers.collect() })
    }

    /// Refuses methods that render one layer.
    pub fn check(method: &Method) -> PyResult<()> {
        match method {
            Method::Lens(_) => Ok(()),
            _ => Err(PyValueError::new_err(format!(
                "holdout is for method=\"lens\"; got method={:?}",
                method.name()
            ))),
        }
    }

    /// The layers with their disparity. Kinds of depth that are measured along the ray need `rays`.
    pub fn layers(
        &self,
        width: usize,
        kind: DepthKind,
        rays: Option<Rays>,
        invalid: Invalid,
    ) -> PyResult<Vec<Layer>> {
        if kind == DepthKind::Relative {
            return Err(PyValueError::new_err(
                "depth_kind=\"relative\" brings one picture's disparity to 0 to 1, and cannot be used with holdout; pass \
                 depth_range",
            ));
        }
        let layer = |(coverage, depth): &(Arc<Buffer<f32>>, Buffer<f32>)| {
            // Where nothing is covered, depth is meaningless.
            let mut depth = depth.clone();
            let uncovered = depth.iter_mut().zip(coverage.iter()).filter(|(_, a)| **a <= 0.0);
            uncovered.for_each(|(d, _)| *d = kind.background());
            let disparity = installed(|| disparity_plane(&depth, width, kind, rays, invalid))?;
            let disparity = disparity.map_err(|error| of_holdout(error.into()))?;
            Ok(Layer::new(Arc::clone(coverage), disparity))
        };
        self.layers.iter().map(layer).collect()
    }
}

/// What an error says of `depth` is said of the holdout's.
fn of_holdout(error: PyErr) -> PyErr {
    Python::attach(|py| match error.value(py).to_string().strip_prefix("depth") {
        Some(rest) => reworded(py, &error, format!("depth of holdout{rest}")),
        None => error,
    })
}
