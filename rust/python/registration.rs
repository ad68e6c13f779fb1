//! The registration of label images with spherical images, and the correspondences from it.

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{image_array, to_array2};
use super::errors::value_error;
use super::observations::PyObservations;
use super::poses::isometry;
use super::spherical::PySphericalImages;
use super::threads::detached;
use crate::correspondences::{self, Correspondence};
use crate::registration::{self, Hypothesis, RegistrationConfig};
use crate::zoom::{self, Zoom, Zoomed};

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

    fn zoomed<'py>(
        &self,
        py: Python<'py>,
        observations: &PyObservations,
        images: &PySphericalImages,
        zoom: Zoom,
        frame: usize,
    ) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let observations = &observations.0;
        let Some(shown) = observations.frames.get(frame) else {
            return Err(value_error(format!("frame {frame} is not one of {}", observations.frames.len())));
        };
        let zoomed = Zoomed::new(&observations.camera, zoom)?;
        image_array(py, zoom::zoom(&zoomed, &shown.image.classes, &self.0.placement, &images.0.grid))
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
    py: Python<'_>,
    observations: &PyObservations,
    images: &PySphericalImages,
    config: RegistrationConfig,
    around: Option<(PyReadonlyArray2<f64>, f64)>,
) -> PyResult<Vec<PyHypothesis>> {
    let around = match &around {
        Some((pose, angle)) => Some((isometry(pose)?.rotation.to_rotation_matrix(), *angle)),
        None => None,
    };
    let found = detached(py, || registration::register(&observations.0, &images.0, &config, around))?;
    Ok(found.into_iter().map(PyHypothesis).collect())
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
        detached(py, || correspondences::sample(&observations.0, &images.0, zoom, &hypotheses, count, seed))?;
    samples.iter().map(|pairs| PyCorrespondences::new(py, pairs)).collect()
}
