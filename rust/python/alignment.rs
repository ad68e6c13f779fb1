//! Mutual information over SE(3): ascent, polish and sensitivity.

use nalgebra::{DMatrix, Matrix6};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::matrix_6x6;
use super::errors::value_error;
use super::observations::PyObservations;
use super::poses::{isometry, matrix};
use super::threads::detached;
use crate::alignment::{self, AlignmentConfig, Counted, PolishConfig, SensitivityConfig};
use crate::camera::Camera;

/// `T_camera_lidar`, mutual information, number of points.
pub(super) type AlignedTuple<'py> = (Bound<'py, PyArray2<f64>>, f64, usize, f64);

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, *, factor, edge_band, visible_only, steps, batch_size, step_size, final_step,
                    max_baseline, max_points, seed))]
#[allow(clippy::too_many_arguments)]
pub(super) fn align<'py>(
    py: Python<'py>,
    observations: &PyObservations,
    t_camera_lidar: Vec<PyReadonlyArray2<f64>>,
    factor: usize,
    edge_band: usize,
    visible_only: bool,
    steps: usize,
    batch_size: usize,
    step_size: f64,
    final_step: f64,
    max_baseline: f64,
    max_points: usize,
    seed: u64,
) -> PyResult<Vec<AlignedTuple<'py>>> {
    check_factor(factor, &observations.0.camera)?;
    if batch_size == 0 || max_points == 0 {
        return Err(value_error(format!(
            "batch_size {batch_size} and max_points {max_points} need to be at least 1"
        )));
    }
    let starts = t_camera_lidar.iter().map(isometry).collect::<PyResult<Vec<_>>>()?;
    let config = AlignmentConfig {
        factor,
        edge_band,
        counted: counted(visible_only),
        steps,
        batch_size,
        step_size,
        final_step,
        max_baseline,
        max_points,
    };
    let found = detached(py, || alignment::align(&observations.0, &starts, &config, seed));
    found.iter().map(|a| Ok((matrix(py, &a.pose)?, a.mutual_information, a.num_points, a.drift))).collect()
}

/// `T_camera_lidar`, blocks moved by the last round, inverse curvature (6, 6).
pub(super) type PolishArrays<'py> = (Bound<'py, PyArray2<f64>>, f64, Option<Bound<'py, PyArray2<f64>>>);

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, *, factor, edge_band, visible_only, max_rounds, max_steps, tolerance,
                    max_baseline, inverse_curvature=None))]
#[allow(clippy::too_many_arguments)]
pub(super) fn polish<'py>(
    py: Python<'py>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    factor: usize,
    edge_band: usize,
    visible_only: bool,
    max_rounds: usize,
    max_steps: usize,
    tolerance: f64,
    max_baseline: f64,
    inverse_curvature: Option<PyReadonlyArray2<f64>>,
) -> PyResult<PolishArrays<'py>> {
    check_factor(factor, &observations.0.camera)?;
    let start = isometry(&t_camera_lidar)?;
    let counted = counted(visible_only);
    let config = PolishConfig { factor, edge_band, counted, max_rounds, max_steps, tolerance, max_baseline };
    let inverse_curvature = inverse_curvature.map(|matrix| matrix_6x6(&matrix)).transpose()?;
    let found =
        detached(py, || alignment::polish(&observations.0, &start, inverse_curvature.as_ref(), &config));
    let array = |matrix: Matrix6<f64>| PyArray2::from_vec2(py, &<[[f64; 6]; 6]>::from(matrix).map(Vec::from));
    Ok((matrix(py, &found.pose)?, found.moved, found.inverse_curvature.map(array).transpose()?))
}

/// Curvature (n, n), scores (parts, n) and motions (n, n).
pub(super) type SensitivityArrays<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pyfunction]
#[pyo3(signature = (observations, t_camera_lidar, *, factor, edge_band, max_points, with_intrinsics, regions_across))]
#[allow(clippy::too_many_arguments)]
pub(super) fn sensitivity<'py>(
    py: Python<'py>,
    observations: &PyObservations,
    t_camera_lidar: PyReadonlyArray2<f64>,
    factor: usize,
    edge_band: usize,
    max_points: usize,
    with_intrinsics: bool,
    regions_across: usize,
) -> PyResult<Option<SensitivityArrays<'py>>> {
    let pose = isometry(&t_camera_lidar)?;
    let config = SensitivityConfig { factor, edge_band, max_points, with_intrinsics, regions_across };
    let found = detached(py, || alignment::sensitivity(&observations.0, &pose, &config));
    let array = |matrix: &DMatrix<f64>| {
        let rows: Vec<f64> = matrix.transpose().iter().copied().collect();
        rows.into_pyarray(py).reshape([matrix.nrows(), matrix.ncols()])
    };
    let Some(found) = found else { return Ok(None) };
    Ok(Some((array(&found.curvature)?, array(&found.scores)?, array(&found.motions)?)))
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
