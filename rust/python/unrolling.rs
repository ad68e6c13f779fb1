//! Compensation of a rolling shutter.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{borrowed_rows, to_array2};
use super::camera::PyCamera;
use super::configs::direction;
use super::errors::value_error;
use super::poses::isometry;
use super::threads::detached;
use crate::shutter::Shutter;
use crate::unrolling::Rolling;

type Moved<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f64>>);

#[pyfunction]
#[pyo3(signature = (camera, readout, points, seen_s, twist_per_s, t_camera_lidar))]
pub(super) fn unroll<'py>(
    py: Python<'py>,
    camera: &PyCamera,
    readout: (f64, String),
    points: PyReadonlyArray2<f32>,
    seen_s: PyReadonlyArray1<f64>,
    twist_per_s: [f64; 6],
    t_camera_lidar: PyReadonlyArray2<f64>,
) -> PyResult<Moved<'py>> {
    let shutter = Shutter { delay_s: 0.0, readout_s: readout.0, direction: direction(&readout.1)? };
    shutter.check()?;
    let rolling = Rolling {
        camera: &camera.0,
        shutter,
        twist_per_s: twist_per_s.into(),
        pose: isometry(&t_camera_lidar)?,
    };
    let (points, seen_s) = (borrowed_rows("points", &points)?, seen_s.as_slice()?);
    if points.len() != seen_s.len() {
        return Err(value_error(format!("{} points need as many times", points.len())));
    }
    let (moved, exposed_s): (Vec<_>, Vec<_>) =
        detached(py, || rolling.unroll(&points, seen_s)).into_iter().unzip();
    Ok((to_array2(py, &moved)?, exposed_s.into_pyarray(py)))
}
