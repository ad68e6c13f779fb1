//! Spherical images and their grids.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{borrowed_rows, image_array};
use super::errors::value_error;
use super::observations::PyObservations;
use super::threads::detached;
use crate::error::Result;
use crate::spherical::{self, SphericalGrid, SphericalImages};

#[pyclass(name = "Grid", frozen, get_all)]
pub(super) struct PyGrid {
    rows: usize,
    columns: usize,
    top: f64,
    cell_height: f64,
}

impl PyGrid {
    fn new(grid: SphericalGrid) -> Self {
        let SphericalGrid { rows, columns, top, cell_height } = grid;
        Self { rows, columns, top, cell_height }
    }

    fn core(&self) -> SphericalGrid {
        let Self { rows, columns, top, cell_height } = *self;
        SphericalGrid { rows, columns, top, cell_height }
    }
}

#[pyclass(name = "SphericalImages", frozen)]
pub(super) struct PySphericalImages(pub(super) SphericalImages);

#[pymethods]
impl PySphericalImages {
    #[new]
    fn new(py: Python<'_>, observations: &PyObservations, grid: &PyGrid) -> Self {
        Self(detached(py, || SphericalImages::new(&observations.0, grid.core())))
    }

    #[getter]
    fn grid(&self) -> PyGrid {
        PyGrid::new(self.0.grid)
    }

    fn classes<'py>(&self, py: Python<'py>, frame: usize) -> PyResult<Bound<'py, PyArray2<u8>>> {
        if frame >= self.0.returns.len() {
            return Err(value_error(format!("frame {frame} is not one of {}", self.0.returns.len())));
        }
        image_array(py, self.0.label_image(frame))
    }
}

#[pyfunction]
pub(super) fn scan_grid(channels: usize, columns: usize, fov_up: f64, fov_down: f64) -> Result<PyGrid> {
    SphericalGrid::from_scan(channels, columns, fov_up, fov_down).map(PyGrid::new)
}

#[pyfunction]
pub(super) fn estimate_grid(py: Python<'_>, points: Vec<PyReadonlyArray2<f32>>) -> PyResult<PyGrid> {
    let sweeps = points.iter().map(|sweep| borrowed_rows("points", sweep)).collect::<PyResult<Vec<_>>>()?;
    let sweeps: Vec<&[[f32; 3]]> = sweeps.iter().map(AsRef::as_ref).collect();
    Ok(PyGrid::new(detached(py, || spherical::estimate(&sweeps))?))
}
