//! The registration of pictures with spherical images, and the correspondences it gives.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::to_array2;
use super::errors::value_error;
use super::observations::PyObservations;
use super::poses::isometry;
use super::spherical::PySphericalImages;
use super::threads::detached;
use crate::correspondences::{self, Correspondence};
use crate::registration::{self, Hypothesis, RegistrationConfig};
use crate::zoom::Zoom;

#[pyclass(name = "Hypothesis", frozen)]
pub(super) struct PyHypothesis(pub(super) Hypothesis);

#[pymethods]
impl PyHypothesis {
    /// Labelled returns, of those that were looked at, that fall on a labelled pixel, over all frames.
    #[getter]
    fn num_pairs(&self) -> usize {
        self.0.num_pairs as usize
    }
}

#[pyfunction]
#[pyo3(signature = (observations, images, *, zoom, coarse_cell, fine_cell, max_roll, roll_step, around, min_cells_of_most,
                    num_hypotheses, separation))]
#[allow(clippy::too_many_arguments)]
pub(super) fn register(
    py: Python<'_>,
    observations: &PyObservations,
    images: &PySphericalImages,
    zoom: &str,
    coarse_cell: f64,
    fine_cell: f64,
    max_roll: f64,
    roll_step: f64,
    around: Option<(PyReadonlyArray2<f64>, f64)>,
    min_cells_of_most: f64,
    num_hypotheses: usize,
    separation: f64,
) -> PyResult<Vec<PyHypothesis>> {
    let around = match &around {
        Some((pose, angle)) => Some((isometry(pose)?.rotation.to_rotation_matrix(), *angle)),
        None => None,
    };
    let config = RegistrationConfig {
        zoom: parse_zoom(zoom)?,
        coarse_cell,
        fine_cell,
        max_roll,
        roll_step,
        around,
        min_cells_of_most,
        num_hypotheses,
        separation,
    };
    let found = detached(py, || registration::register(&observations.0, &images.0, &config))?;
    Ok(found.into_iter().map(PyHypothesis).collect())
}

/// Points (N, 3) and the pixels (N, 2) they correspond to.
pub(super) type PairArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pyfunction]
pub(super) fn sample_correspondences<'py>(
    py: Python<'py>,
    observations: &PyObservations,
    images: &PySphericalImages,
    zoom: &str,
    hypotheses: Vec<PyRef<'py, PyHypothesis>>,
    count: usize,
    seed: u64,
) -> PyResult<Vec<PairArrays<'py>>> {
    let zoom = parse_zoom(zoom)?;
    let hypotheses: Vec<Hypothesis> = hypotheses.iter().map(|h| h.0.clone()).collect();
    let samples =
        detached(py, || correspondences::sample(&observations.0, &images.0, zoom, &hypotheses, count, seed))?;
    let arrays = |pairs: Vec<Correspondence>| {
        let points: Vec<[f64; 3]> = pairs.iter().map(|c| c.point.map(f64::from)).collect();
        let pixels: Vec<[f64; 2]> = pairs.iter().map(|c| [c.pixel.x, c.pixel.y]).collect();
        Ok((to_array2(py, &points)?, to_array2(py, &pixels)?))
    };
    samples.into_iter().map(arrays).collect()
}

pub(super) fn parse_zoom(zoom: &str) -> PyResult<Zoom> {
    match zoom {
        "exact" => Ok(Zoom::Exact),
        "paper" => Ok(Zoom::Paper),
        other => Err(value_error(format!("zoom '{other}' is not known, needs exact or paper"))),
    }
}
