//! Motion of the LiDAR, and its compensation in sweeps and for a rolling shutter.

use geometry::shutter::{Direction, Shutter};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{Pose, borrowed_rows, to_array2};
use super::calls::{detached, value_error};
use super::camera::PyCamera;
use super::configs::Foreign;
use crate::error::{Error, Result};
use crate::motion::Trajectory;
use crate::rolling_shutter::RollingCamera;

#[pyclass(name = "Trajectory", frozen)]
pub(super) struct PyTrajectory(pub(super) Trajectory);

#[pymethods]
impl PyTrajectory {
    #[staticmethod]
    fn constant(twist_per_s: [f64; 6], stamp: f64) -> Self {
        Self(Trajectory::constant(twist_per_s.into(), stamp))
    }

    #[staticmethod]
    fn through(stamps: Vec<f64>, poses: Vec<Pose>) -> Result<Self> {
        let poses: Vec<_> = poses.iter().map(|pose| pose.0).collect();
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
            return Err(value_error(format!("{} points need the same number of times", points.len())));
        }
        let moved = detached(|| self.0.compensate(&points, times, moment))
            .map_err(|time| value_error(format!("the motion at {time} s is unknown")))?;
        to_array2(py, &moved)
    }
}

type Moved<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f64>>);

#[pyfunction]
pub(super) fn unroll<'py>(
    py: Python<'py>,
    camera: &PyCamera,
    readout: (f64, Foreign<Direction>),
    points: PyReadonlyArray2<f32>,
    seen_s: PyReadonlyArray1<f64>,
    twist_per_s: [f64; 6],
    t_camera_lidar: Pose,
) -> PyResult<Moved<'py>> {
    let (readout_s, Foreign(direction)) = readout;
    let shutter = Shutter { delay_s: 0.0, readout_s, direction };
    shutter.check().map_err(Error::from)?;
    let (twist_per_s, pose) = (twist_per_s.into(), t_camera_lidar.0);
    let rolling = RollingCamera { camera: &camera.0, shutter, twist_per_s, pose };
    let (points, seen_s) = (borrowed_rows("points", &points)?, seen_s.as_slice()?);
    if points.len() != seen_s.len() {
        return Err(value_error(format!("{} points need the same number of times", points.len())));
    }
    let (moved, exposed_s): (Vec<_>, Vec<_>) =
        detached(|| rolling.unroll(&points, seen_s)).into_iter().unzip();
    Ok((to_array2(py, &moved)?, exposed_s.into_pyarray(py)))
}
