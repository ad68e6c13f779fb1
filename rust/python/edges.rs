//! Steps along the scans of sweeps.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{borrowed_rows, to_array2};
use super::errors::value_error;
use super::threads::detached;
use crate::edges::{self, Steps};

#[pyclass(name = "Steps", frozen, get_all)]
pub(super) struct PySteps {
    range_m: Py<PyArray1<f32>>,
    to_range_step_m: Py<PyArray2<f32>>,
    to_intensity_step_m: Py<PyArray2<f32>>,
    spacing: f64,
    intensity: Option<Py<PyArray1<f32>>>,
}

#[pyfunction]
pub(super) fn edge_steps(
    py: Python<'_>,
    points: Vec<PyReadonlyArray2<f32>>,
    intensities: Vec<Option<PyReadonlyArray1<f32>>>,
    same_surface_m: f64,
) -> PyResult<Vec<PySteps>> {
    let rows = points.iter().map(|sweep| borrowed_rows("points", sweep)).collect::<PyResult<Vec<_>>>()?;
    let values = intensities
        .iter()
        .map(|each| each.as_ref().map(|each| each.as_slice()).transpose())
        .collect::<Result<Vec<_>, _>>()?;
    let counts = rows.iter().map(|sweep| sweep.len());
    if values.len() != rows.len()
        || counts.zip(&values).any(|(count, each)| each.is_some_and(|v| v.len() != count))
    {
        return Err(value_error("every sweep needs an intensity for each point, or None"));
    }
    let sweeps: Vec<_> = rows.iter().map(AsRef::as_ref).zip(values).collect();
    let found = detached(py, || edges::steps(&sweeps, same_surface_m));
    found.iter().map(|steps| PySteps::new(py, steps)).collect()
}

impl PySteps {
    fn new(py: Python<'_>, steps: &Steps) -> PyResult<Self> {
        Ok(Self {
            range_m: PyArray1::from_slice(py, &steps.range_m).unbind(),
            to_range_step_m: to_array2(py, &steps.to_range_step_m)?.unbind(),
            to_intensity_step_m: to_array2(py, &steps.to_intensity_step_m)?.unbind(),
            spacing: steps.spacing,
            intensity: steps.intensity.as_ref().map(|values| PyArray1::from_slice(py, values).unbind()),
        })
    }
}
