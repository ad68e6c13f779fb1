//! The cost of SOIC and its minimum.

use std::sync::Arc;

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use super::arrays::{Pose, rows};
use super::calls::{detached, value_error};
use super::camera::PyCamera;
use crate::error::Result;
use crate::semantic_distance::{ClassInFrame, DescentConfig, SemanticDistance};

#[pyclass(name = "DistanceMinimum", frozen, get_all)]
pub(super) struct PyDistanceMinimum {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Pose,
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

    fn at(&self, t_camera_lidar: Pose) -> f64 {
        detached(|| self.0.at(&t_camera_lidar.0))
    }

    fn minimize(&self, t_camera_lidar: Pose, config: DescentConfig) -> Result<PyDistanceMinimum> {
        let minimum = detached(|| self.0.minimize(&t_camera_lidar.0, &config))?;
        Ok(PyDistanceMinimum {
            t_camera_lidar: Pose(minimum.pose),
            cost_px: minimum.cost_px,
            num_evaluations: minimum.num_evaluations,
            converged: minimum.converged,
        })
    }
}
