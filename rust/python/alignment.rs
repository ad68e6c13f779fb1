//! Mutual information over SE(3): ascent, polish and sensitivity.

use nalgebra::{DMatrix, Vector6};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::agreement::PyHeldOutGain;
use super::arrays::matrix_6x6;
use super::errors::value_error;
use super::observations::PyObservations;
use super::poses::{isometry, matrix};
use super::threads::detached;
use crate::alignment::{
    self, Aligned, AlignmentConfig, Ascended, Counted, JointConfig, JointMaximum, MAX_VARIABLES,
    PolishConfig, Sensitivity, SensitivityConfig, Variables, Way,
};
use crate::camera::{Camera, Intrinsic};
use crate::observation::Observations;

#[pyclass(name = "Ascended", frozen, get_all)]
pub(super) struct PyAscended {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Py<PyArray2<f64>>,
    num_points: usize,
    drift: f64,
}

#[pyclass(name = "Aligned", frozen, get_all)]
pub(super) struct PyAligned {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Py<PyArray2<f64>>,
    mutual_information: f64,
    num_points: usize,
    drift: f64,
}

impl PyAligned {
    fn new(py: Python<'_>, found: &Aligned) -> PyResult<Self> {
        Ok(Self {
            t_camera_lidar: matrix(py, &found.pose)?.unbind(),
            mutual_information: found.mutual_information,
            num_points: found.num_points,
            drift: found.drift,
        })
    }
}

#[pyclass(name = "Polished", frozen, get_all)]
pub(super) struct PyPolished {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Py<PyArray2<f64>>,
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
    fn new(py: Python<'_>, found: &Sensitivity) -> PyResult<Self> {
        let array = |matrix| to_matrix(py, matrix);
        let n = found.curvature.nrows();
        let arrays = |matrices: &[DMatrix<f64>]| {
            let entries: Vec<f64> = matrices.iter().flat_map(rows_of).collect();
            entries.into_pyarray(py).reshape([matrices.len(), n, n]).map(Bound::unbind)
        };
        let parts = found.parts.as_flattened().to_vec().into_pyarray(py);
        Ok(Self {
            curvature: array(&found.curvature)?,
            scores: array(&found.scores)?,
            motions: array(&found.motions)?,
            parts: parts.reshape([found.parts.len(), 4])?.unbind(),
            frame_curvatures: arrays(&found.frame_curvatures)?,
            class_curvatures: arrays(&found.class_curvatures)?,
        })
    }
}

/// The entries of a matrix, row by row.
fn rows_of(matrix: &DMatrix<f64>) -> Vec<f64> {
    matrix.transpose().iter().copied().collect()
}

fn to_matrix(py: Python<'_>, matrix: &DMatrix<f64>) -> PyResult<Py<PyArray2<f64>>> {
    rows_of(matrix).into_pyarray(py).reshape([matrix.nrows(), matrix.ncols()]).map(Bound::unbind)
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, *, factor, visible_only, seed))]
pub(super) fn ascend(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    config: AlignmentConfig,
    factor: usize,
    visible_only: bool,
    seed: u64,
) -> PyResult<PyAscended> {
    check_factor(factor, &observations.0.camera)?;
    let start = isometry(&t_camera_lidar)?;
    let counted = counted(visible_only);
    let Ascended { pose, drift, num_points } =
        detached(py, || alignment::ascend(&observations.0, &start, factor, counted, &config, seed));
    Ok(PyAscended { t_camera_lidar: matrix(py, &pose)?.unbind(), num_points, drift })
}

#[pyfunction]
#[pyo3(signature = (observations, poses, config, *, factor, visible_only, seed))]
pub(super) fn align(
    py: Python<'_>,
    observations: &PyObservations,
    poses: Vec<PyReadonlyArray2<f64>>,
    config: AlignmentConfig,
    factor: usize,
    visible_only: bool,
    seed: u64,
) -> PyResult<Vec<PyAligned>> {
    check_factor(factor, &observations.0.camera)?;
    let starts = poses.iter().map(isometry).collect::<PyResult<Vec<_>>>()?;
    let counted = counted(visible_only);
    let found = detached(py, || alignment::align(&observations.0, &starts, factor, counted, &config, seed));
    found.iter().map(|aligned| PyAligned::new(py, aligned)).collect()
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, inverse_curvature=None))]
pub(super) fn polish(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    config: PolishConfig,
    inverse_curvature: Option<PyReadonlyArray2<f64>>,
) -> PyResult<PyPolished> {
    let start = isometry(&t_camera_lidar)?;
    let inverse_curvature = inverse_curvature.map(|matrix| matrix_6x6(&matrix)).transpose()?;
    let JointMaximum { estimate, moved_px, inverse_curvature } = detached(py, || {
        alignment::polish(&observations.0, &start, inverse_curvature, Counted::Visible, &config)
    })?;
    let inverse_curvature = inverse_curvature.map(|found| to_matrix(py, &found)).transpose()?;
    Ok(PyPolished { t_camera_lidar: matrix(py, &estimate.pose)?.unbind(), moved_px, inverse_curvature })
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, intrinsics=Vec::new(), twists_per_s=None))]
pub(super) fn sensitivity(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    config: SensitivityConfig,
    intrinsics: Vec<String>,
    twists_per_s: Option<Vec<[f64; 6]>>,
) -> PyResult<Option<PySensitivity>> {
    let pose = isometry(&t_camera_lidar)?;
    check_factor(config.factor, &observations.0.camera)?;
    let variables = variables(&observations.0, &intrinsics, twists_per_s)?;
    let found = detached(py, || alignment::sensitivity(&observations.0, &pose, &variables, &config));
    found.map(|found| PySensitivity::new(py, &found)).transpose()
}

