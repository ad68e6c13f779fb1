//! Whether sweeps show the same scene, and the distance between them.

use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::arrays::{borrowed_rows, borrowed_sweeps};
use super::calls::detached;
use crate::scenes::{self, NearestRanges};
use crate::sweep_shift;

#[pyclass(name = "NearestRanges", frozen)]
pub(super) struct PyNearestRanges(NearestRanges);

#[pyfunction]
pub(super) fn nearest_ranges(points: Vec<PyReadonlyArray2<f32>>) -> PyResult<Vec<PyNearestRanges>> {
    let sweeps = borrowed_sweeps(&points)?;
    let ranges: Vec<_> = detached(|| sweeps.par_iter().map(|sweep| NearestRanges::of(sweep)).collect());
    Ok(ranges.into_iter().map(PyNearestRanges).collect())
}

#[pyfunction]
pub(super) fn shares_alike<'py>(
    py: Python<'py>,
    sweeps: Vec<PyRef<'_, PyNearestRanges>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let sweeps: Vec<&NearestRanges> = sweeps.iter().map(|sweep| &sweep.0).collect();
    detached(|| scenes::shares_alike(&sweeps)).into_pyarray(py).reshape([sweeps.len(); 2])
}

#[pyfunction]
pub(super) fn sweep_shifts(
    pairs: Vec<(PyReadonlyArray2<f32>, PyReadonlyArray2<f32>)>,
) -> PyResult<Vec<Option<f64>>> {
    let rows = |sweep| borrowed_rows("points", sweep);
    let pairs = pairs.iter().map(|(a, b)| Ok([rows(a)?, rows(b)?])).collect::<PyResult<Vec<_>>>()?;
    let pairs: Vec<[&[[f32; 3]]; 2]> = pairs.iter().map(|[a, b]| [a.as_ref(), b.as_ref()]).collect();
    Ok(detached(|| sweep_shift::sweep_shifts(&pairs)))
}
