//! Agreement at a pose, and mutual information over SE(3): ascent, polish and sensitivity.

use geometry::camera::{Camera, Intrinsic};
use nalgebra::{DMatrix, Vector6};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{Pose, matrix_6x6};
use super::calls::{detached, value_error};
use super::configs::PolishConfig;
use super::observations::PyObservations;
use crate::agreement::{
    HeldOut, InformationGain, held_out_gain as measure_gain, measure as measure_agreement,
};
use crate::alignment::{
    self, AlignmentConfig, Ascended, AscentConfig, Counted, JointMaximum, Line, MAX_VARIABLES, Objective,
    Sensitivity, SensitivityConfig, Variables,
};
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

#[pyclass(name = "InformationGain", frozen, get_all)]
pub(super) struct PyInformationGain {
    gain: f64,
    sigma: f64,
    significance: f64,
}

#[pymethods]
impl PyInformationGain {
    /// The sum of the gains of independent parts, with its standard error.
    #[staticmethod]
    fn of_parts(gains: Vec<f64>) -> Self {
        InformationGain::of_parts(gains).into()
    }
}

impl From<InformationGain> for PyInformationGain {
    fn from(gain: InformationGain) -> Self {
        Self { gain: gain.gain, sigma: gain.sigma, significance: gain.significance() }
    }
}

#[pyfunction]
pub(super) fn agreement(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: Pose,
) -> PyResult<PyAgreement> {
    let measured = detached(|| measure_agreement(&observations.0, &t_camera_lidar.0));
    let shape = [observations.0.num_point_classes, observations.0.num_image_classes];
    let joint = PyArray1::from_slice(py, &measured.joint.weights).reshape(shape)?;
    let of_frames: Vec<f64> =
        measured.frame_joints.iter().flat_map(|frame| frame.weights.iter().copied()).collect();
    let frame_joints =
        PyArray1::from_vec(py, of_frames).reshape([measured.frame_joints.len(), shape[0], shape[1]])?;
    Ok(PyAgreement {
        mutual_information: measured.joint.mutual_information(),
        bias: measured.joint.bias(),
        sigma: measured.sigma,
        label_agreement: measured.label_agreement(),
        overlap: measured.overlap,
        num_inside: measured.num_inside,
        num_hidden: measured.num_hidden,
        joint: joint.unbind(),
        frame_joints: frame_joints.unbind(),
    })
}

#[pyfunction]
#[pyo3(signature = (observations, held_out, before, after, seen_after=None))]
pub(super) fn held_out_gain(
    observations: &PyObservations,
    held_out: &PyObservations,
    before: Pose,
    after: Pose,
    seen_after: Option<(PyRef<'_, PyObservations>, PyRef<'_, PyObservations>)>,
) -> PyResult<PyInformationGain> {
    let (observations, held_out) = (&observations.0, &held_out.0);
    let seen = seen_after.as_ref().map(|(observations, held_out)| (&observations.0, &held_out.0));
    let (observations_after, held_out_after) = seen.unwrap_or((observations, held_out));
    let num_classes =
        |observations: &Observations| (observations.num_point_classes, observations.num_image_classes);
    if [held_out, observations_after, held_out_after]
        .iter()
        .any(|observations_after| num_classes(observations_after) != num_classes(observations))
    {
        return Err(value_error("the held-out observations have other numbers of classes"));
    }
    let before = HeldOut { observations, held_out, pose: &before.0 };
    let after = HeldOut { observations: observations_after, held_out: held_out_after, pose: &after.0 };
    Ok(detached(|| measure_gain(before, after)).into())
}

#[pyclass(name = "Ascended", frozen, get_all)]
pub(super) struct PyAscended {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Pose,
    num_points: usize,
    drift: f64,
}

#[pyclass(name = "Aligned", frozen, get_all)]
pub(super) struct PyAligned {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Pose,
    value: f64,
    num_points: usize,
    drift: f64,
}

#[pyclass(name = "Polished", frozen, get_all)]
pub(super) struct PyPolished {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Pose,
    moved_px: f64,
    inverse_curvature: Option<Py<PyArray2<f64>>>,
}

#[pyclass(name = "Sensitivity", frozen, get_all)]
pub(super) struct PySensitivity {
    curvature: Py<PyArray2<f64>>,
    scores: Py<PyArray2<f64>>,
    motions: Py<PyArray2<f64>>,
    parts: Py<PyArray2<u32>>,
    frame_curvatures: Py<PyArray3<f64>>,
    class_curvatures: Py<PyArray3<f64>>,
}

