//! The LiDAR's motion.

use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{borrowed_rows, to_array2};
use super::errors::value_error;
use super::poses::isometry;
use super::threads::detached;
use crate::motion::Trajectory;

#[pyclass(name = "Trajectory", frozen)]
pub(super) struct PyTrajectory(pub(super) Trajectory);

#[pymethods]
impl PyTrajectory {
    #[staticmethod]
    fn constant(twist_per_s: [f64; 6], stamp: f64) -> Self {
        Self(Trajectory::constant(twist_per_s.into(), stamp))
    }

    #[staticmethod]
    fn through(stamps: Vec<f64>, poses: Vec<PyReadonlyArray2<f64>>) -> PyResult<Self> {
        let poses = poses.iter().map(isometry).collect::<PyResult<Vec<_>>>()?;
        Ok(Self(Trajectory::through(&stamps, &poses)?))
    }

    fn twist_at(&self, stamp: f64) -> PyResult<[f64; 6]> {
        let twist = self.0.twist_at(stamp).ok_or_else(|| value_error(format!("found no pose at {stamp}")))?;
        Ok(twist.into())
    }

    fn compensate<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        times: PyReadonlyArray1<f64>,
        moment: f64,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (points, times) = (borrowed_rows::<3, _>("points", &points)?, times.as_slice()?);
        if points.len() != times.len() {
            return Err(value_error(format!("{} points need as many times", points.len())));
        }
        let moved = detached(py, || self.0.compensate(&points, times, moment))
            .map_err(|time| value_error(format!("nothing is known of the motion at {time} s")))?;
        to_array2(py, &moved)
    }
}
