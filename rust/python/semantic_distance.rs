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

#[pyclass(name = "DistanceMinimum", frozen, get_all)]
pub(super) struct PyDistanceMinimum {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Py<PyArray2<f64>>,
    cost_px: f64,
    num_evaluations: usize,
    converged: bool,
}

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

    fn minimize(
        &self,
        py: Python<'_>,
        t_camera_lidar: PyReadonlyArray2<f64>,
        config: DescentConfig,
    ) -> PyResult<PyDistanceMinimum> {
        let start = isometry(&t_camera_lidar)?;
        let found = detached(py, || self.0.minimize(&start, &config))?;
        Ok(PyDistanceMinimum {
            t_camera_lidar: matrix(py, &found.pose)?.unbind(),
            cost_px: found.cost_px,
            num_evaluations: found.num_evaluations,
            converged: found.converged,
        })
    }
}
