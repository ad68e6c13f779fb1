//! Network outputs, transferred to pixels and points.

use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::arrays::borrowed_rows;
use super::calls::{detached, value_error};
use crate::error::Result;
use crate::labelling::{Neighbors, Places, RangeProjection, RangeView, Scores};

/// Calls a function with the scores of all views and the places of all pixels.
fn sampled<T: Send>(
    scores: &[PyReadonlyArray3<'_, f32>],
    views: &PyReadonlyArray1<'_, u8>,
    places: &PyReadonlyArray2<'_, f32>,
    classes_first: bool,
    compute: impl Fn(&Places<'_>, &[Scores<'_>]) -> Result<Vec<T>> + Send + Sync,
) -> PyResult<Vec<T>> {
    let (views, places) = (views.as_slice()?, borrowed_rows("places", places)?);
    if views.len() != places.len() {
        return Err(value_error("views and places need the same number of pixels"));
    }
    let mut arrays = Vec::with_capacity(scores.len());
    for each in scores {
        arrays.push((each.as_slice()?, each.as_array().dim()));
    }
    let sampled = detached(|| {
        let scores = arrays.iter().map(|&(values, dim)| match classes_first {
            true => Scores::classes_first(values, dim),
            false => Scores::classes_last(values, dim),
        });
        let scores = scores.collect::<Result<Vec<_>>>()?;
        compute(&Places { views, places: &places }, &scores)
    })?;
    Ok(sampled)
}

#[pyfunction]
pub(super) fn classes_of_scores<'py>(
    py: Python<'py>,
    scores: Vec<PyReadonlyArray3<'py, f32>>,
    views: PyReadonlyArray1<'py, u8>,
    places: PyReadonlyArray2<'py, f32>,
    classes_first: bool,
) -> PyResult<Bound<'py, PyArray1<u16>>> {
    let classes = sampled(&scores, &views, &places, classes_first, |places, scores| places.classes(scores))?;
    Ok(classes.into_pyarray(py))
}

#[pyfunction]
pub(super) fn shares_of_scores<'py>(
    py: Python<'py>,
    scores: Vec<PyReadonlyArray3<'py, f32>>,
    views: PyReadonlyArray1<'py, u8>,
    places: PyReadonlyArray2<'py, f32>,
    classes_first: bool,
    are_logits: bool,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let shares =
        sampled(&scores, &views, &places, classes_first, |places, scores| places.shares(scores, are_logits))?;
    Ok(shares.into_pyarray(py))
}

#[pyclass(name = "RangeView", frozen)]
pub(super) struct PyRangeView(RangeView);

#[pyclass(name = "RangeProjection", frozen, get_all)]
pub(super) struct PyRangeProjection {
    points: Py<PyArray1<u32>>,
    pixels: Py<PyArray1<u32>>,
}

#[pymethods]
impl PyRangeView {
    #[new]
    fn new(
        rows: usize,
        columns: usize,
        elevations: (f64, f64),
        azimuths: (f64, f64),
        clamps: bool,
    ) -> PyResult<Self> {
        let ((down, up), (left, right)) = (elevations, azimuths);
        let view = RangeView { rows, columns, up, down, left, right, clamps };
        view.check()?;
        Ok(Self(view))
    }

    #[pyo3(signature = (points, rings=None))]
    fn project(
        &self,
        py: Python<'_>,
        points: PyReadonlyArray2<f32>,
        rings: Option<PyReadonlyArray1<u16>>,
    ) -> PyResult<PyRangeProjection> {
        let points = borrowed_rows("points", &points)?;
        let rings = rings.as_ref().map(PyReadonlyArray1::as_slice).transpose()?;
        if rings.is_some_and(|rings| rings.len() != points.len()) {
            return Err(value_error("every point needs a ring"));
        }
        let projected = detached(|| self.0.project(&points, rings));
        Ok(PyRangeProjection {
            points: projected.points.into_pyarray(py).unbind(),
            pixels: projected.pixels.into_pyarray(py).unbind(),
        })
    }

    fn carry_back<'py>(
        &self,
        py: Python<'py>,
        projection: &PyRangeProjection,
        points: PyReadonlyArray2<f32>,
        classes: PyReadonlyArray1<u16>,
        neighbors: Neighbors,
    ) -> PyResult<Bound<'py, PyArray1<u16>>> {
        let points = borrowed_rows("points", &points)?;
        let projection = RangeProjection {
            points: projection.points.bind(py).readonly().as_slice()?.to_vec(),
            pixels: projection.pixels.bind(py).readonly().as_slice()?.to_vec(),
        };
        let classes = classes.as_slice()?;
        if projection.points.len() != classes.len() || projection.pixels.len() != points.len() {
            return Err(value_error("the projection belongs to other points or pixels"));
        }
        let classes = detached(|| self.0.carry_back(&projection, &points, classes, &neighbors))?;
        Ok(classes.into_pyarray(py))
    }
}
