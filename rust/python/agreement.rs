//! Agreement of points and label images at a pose.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::errors::value_error;
use super::observations::PyObservations;
use super::poses::isometry;
use super::threads::detached;
use crate::agreement::{HeldOutGain, held_out_gain as measure_gain, measure as measure_agreement};
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
pub(super) fn held_out_gain(
    py: Python<'_>,
    observations: &PyObservations,
    held_out: &PyObservations,
    before: PyReadonlyArray2<f64>,
    after: PyReadonlyArray2<f64>,
) -> PyResult<PyHeldOutGain> {
    let (before, after) = (isometry(&before)?, isometry(&after)?);
    let num_classes =
        |observations: &Observations| (observations.num_point_classes, observations.num_image_classes);
    if num_classes(&observations.0) != num_classes(&held_out.0) {
        return Err(value_error("the held-out observations have other numbers of classes"));
    }
    let found = detached(py, || measure_gain(&observations.0, &held_out.0, &before, &after));
    Ok(found.into())
}