impl PySensitivity {
    fn new(py: Python<'_>, sensitivity: &Sensitivity) -> PyResult<Self> {
        let array = |matrix| to_matrix(py, matrix);
        let n = sensitivity.curvature.nrows();
        let arrays = |matrices: &[DMatrix<f64>]| {
            let entries: Vec<f64> = matrices.iter().flat_map(rows_of).collect();
            entries.into_pyarray(py).reshape([matrices.len(), n, n]).map(Bound::unbind)
        };
        let parts = sensitivity.parts.as_flattened().to_vec().into_pyarray(py);
        Ok(Self {
            curvature: array(&sensitivity.curvature)?,
            scores: array(&sensitivity.scores)?,
            motions: array(&sensitivity.motions)?,
            parts: parts.reshape([sensitivity.parts.len(), 4])?.unbind(),
            frame_curvatures: arrays(&sensitivity.frame_curvatures)?,
            class_curvatures: arrays(&sensitivity.class_curvatures)?,
        })
    }
}

fn rows_of(matrix: &DMatrix<f64>) -> Vec<f64> {
    matrix.transpose().iter().copied().collect()
}

fn to_matrix(py: Python<'_>, matrix: &DMatrix<f64>) -> PyResult<Py<PyArray2<f64>>> {
    rows_of(matrix).into_pyarray(py).reshape([matrix.nrows(), matrix.ncols()]).map(Bound::unbind)
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, *, factor, visible_only, seed))]
pub(super) fn ascend(
    observations: &PyObservations,
    t_camera_lidar: Pose,
    config: AlignmentConfig,
    factor: usize,
    visible_only: bool,
    seed: u64,
) -> PyResult<PyAscended> {
    check_factor(factor, &observations.0.camera)?;
    let (start, counted) = (t_camera_lidar.0, counted(visible_only));
    let Ascended { pose, drift, num_points } =
        detached(|| alignment::ascend(&observations.0, &start, factor, counted, &config, seed));
    Ok(PyAscended { t_camera_lidar: Pose(pose), num_points, drift })
}

#[pyfunction]
#[pyo3(signature = (observations, poses, config, *, factor, visible_only, seed, is_signed=false, contrast_weights=None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn align(
    observations: &PyObservations,
    poses: Vec<Pose>,
    config: AlignmentConfig,
    factor: usize,
    visible_only: bool,
    seed: u64,
    is_signed: bool,
    contrast_weights: Option<Vec<f64>>,
) -> PyResult<Vec<PyAligned>> {
    check_factor(factor, &observations.0.camera)?;
    let objective = match contrast_weights {
        Some(weights) => Objective::Contrast(weights),
        None if is_signed => Objective::SignedInformation,
        None => Objective::Information,
    };
    check_objective(&objective, &observations.0)?;
    let (starts, counted): (Vec<_>, _) = (poses.iter().map(|pose| pose.0).collect(), counted(visible_only));
    let ends =
        detached(|| alignment::align(&observations.0, &starts, factor, counted, objective, &config, seed));
    let aligned = |(Ascended { pose, drift, num_points }, value)| PyAligned {
        t_camera_lidar: Pose(pose),
        value,
        num_points,
        drift,
    };
    Ok(ends.into_iter().map(aligned).collect())
}

/// Checks that points have classes, and a weight for each where there is a contrast.
fn check_objective(objective: &Objective, observations: &Observations) -> PyResult<()> {
    if *objective != Objective::Information && observations.has_partitions() {
        return Err(value_error(
            "found points with partitions, expected classes for an objective with a sign",
        ));
    }
    match objective {
        Objective::Contrast(weights) if weights.len() != observations.num_point_classes => {
            let (found, needed) = (weights.len(), observations.num_point_classes);
            Err(value_error(format!(
                "found {found} weights, expected one for each of {needed} classes of points"
            )))
        }
        _ => Ok(()),
    }
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, inverse_curvature=None))]
pub(super) fn polish(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: Pose,
    config: PolishConfig,
    inverse_curvature: Option<PyReadonlyArray2<f64>>,
) -> PyResult<PyPolished> {
    let known = inverse_curvature.map(|matrix| matrix_6x6(&matrix)).transpose()?;
    let (start, pose_alone) = (t_camera_lidar.0, Variables::default());
    let JointMaximum { estimate, moved_px, inverse_curvature } =
        detached(|| alignment::maximise(&observations.0, &start, &pose_alone, known, &config.into()))?;
    let inverse_curvature = inverse_curvature.map(|matrix| to_matrix(py, &matrix)).transpose()?;
    Ok(PyPolished { t_camera_lidar: Pose(estimate.pose), moved_px, inverse_curvature })
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, intrinsics=Vec::new(), twists_per_s=None))]
pub(super) fn sensitivity(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: Pose,
    config: SensitivityConfig,
    intrinsics: Vec<String>,
    twists_per_s: Option<Vec<[f64; 6]>>,
) -> PyResult<Option<PySensitivity>> {
    check_factor(config.factor, &observations.0.camera)?;
    let variables = variables(&observations.0, &intrinsics, twists_per_s)?;
    let sensitivity =
        detached(|| alignment::sensitivity(&observations.0, &t_camera_lidar.0, &variables, &config));
    sensitivity.map(|sensitivity| PySensitivity::new(py, &sensitivity)).transpose()
}

