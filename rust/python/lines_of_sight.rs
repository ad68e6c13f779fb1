//! Where rays end beside points.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{borrowed_rows, to_array2};
use super::calls::{detached, value_error};
use crate::lines_of_sight::{self, Beside};

#[pyfunction]
pub(super) fn count_beside<'py>(
    py: Python<'py>,
    rays: PyReadonlyArray2<f32>,
    points: PyReadonlyArray2<f32>,
    angle: f64,
    max_rays: usize,
    same_m: f64,
    same_share: f64,
) -> PyResult<Bound<'py, PyArray2<u16>>> {
    if !(1e-3..1.0).contains(&angle) {
        return Err(value_error(format!("found an angle of {angle}, needed 0.001 to 1 radians")));
    }
    let (rays, points) = (borrowed_rows::<3, _>("rays", &rays)?, borrowed_rows::<3, _>("points", &points)?);
    let beside = Beside { angle, max_rays, same_m, same_share };
    to_array2(py, &detached(|| lines_of_sight::count_beside(&rays, &points, &beside)))
}