#[pyclass(name = "JointMaximum", frozen, get_all)]
pub(super) struct PyJointMaximum {
    #[pyo3(name = "T_camera_lidar")]
    t_camera_lidar: Py<PyArray2<f64>>,
    changes: Vec<f64>,
    offset_s: f64,
    moved_px: f64,
}

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, config, intrinsics=Vec::new(), twists_per_s=None))]
pub(super) fn maximise(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    config: JointConfig,
    intrinsics: Vec<String>,
    twists_per_s: Option<Vec<[f64; 6]>>,
) -> PyResult<PyJointMaximum> {
    let start = isometry(&t_camera_lidar)?;
    let variables = variables(&observations.0, &intrinsics, twists_per_s)?;
    let camera = &observations.0.camera;
    config.factors.iter().try_for_each(|&factor| check_factor(factor, camera))?;
    check_count(&config, variables.count() - 6)?;
    if variables.intrinsics.contains(&Intrinsic::Radial) {
        return Err(value_error("radial moves points as no lens does, needed intrinsics of the camera"));
    }
    let JointMaximum { estimate, moved_px, .. } =
        detached(py, || alignment::maximise(&observations.0, &start, &variables, &config))?;
    let value = |camera: &Camera, each: &Intrinsic| camera.intrinsic(*each).unwrap_or(0.0);
    let change = |each: &Intrinsic| value(&estimate.camera, each) - value(camera, each);
    Ok(PyJointMaximum {
        t_camera_lidar: matrix(py, &estimate.pose)?.unbind(),
        changes: variables.intrinsics.iter().map(change).collect(),
        offset_s: estimate.offset_s,
        moved_px,
    })
}

/// The settings of as many variables after the pose as there are.
fn check_count(config: &JointConfig, count: usize) -> PyResult<()> {
    let found = [config.changes.len(), config.sigmas.len()];
    if found != [count; 2] {
        return Err(value_error(format!("found {found:?} changes and sigmas, needed {count} of each")));
    }
    Ok(())
}

/// What is estimated beside the pose: intrinsics by their names, and with twists of all frames the offset of the clock.
fn variables(
    observations: &Observations,
    intrinsics: &[String],
    twists_per_s: Option<Vec<[f64; 6]>>,
) -> PyResult<Variables> {
    let named = |name: &String| {
        let found = Intrinsic::of(name).filter(|&each| observations.camera.intrinsic(each).is_some());
        found.ok_or_else(|| value_error(format!("the camera has no intrinsic {name}")))
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
        return Err(value_error(format!("factor {factor} does not fit the picture")));
    }
    Ok(())
}

pub(super) fn counted(visible_only: bool) -> Counted {
    if visible_only { Counted::Visible } else { Counted::All }
}

#[pyfunction]
pub(super) fn information_along(
    py: Python<'_>,
    observations: &PyObservations,
    anchor: PyReadonlyArray2<f64>,
    ways: Vec<([f64; 6], Vec<f64>)>,
) -> PyResult<Vec<Vec<f64>>> {
    let anchor = isometry(&anchor)?;
    let ways: Vec<Way> =
        ways.into_iter().map(|(twist, offsets)| Way { twist: twist.into(), offsets }).collect();
    Ok(detached(py, || alignment::information_along(&observations.0, &anchor, &ways)))
}

#[pyfunction]
pub(super) fn information(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    edge_band_px: usize,
) -> PyResult<Vec<([u32; 3], f64, f64)>> {
    let pose = isometry(&t_camera_lidar)?;
    let found = detached(py, || alignment::information(&observations.0, &pose, edge_band_px));
    Ok(found.into_iter().map(|(square, found)| (square, found.sum, found.weight)).collect())
}

#[pyfunction]
pub(super) fn information_gains(
    py: Python<'_>,
    observations: &PyObservations,
    before: PyReadonlyArray2<f64>,
    after: Vec<PyReadonlyArray2<f64>>,
    edge_band_px: usize,
) -> PyResult<Vec<PyHeldOutGain>> {
    let before = isometry(&before)?;
    let after = after.iter().map(isometry).collect::<PyResult<Vec<_>>>()?;
    let found = detached(py, || alignment::information_gains(&observations.0, &before, &after, edge_band_px));
    Ok(found.into_iter().map(PyHeldOutGain::from).collect())
}
