//! All frames, as the core keeps them.

use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{dense_image, rows};
use super::camera::PyCamera;
use super::errors::value_error;
use super::labels::PyClassShares;
use crate::observation::{Frame, Observations};

#[pyclass(name = "Observations", frozen)]
pub(super) struct PyObservations(pub(super) Arc<Observations>);

#[pymethods]
impl PyObservations {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        camera: &PyCamera,
        points: Vec<PyReadonlyArray2<f32>>,
        point_classes: Vec<PyReadonlyArray1<u8>>,
        image_classes: Vec<PyReadonlyArray2<u8>>,
        num_point_classes: usize,
        num_image_classes: usize,
        point_shares: Vec<Option<PyRef<'_, PyClassShares>>>,
        image_shares: Vec<Option<PyRef<'_, PyClassShares>>>,
    ) -> PyResult<Self> {
        let lengths = [point_classes.len(), image_classes.len(), point_shares.len(), image_shares.len()];
        if lengths.iter().any(|&length| length != points.len()) {
            return Err(value_error("points, classes and shares differ in length"));
        }
        let shares = |of: &Option<PyRef<'_, PyClassShares>>| of.as_ref().map(|shares| shares.0.clone());
        let frames: PyResult<Vec<Frame>> = (0..points.len())
            .map(|i| {
                Ok(Frame {
                    points: rows("points", &points[i])?,
                    point_classes: point_classes[i].as_array().to_vec(),
                    image_classes: dense_image(&image_classes[i]),
                    point_shares: shares(&point_shares[i]),
                    image_shares: shares(&image_shares[i]),
                })
            })
            .collect();
        let camera = camera.0.clone();
        let observations = Observations::new(camera, frames?, num_point_classes, num_image_classes)?;
        Ok(Self(Arc::new(observations)))
    }
}
