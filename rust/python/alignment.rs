//! Mutual information over SE(3): ascent, polish and sensitivity.

use nalgebra::{DMatrix, Matrix6};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::agreement::PyHeldOutGain;
use super::arrays::matrix_6x6;
use super::errors::value_error;
use super::observations::PyObservations;
use super::poses::{isometry, matrix};
use super::threads::detached;
use crate::alignment::{
    self, Aligned, AlignmentConfig, Ascended, Counted, PolishConfig, Polished, Sensitivity, SensitivityConfig,
};
use crate::camera::Camera;

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

impl PyPolished {
    fn new(py: Python<'_>, found: &Polished) -> PyResult<Self> {
        let array = |matrix: Matrix6<f64>| {
            PyArray2::from_vec2(py, &<[[f64; 6]; 6]>::from(matrix).map(Vec::from)).map(Bound::unbind)
        };
        Ok(Self {
            t_camera_lidar: matrix(py, &found.pose)?.unbind(),
            moved_px: found.moved_px,
            inverse_curvature: found.inverse_curvature.map(array).transpose()?,
        })
    }
}

#[pyclass(name = "Sensitivity", frozen, get_all)]
pub(super) struct PySensitivity {
    curvature: Py<PyArray2<f64>>,
    scores: Py<PyArray2<f64>>,
    motions: Py<PyArray2<f64>>,
    parts: Py<PyArray2<u32>>,
    frame_curvatures: Py<PyArray3<f64>>,
}

impl PySensitivity {
    fn new(py: Python<'_>, found: &Sensitivity) -> PyResult<Self> {
        let rows = |matrix: &DMatrix<f64>| matrix.transpose().iter().copied().collect::<Vec<f64>>();
        let array = |matrix: &DMatrix<f64>| {
            rows(matrix).into_pyarray(py).reshape([matrix.nrows(), matrix.ncols()]).map(Bound::unbind)
        };
        let n = found.curvature.nrows();
        let of_frames: Vec<f64> = found.frame_curvatures.iter().flat_map(rows).collect();
        let parts = found.parts.as_flattened().to_vec().into_pyarray(py);
        Ok(Self {
            curvature: array(&found.curvature)?,
            scores: array(&found.scores)?,
            motions: array(&found.motions)?,
            parts: parts.reshape([found.parts.len(), 3])?.unbind(),
            frame_curvatures: of_frames
                .into_pyarray(py)
                .reshape([found.frame_curvatures.len(), n, n])?
                .unbind(),
        })
    }
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
    check_ascent(&config, factor, &observations.0.camera)?;
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
    check_ascent(&config, factor, &observations.0.camera)?;
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
    let found = detached(py, || {
        alignment::polish(&observations.0, &start, inverse_curvature.as_ref(), Counted::Visible, &config)
    });
    PyPolished::new(py, &found)
}

#[pyfunction]
pub(super) fn sensitivity(
    py: Python<'_>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    config: SensitivityConfig,
) -> PyResult<Option<PySensitivity>> {
    let pose = isometry(&t_camera_lidar)?;
    let found = detached(py, || alignment::sensitivity(&observations.0, &pose, &config));
    found.map(|found| PySensitivity::new(py, &found)).transpose()
}

fn check_ascent(config: &AlignmentConfig, factor: usize, camera: &Camera) -> PyResult<()> {
    check_factor(factor, camera)?;
    let &AlignmentConfig { batch_size, max_points, .. } = config;
    if batch_size == 0 || max_points == 0 {
        return Err(value_error(format!(
            "batch_size {batch_size} and max_points {max_points} need to be at least 1"
        )));
    }
    Ok(())
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
pub(super) fn information_around(
    py: Python<'_>,
    observations: &PyObservations,
    anchor: PyReadonlyArray2<f64>,
    poses: Vec<PyReadonlyArray2<f64>>,
) -> PyResult<Vec<f64>> {
    let anchor = isometry(&anchor)?;
    let poses = poses.iter().map(isometry).collect::<PyResult<Vec<_>>>()?;
    Ok(detached(py, || alignment::information_around(&observations.0, &anchor, &poses)))
}

#[pyfunction]
pub(super) fn segment_information(
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
