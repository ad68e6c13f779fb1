//! The cost of SOIC and its minimum.

use std::sync::Arc;

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::rows;
use super::camera::PyCamera;
use super::errors::value_error;
use super::poses::{isometry, matrix};
use super::threads::detached;
use crate::semantic_distance::{ClassInFrame, DescentConfig, SemanticDistance};

#[pyclass(name = "SemanticDistance", frozen)]
pub(super) struct PySemanticDistance(pub(super) SemanticDistance);

#[pymethods]
impl PySemanticDistance {
    #[new]
    #[pyo3(signature = (camera, parts, *, block))]
    fn new(
        camera: &PyCamera,
        parts: Vec<(usize, PyReadonlyArray2<f32>, PyReadonlyArray2<f32>)>,
        block: usize,
    ) -> PyResult<Self> {
        let part = |(class, points, distances): &(usize, PyReadonlyArray2<f32>, PyReadonlyArray2<f32>)| {
            let distances = distances.as_array();
            if block == 0 || distances.is_empty() {
                return Err(value_error("blocks and distance fields need a size"));
            }
            let distances = Arc::new(distances.rows().into_iter().map(|row| row.to_vec()).collect());
            Ok(ClassInFrame { class: *class, points: rows("points", points)?, distances })
        };
        let parts: PyResult<Vec<ClassInFrame>> = parts.iter().map(part).collect();
        Ok(Self(SemanticDistance::new(camera.0.clone(), parts?, block)))
    }

    fn at(&self, py: Python<'_>, t_camera_lidar: PyReadonlyArray2<f64>) -> PyResult<f64> {
        let pose = isometry(&t_camera_lidar)?;
        Ok(detached(py, || self.0.at(&pose)))
    }

    #[pyo3(signature = (t_camera_lidar, *, step_rad, step_m, tolerance, max_rounds, max_restarts, max_points))]
    #[allow(clippy::too_many_arguments)]
    fn minimize<'py>(
        &self,
        py: Python<'py>,
        t_camera_lidar: PyReadonlyArray2<f64>,
        step_rad: f64,
        step_m: f64,
        tolerance: f64,
        max_rounds: usize,
        max_restarts: usize,
        max_points: usize,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, usize, bool)> {
        if max_points == 0 {
            return Err(value_error("max_points needs to be at least 1"));
        }
        let start = isometry(&t_camera_lidar)?;
        let step = (step_rad, step_m);
        let config = DescentConfig { step, tolerance, max_rounds, max_restarts, max_points };
        let found = detached(py, || self.0.minimize(&start, &config))?;
        Ok((matrix(py, &found.pose)?, found.cost, found.num_evaluations, found.converged))
    }
}