#[pyclass(name = "JointMaximum", frozen, get_all)]
pub(super) struct PyJointMaximum {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Pose,
    changes: Vec<f64>,
    offset_s: f64,
    moved_px: f64,
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, intrinsics=Vec::new(), twists_per_s=None))]
pub(super) fn maximise(
    observations: &PyObservations,
    t_camera_lidar: Pose,
    config: AscentConfig,
    intrinsics: Vec<String>,
    twists_per_s: Option<Vec<[f64; 6]>>,
) -> PyResult<PyJointMaximum> {
    let variables = variables(&observations.0, &intrinsics, twists_per_s)?;
    let camera = &observations.0.camera;
    config.factors.iter().try_for_each(|&factor| check_factor(factor, camera))?;
    check_count(&config, variables.count() - 6)?;
    if variables.intrinsics.contains(&Intrinsic::Radial) {
        return Err(value_error("no lens has the intrinsic radial, expected intrinsics of the camera"));
    }
    let JointMaximum { estimate, moved_px, .. } =
        detached(|| alignment::maximise(&observations.0, &t_camera_lidar.0, &variables, None, &config))?;
    let value = |camera: &Camera, intrinsic: &Intrinsic| camera.intrinsic(*intrinsic).unwrap_or(0.0);
    let change = |intrinsic: &Intrinsic| value(&estimate.camera, intrinsic) - value(camera, intrinsic);
    Ok(PyJointMaximum {
        t_camera_lidar: Pose(estimate.pose),
        changes: variables.intrinsics.iter().map(change).collect(),
        offset_s: estimate.offset_s,
        moved_px,
    })
}

/// Checks that there is one setting for each variable after the pose.
fn check_count(config: &AscentConfig, count: usize) -> PyResult<()> {
    let found = [config.changes.len(), config.sigmas.len()];
    if found != [count; 2] {
        return Err(value_error(format!("found {found:?} changes and sigmas, needed {count} of each")));
    }
    Ok(())
}

/// The variables besides the pose: intrinsics by name and, if the twists of all frames are given, the time offset.
fn variables(
    observations: &Observations,
    intrinsics: &[String],
    twists_per_s: Option<Vec<[f64; 6]>>,
) -> PyResult<Variables> {
    let named = |name: &String| {
        let intrinsic =
            Intrinsic::of(name).filter(|&intrinsic| observations.camera.intrinsic(intrinsic).is_some());
        intrinsic.ok_or_else(|| value_error(format!("the camera has no intrinsic {name}")))
    };
    let twists: Option<Vec<Vector6<f64>>> =
        twists_per_s.map(|twists| twists.into_iter().map(Into::into).collect());
    if twists.as_ref().is_some_and(|twists| twists.len() != observations.frames.len()) {
        return Err(value_error(format!("{} frames need a twist each", observations.frames.len())));
    }
    let variables = Variables { intrinsics: intrinsics.iter().map(named).collect::<PyResult<_>>()?, twists };
    if variables.count() > MAX_VARIABLES {
        return Err(value_error(format!(
            "found {} variables, needed at most {MAX_VARIABLES}",
            variables.count()
        )));
    }
    Ok(variables)
}

pub(super) fn check_factor(factor: usize, camera: &Camera) -> PyResult<()> {
    if factor == 0 || factor > camera.width.min(camera.height) {
        return Err(value_error(format!("factor {factor} does not fit the image")));
    }
    Ok(())
}

pub(super) fn counted(visible_only: bool) -> Counted {
    if visible_only { Counted::Visible } else { Counted::All }
}

#[pyfunction]
pub(super) fn information_along(
    observations: &PyObservations,
    anchor: Pose,
    lines: Vec<([f64; 6], Vec<f64>)>,
) -> Vec<Vec<f64>> {
    let line = |(twist, offsets): ([f64; 6], Vec<f64>)| Line { twist: twist.into(), offsets };
    let lines: Vec<Line> = lines.into_iter().map(line).collect();
    detached(|| alignment::information_along(&observations.0, &anchor.0, &lines))
}

#[pyfunction]
pub(super) fn information(observations: &PyObservations, t_camera_lidar: Pose) -> Vec<([u32; 3], f64, f64)> {
    let squares = detached(|| alignment::information(&observations.0, &t_camera_lidar.0));
    squares.into_iter().map(|(square, information)| (square, information.sum, information.weight)).collect()
}

#[pyfunction]
pub(super) fn information_gains(
    observations: &PyObservations,
    before: Pose,
    after: Vec<Pose>,
) -> Vec<PyInformationGain> {
    let after: Vec<_> = after.iter().map(|pose| pose.0).collect();
    let gains = detached(|| alignment::information_gains(&observations.0, &before.0, &after));
    gains.into_iter().map(PyInformationGain::from).collect()
}
