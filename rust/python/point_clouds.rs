//! Sweeps read from files.

use std::path::PathBuf;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use super::labels::PyClassShares;
use super::threads::detached;
use crate::point_cloud::{self, Limit, MAX_POINTS, PointCloud};

#[pyclass(name = "PointCloud", frozen, get_all)]
pub(super) struct PyPointCloud {
    points: Py<PyArray2<f32>>,
    intensity: Option<Py<PyArray1<f32>>>,
    ring: Option<Py<PyArray1<u16>>>,
    time: Option<Py<PyArray1<f64>>>,
    labels: Option<Py<PyArray1<u16>>>,
    label_shares: Option<Py<PyClassShares>>,
    num_no_returns: usize,
    is_return: Py<PyArray1<bool>>,
}

impl PyPointCloud {
    fn new(py: Python<'_>, cloud: PointCloud) -> PyResult<Self> {
        let count = cloud.points.len();
        Ok(Self {
            points: cloud.points.into_flattened().into_pyarray(py).reshape([count, 3])?.unbind(),
            intensity: cloud.intensity.map(|x| x.into_pyarray(py).unbind()),
            ring: cloud.ring.map(|x| x.into_pyarray(py).unbind()),
            time: cloud.time.map(|x| x.into_pyarray(py).unbind()),
            labels: cloud.labels.map(|x| x.into_pyarray(py).unbind()),
            label_shares: cloud
                .label_shares
                .map(|shares| Py::new(py, PyClassShares(shares.into())))
                .transpose()?,
            num_no_returns: cloud.num_no_returns,
            is_return: cloud.is_return.into_pyarray(py).unbind(),
        })
    }
}

#[pyfunction]
#[pyo3(signature = (paths, max_points=MAX_POINTS))]
pub(super) fn read_point_clouds(
    py: Python<'_>,
    paths: Vec<(PathBuf, Option<PathBuf>)>,
    max_points: usize,
) -> PyResult<Vec<PyPointCloud>> {
    let clouds = detached(py, || point_cloud::read_all(&paths, Limit { max_points }))?;
    clouds.into_iter().map(|cloud| PyPointCloud::new(py, cloud)).collect()
}

#[pyfunction]
#[pyo3(signature = (path, npy, labels, max_points=MAX_POINTS))]
pub(super) fn parse_point_cloud(
    py: Python<'_>,
    path: PathBuf,
    npy: &[u8],
    labels: Option<PathBuf>,
    max_points: usize,
) -> PyResult<PyPointCloud> {
    let (format, limit) = (point_cloud::Format::Npy, Limit { max_points });
    let cloud = detached(py, || point_cloud::read_as(format, &path, npy, labels.as_deref(), limit))?;
    PyPointCloud::new(py, cloud)
}
