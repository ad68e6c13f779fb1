//! Segments of sweeps.

use std::sync::Arc;

use nalgebra::{UnitVector3, Vector3};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::borrowed_sweeps;
use super::calls::{detached, value_error};
use crate::observation::Partitions;
use crate::segmentation::{self, SegmentationConfig, SegmentedSweep};

#[pyclass(name = "Up", frozen, get_all)]
pub(super) struct PyUp {
    direction: Py<PyArray1<f64>>,
    height_m: f64,
}

#[pyclass(name = "SegmentedSweep", frozen)]
pub(super) struct PySegmentedSweep {
    #[pyo3(get)]
    ids: Py<PyArray1<u32>>,
    #[pyo3(get)]
    kinds: Py<PyArray1<u8>>,
    #[pyo3(get)]
    num_segments: usize,
    #[pyo3(get)]
    up: Option<Py<PyArray1<f64>>>,
    sweep: Arc<SegmentedSweep>,
}

#[pyclass(name = "Partitions", frozen)]
pub(super) struct PyPartitions(pub(super) Arc<Partitions>);

impl PySegmentedSweep {
    fn new(py: Python<'_>, sweep: SegmentedSweep) -> Self {
        let kinds: Vec<u8> = sweep.kinds.iter().map(|&kind| kind as u8).collect();
        Self {
            ids: PyArray1::from_slice(py, &sweep.ids).unbind(),
            num_segments: kinds.len(),
            kinds: kinds.into_pyarray(py).unbind(),
            up: sweep.up.map(|up| vector(py, up)),
            sweep: Arc::new(sweep),
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
    unit.map(Some).ok_or_else(|| value_error(format!("found up {up:?}, expected a direction")))
}

#[pyfunction]
pub(super) fn estimate_up(py: Python<'_>, points: Vec<PyReadonlyArray2<f32>>) -> PyResult<Option<PyUp>> {
    let sweeps = borrowed_sweeps(&points)?;
    let sweeps: Vec<&[[f32; 3]]> = sweeps.iter().map(AsRef::as_ref).collect();
    let up = detached(|| segmentation::estimate_up(&sweeps));
    Ok(up.map(|up| PyUp { direction: vector(py, up.direction), height_m: up.height_m }))
}

#[pyfunction]
#[pyo3(signature = (points, config, up=None))]
pub(super) fn segment_sweeps(
    py: Python<'_>,
    points: Vec<PyReadonlyArray2<f32>>,
    config: SegmentationConfig,
    up: Option<[f64; 3]>,
) -> PyResult<Vec<PySegmentedSweep>> {
    let sweeps = borrowed_sweeps(&points)?;
    let (sweeps, up): (Vec<&[[f32; 3]]>, _) = (sweeps.iter().map(AsRef::as_ref).collect(), unit(up)?);
    let segmented = detached(|| segmentation::segment_sweeps(&sweeps, up, &config));
    Ok(segmented.into_iter().map(|sweep| PySegmentedSweep::new(py, sweep)).collect())
}

#[pyfunction]
pub(super) fn turned_partitions(
    points: Vec<PyReadonlyArray2<f32>>,
    segmented: Vec<PyRef<'_, PySegmentedSweep>>,
    num_turns: usize,
) -> PyResult<Vec<PyPartitions>> {
    let sweeps = borrowed_sweeps(&points)?;
    let sweeps: Vec<&[[f32; 3]]> = sweeps.iter().map(AsRef::as_ref).collect();
    let segmented: Vec<Arc<SegmentedSweep>> =
        segmented.iter().map(|segmented| Arc::clone(&segmented.sweep)).collect();
    let segmented: Vec<&SegmentedSweep> = segmented.iter().map(AsRef::as_ref).collect();
    if sweeps.iter().map(|sweep| sweep.len()).ne(segmented.iter().map(|segmented| segmented.ids.len())) {
        return Err(value_error("the sweeps are not those that were segmented"));
    }
    let partitions = detached(|| segmentation::turned(&sweeps, &segmented, num_turns))?;
    Ok(partitions.into_iter().map(|partitions| PyPartitions(Arc::new(partitions))).collect())
}
