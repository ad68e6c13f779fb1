//! Spherical images and their grids.

use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::rows;
use super::observations::PyObservations;
use super::threads::detached;
use crate::spherical::{self, SphericalGrid, SphericalImages};

#[pyclass(name = "SphericalImages", frozen)]
pub(super) struct PySphericalImages(pub(super) SphericalImages);

#[pymethods]
impl PySphericalImages {
    #[new]
    fn new(py: Python<'_>, observations: &PyObservations, grid: (usize, usize, f64, f64)) -> Self {
        Self(detached(py, || SphericalImages::new(&observations.0, to_grid(grid))))
    }
}

#[pyfunction]
pub(super) fn scan_grid(
    channels: usize,
    columns: usize,
    fov_up: f64,
    fov_down: f64,
) -> PyResult<(usize, usize, f64, f64)> {
    Ok(from_grid(&SphericalGrid::from_scan(channels, columns, fov_up, fov_down)?))
}

#[pyfunction]
pub(super) fn estimate_grid(
    py: Python<'_>,
    observations: &PyObservations,
) -> PyResult<(usize, usize, f64, f64)> {
    let sweeps: Vec<&[[f32; 3]]> = observations.0.frames.iter().map(|f| f.points.as_slice()).collect();
    Ok(from_grid(&detached(py, || spherical::estimate(&sweeps))?))
}

#[pyfunction]
pub(super) fn spherical_image<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<f32>,
    grid: (usize, usize, f64, f64),
) -> PyResult<Bound<'py, PyArray2<u32>>> {
    let (points, grid) = (rows("points", &points)?, to_grid(grid));
    grid.project(&points).into_pyarray(py).reshape([grid.rows, grid.columns])
}

pub(super) fn to_grid((rows, columns, top, cell_height): (usize, usize, f64, f64)) -> SphericalGrid {
    SphericalGrid { rows, columns, top, cell_height }
}

pub(super) fn from_grid(grid: &SphericalGrid) -> (usize, usize, f64, f64) {
    (grid.rows, grid.columns, grid.top, grid.cell_height)
}
