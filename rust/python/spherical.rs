//! Spherical images and their grids.

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use super::arrays::rows;
use super::observations::PyObservations;
use super::threads::detached;
use crate::error::Result;
use crate::spherical::{self, SphericalGrid, SphericalImages};

#[pyclass(name = "Grid", frozen)]
pub(super) struct PyGrid(SphericalGrid);

#[pymethods]
impl PyGrid {
    #[getter]
    fn rows(&self) -> usize {
        self.0.rows
    }

    #[getter]
    fn columns(&self) -> usize {
        self.0.columns
    }

    #[getter]
    fn top(&self) -> f64 {
        self.0.top
    }

    #[getter]
    fn cell_height(&self) -> f64 {
        self.0.cell_height
    }
}

#[pyclass(name = "SphericalImages", frozen)]
pub(super) struct PySphericalImages(pub(super) SphericalImages);

#[pymethods]
impl PySphericalImages {
    #[new]
    fn new(py: Python<'_>, observations: &PyObservations, grid: &PyGrid) -> Self {
        Self(detached(py, || SphericalImages::new(&observations.0, grid.0)))
    }
}

#[pyfunction]
pub(super) fn scan_grid(channels: usize, columns: usize, fov_up: f64, fov_down: f64) -> Result<PyGrid> {
    SphericalGrid::from_scan(channels, columns, fov_up, fov_down).map(PyGrid)
}

#[pyfunction]
pub(super) fn estimate_grid(py: Python<'_>, points: Vec<PyReadonlyArray2<f32>>) -> PyResult<PyGrid> {
    let sweeps = points.iter().map(|sweep| rows("points", sweep)).collect::<PyResult<Vec<_>>>()?;
    let sweeps: Vec<&[[f32; 3]]> = sweeps.iter().map(Vec::as_slice).collect();
    Ok(PyGrid(detached(py, || spherical::estimate(&sweeps))?))
}
