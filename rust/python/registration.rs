//! Spherical images and their grids, the registration of label images with them, and the resulting correspondences.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{Pose, borrowed_sweeps, to_array2};
use super::calls::detached;
use super::observations::PyObservations;
use crate::correspondences::{self, Correspondence};
use crate::error::Result;
use crate::registration::{self, Hypothesis, RegistrationConfig};
use crate::spherical::{self, SphericalGrid, SphericalImages};
use crate::zoom::Zoom;

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
    fn new(observations: &PyObservations, grid: &PyGrid) -> Self {
        Self(detached(|| SphericalImages::new(&observations.0, grid.core())))
    }
}

#[pyfunction]
pub(super) fn scan_grid(channels: usize, columns: usize, fov_up: f64, fov_down: f64) -> Result<PyGrid> {
    SphericalGrid::from_scan(channels, columns, fov_up, fov_down).map(PyGrid::new)
}

#[pyfunction]
pub(super) fn estimate_grid(points: Vec<PyReadonlyArray2<f32>>) -> PyResult<PyGrid> {
    let sweeps = borrowed_sweeps(&points)?;
    let sweeps: Vec<&[[f32; 3]]> = sweeps.iter().map(AsRef::as_ref).collect();
    Ok(PyGrid::new(detached(|| spherical::estimate(&sweeps))?))
}

#[pyclass(name = "Hypothesis", frozen)]
pub(super) struct PyHypothesis(pub(super) Hypothesis);

#[pymethods]
impl PyHypothesis {
    #[getter]
    fn mutual_information(&self) -> f64 {
        self.0.mutual_information
    }

    #[getter]
    fn num_pairs(&self) -> usize {
        self.0.num_pairs as usize
    }
}

#[pyclass(name = "Correspondences", frozen, get_all)]
pub(super) struct PyCorrespondences {
    points: Py<PyArray2<f64>>,
    pixels: Py<PyArray2<f64>>,
}

impl PyCorrespondences {
    fn new(py: Python<'_>, pairs: &[Correspondence]) -> PyResult<Self> {
        let points: Vec<[f64; 3]> = pairs.iter().map(|pair| pair.point.map(f64::from)).collect();
        let pixels: Vec<[f64; 2]> = pairs.iter().map(|pair| [pair.pixel.x, pair.pixel.y]).collect();
        Ok(Self { points: to_array2(py, &points)?.unbind(), pixels: to_array2(py, &pixels)?.unbind() })
    }
}

#[pyfunction]
#[pyo3(signature = (observations, images, config, around=None))]
pub(super) fn register(
    observations: &PyObservations,
    images: &PySphericalImages,
    config: RegistrationConfig,
    around: Option<(Pose, f64)>,
) -> PyResult<Vec<PyHypothesis>> {
    let around = around.map(|(pose, angle)| (pose.0.rotation.to_rotation_matrix(), angle));
    let hypotheses = detached(|| registration::register(&observations.0, &images.0, &config, around))?;
    Ok(hypotheses.into_iter().map(PyHypothesis).collect())
}

#[pyfunction]
pub(super) fn sample_correspondences(
    py: Python<'_>,
    observations: &PyObservations,
    images: &PySphericalImages,
    zoom: Zoom,
    hypotheses: Vec<PyRef<'_, PyHypothesis>>,
    count: usize,
    seed: u64,
) -> PyResult<Vec<PyCorrespondences>> {
    let hypotheses: Vec<Hypothesis> = hypotheses.iter().map(|h| h.0.clone()).collect();
    let samples =
        detached(|| correspondences::sample(&observations.0, &images.0, zoom, &hypotheses, count, seed))?;
    samples.iter().map(|pairs| PyCorrespondences::new(py, pairs)).collect()
}
