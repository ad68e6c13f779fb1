//! Agreement of points and label images at a pose.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::errors::value_error;
use super::observations::PyObservations;
use super::poses::isometry;
use super::threads::detached;
use crate::agreement::{HeldOut, HeldOutGain, held_out_gain as measure_gain, measure as measure_agreement};
use crate::observation::Observations;

#[pyclass(name = "Agreement", frozen, get_all)]
pub(super) struct PyAgreement {
    mutual_information: f64,
    bias: f64,
    sigma: f64,
    label_agreement: f64,
    overlap: f64,
    num_inside: usize,
    num_hidden: usize,
    joint: Py<PyArray2<f64>>,
    frame_joints: Py<PyArray3<f64>>,
}

#[pyclass(name = "HeldOutGain", frozen, get_all)]
pub(super) struct PyHeldOutGain {
    gain: f64,
    sigma: f64,
}

#[pymethods]
impl PyHeldOutGain {
    /// The sum of the gains of independent parts, with its standard error.
    #[staticmethod]
    fn of_parts(gains: Vec<f64>) -> Self {
        HeldOutGain::of_parts(gains).into()
    }
}

impl From<HeldOutGain> for PyHeldOutGain {
    fn from(found: HeldOutGain) -> Self {
        Self { gain: found.gain, sigma: found.sigma }
    }
}

#[pyfunction]
pub(super) fn agreement(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
) -> PyResult<PyAgreement> {
    let pose = isometry(&t_camera_lidar)?;
    let found = detached(py, || measure_agreement(&observations.0, &pose));
    let shape = [observations.0.num_point_classes, observations.0.num_image_classes];
    let joint = PyArray1::from_slice(py, &found.joint.weights).reshape(shape)?;
    let of_frames: Vec<f64> =
        found.frame_joints.iter().flat_map(|frame| frame.weights.iter().copied()).collect();
    let frame_joints =
        PyArray1::from_vec(py, of_frames).reshape([found.frame_joints.len(), shape[0], shape[1]])?;
    Ok(PyAgreement {
        mutual_information: found.joint.mutual_information(),
        bias: found.joint.bias(),
        sigma: found.sigma,
        label_agreement: found.label_agreement(),
        overlap: found.overlap,
        num_inside: found.num_inside,
        num_hidden: found.num_hidden,
        joint: joint.unbind(),
        frame_joints: frame_joints.unbind(),
    })
}

#[pyfunction]
#[pyo3(signature = (observations, held_out, before, after, seen_after=None))]
pub(super) fn held_out_gain(
    py: Python<'_>,
    observations: &PyObservations,
    held_out: &PyObservations,
    before: PyReadonlyArray2<f64>,
    after: PyReadonlyArray2<f64>,
    seen_after: Option<(PyRef<'_, PyObservations>, PyRef<'_, PyObservations>)>,
) -> PyResult<PyHeldOutGain> {
    let (before, after) = (isometry(&before)?, isometry(&after)?);
    let (observations, held_out) = (&observations.0, &held_out.0);
    let seen = seen_after.as_ref().map(|(observations, held_out)| (&observations.0, &held_out.0));
    let (observations_after, held_out_after) = seen.unwrap_or((observations, held_out));
    let num_classes =
        |observations: &Observations| (observations.num_point_classes, observations.num_image_classes);
    if [held_out, observations_after, held_out_after]
        .iter()
        .any(|each| num_classes(each) != num_classes(observations))
    {
        return Err(value_error("the held-out observations have other numbers of classes"));
    }
    let before = HeldOut { observations, held_out, pose: &before };
    let after = HeldOut { observations: observations_after, held_out: held_out_after, pose: &after };
    Ok(detached(py, || measure_gain(before, after)).into())
}
