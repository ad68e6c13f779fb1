//! Points chosen at an anchor pose, for MINE's network in PyTorch.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::alignment::{check_factor, counted};
use super::arrays::{Affine, Array2, Pose, to_array2};
use super::calls::{detached, value_error};
use super::observations::PyObservations;
use crate::alignment::{Anchored, MiniBatch};

#[pyclass(name = "AnchoredPoints", frozen)]
pub(super) struct PyAnchoredPoints(pub(super) Anchored);

#[pymethods]
impl PyAnchoredPoints {
    #[new]
    #[pyo3(signature = (observations, anchor, *, factor, visible_only, max_points=usize::MAX, constant_radius=0))]
    fn new(
        observations: PyRef<'_, PyObservations>,
        anchor: Pose,
        factor: usize,
        visible_only: bool,
        max_points: usize,
        constant_radius: usize,
    ) -> PyResult<Self> {
        check_factor(factor, &observations.0.camera)?;
        let (seen, counted) = (Arc::clone(&observations.0), counted(visible_only));
        let choose = || Anchored::new(seen, factor, max_points, &anchor.0, counted, constant_radius);
        Ok(Self(detached(choose)))
    }

    #[getter]
    fn classes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        self.0.classes().collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn preconditioner<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        let rows: Vec<[f64; 6]> =
            self.0.preconditioner().row_iter().map(|row| row.transpose().into()).collect();
        to_array2(py, &rows)
    }

    fn sample(
        &self,
        py: Python<'_>,
        indices: PyReadonlyArray1<i64>,
        t_camera_lidar: Affine,
    ) -> PyResult<PyMiniBatch> {
        let indices = self.indices(&indices)?;
        // Runs on this thread: handing over to a pool takes longer than a mini-batch where other work shares the
        // cores.
        Ok(PyMiniBatch(py.detach(|| self.0.sample(&indices, &t_camera_lidar.0))))
    }
}

impl PyAnchoredPoints {
    fn indices(&self, indices: &PyReadonlyArray1<i64>) -> PyResult<Vec<usize>> {
        let count = self.0.classes().len();
        let checked = |&index: &i64| usize::try_from(index).ok().filter(|&index| index < count);
        let indices: Option<Vec<usize>> = indices.as_array().iter().map(checked).collect();
        indices.ok_or_else(|| value_error(format!("an index is not one of the {count} points")))
    }
}

#[pyclass(name = "MiniBatch", frozen)]
pub(super) struct PyMiniBatch(MiniBatch);

#[pymethods]
impl PyMiniBatch {
    #[getter]
    fn shares<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        let [num_rows, _, num_y] = self.0.shape();
        self.0.shares().into_pyarray(py).reshape([num_rows, num_y])
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        let [num_rows, num_x, _] = self.0.shape();
        self.0.weights().into_pyarray(py).reshape([num_rows, num_x])
    }

    fn pull_back<'py>(&self, py: Python<'py>, gradient: PyReadonlyArray2<f64>) -> PyResult<Array2<'py>> {
        let [num_rows, _, num_y] = self.0.shape();
        if gradient.as_array().shape() != [num_rows, num_y] {
            return Err(value_error("gradient needs the shape of shares"));
        }
        let gradient = gradient.as_slice().map_err(|e| value_error(e.to_string()))?;
        let pulled = py.detach(|| self.0.pull_back(gradient));
        let rows: Vec<[f64; 4]> = pulled.row_iter().map(|row| row.transpose().into()).collect();
        to_array2(py, &rows)
    }
}
