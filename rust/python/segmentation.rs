//! Segments of sweeps.

use nalgebra::{UnitVector3, Vector3};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::borrowed_rows;
use super::errors::value_error;
use super::threads::detached;
use crate::segmentation::{self, SegmentationConfig, SegmentedSweep};

#[pyclass(name = "Up", frozen, get_all)]
pub(super) struct PyUp {
    direction: Py<PyArray1<f64>>,
    height_m: f64,
    share_on_plane: f64,
    share_below: f64,
}

#[pyclass(name = "SegmentedSweep", frozen, get_all)]
pub(super) struct PySegmentedSweep {
    ids: Py<PyArray1<u32>>,
    kinds: Py<PyArray1<u8>>,
    num_segments: usize,
    up: Option<Py<PyArray1<f64>>>,
}

impl PySegmentedSweep {
    fn new(py: Python<'_>, sweep: SegmentedSweep) -> Self {
        let kinds: Vec<u8> = sweep.kinds.into_iter().map(|kind| kind as u8).collect();
        Self {
            ids: sweep.ids.into_pyarray(py).unbind(),
            num_segments: kinds.len(),
            kinds: kinds.into_pyarray(py).unbind(),
            up: sweep.up.map(|up| vector(py, up)),
        }
    }
}

fn vector(py: Python<'_>, direction: UnitVector3<f64>) -> Py<PyArray1<f64>> {
    direction.as_slice().to_vec().into_pyarray(py).unbind()
}

fn unit(up: Option<[f64; 3]>) -> PyResult<Option<UnitVector3<f64>>> {
    let Some(up) = up else { return Ok(None) };
    let unit =
        UnitVector3::try_new(Vector3::from(up), 1e-9).filter(|unit| unit.iter().all(|x| x.is_finite()));
    unit.map(Some).ok_or_else(|| value_error(format!("found up {up:?}, needed a direction")))
}

#[pyfunction]
pub(super) fn estimate_up(py: Python<'_>, points: Vec<PyReadonlyArray2<f32>>) -> PyResult<Option<PyUp>> {
    let sweeps = points.iter().map(|sweep| borrowed_rows("points", sweep)).collect::<PyResult<Vec<_>>>()?;
    let sweeps: Vec<&[[f32; 3]]> = sweeps.iter().map(AsRef::as_ref).collect();
    let up = detached(py, || segmentation::estimate_up(&sweeps));
    Ok(up.map(|up| PyUp {
        direction: vector(py, up.direction),
        height_m: up.height_m,
        share_on_plane: up.share_on_plane,
        share_below: up.share_below,
    }))
}

#[pyfunction]
#[pyo3(signature = (points, config, up=None))]
pub(super) fn segment_sweep(
    py: Python<'_>,
    points: PyReadonlyArray2<f32>,
    config: SegmentationConfig,
    up: Option<[f64; 3]>,
) -> PyResult<PySegmentedSweep> {
    let (points, up) = (borrowed_rows("points", &points)?, unit(up)?);
    let segmented = detached(py, || segmentation::segment_sweep(&points, up, &config));
    Ok(PySegmentedSweep::new(py, segmented))
}

#[pyfunction]
#[pyo3(signature = (points, config, up=None))]
pub(super) fn segment_sweeps(
    py: Python<'_>,
    points: Vec<PyReadonlyArray2<f32>>,
    config: SegmentationConfig,
    up: Option<[f64; 3]>,
) -> PyResult<Vec<PySegmentedSweep>> {
    let sweeps = points.iter().map(|sweep| borrowed_rows("points", sweep)).collect::<PyResult<Vec<_>>>()?;
    let (sweeps, up): (Vec<&[[f32; 3]]>, _) = (sweeps.iter().map(AsRef::as_ref).collect(), unit(up)?);
    let segmented = detached(py, || segmentation::segment_sweeps(&sweeps, up, &config));
    Ok(segmented.into_iter().map(|sweep| PySegmentedSweep::new(py, sweep)).collect())
}
