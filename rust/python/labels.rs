//! Sweeps, class shares and label images, read from files.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods, PyReadonlyArray1,
    PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::arrays::dense_image;
use super::calls::{detached, value_error};
use crate::classes::{self, ClassShares, NUM_IDS};
use crate::label_image::{Encoding, LabelImage};
use crate::point_cloud::{self, Limit, MAX_POINTS, OwnPoints, PointCloud, Reading, RecordLayout};
use crate::probabilities;
use crate::speckle::despeckled;

#[pyclass(name = "PointCloud", frozen, get_all)]
pub(super) struct PyPointCloud {
    points: Py<PyArray2<f32>>,
    intensity: Option<Py<PyArray1<f32>>>,
    ring: Option<Py<PyArray1<u16>>>,
    time: Option<Py<PyArray1<f64>>>,
    labels: Option<Py<PyArray1<u16>>>,
    label_shares: Option<Py<PyClassShares>>,
    num_no_returns: usize,
    is_kept: Py<PyArray1<bool>>,
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
            is_kept: cloud.is_kept.into_pyarray(py).unbind(),
        })
    }
}

#[pyfunction]
#[pyo3(signature = (
    paths, max_points=MAX_POINTS, columns=None, item_bytes=4, seconds_per_unit=None, own_points=None
))]
pub(super) fn read_point_clouds(
    py: Python<'_>,
    paths: Vec<(PathBuf, Option<PathBuf>)>,
    max_points: usize,
    columns: Option<Vec<String>>,
    item_bytes: usize,
    seconds_per_unit: Option<f64>,
    own_points: Option<(String, [f64; 2])>,
) -> PyResult<Vec<PyPointCloud>> {
    let layout =
        columns.map(|columns| RecordLayout::new(columns, item_bytes)).transpose().map_err(value_error)?;
    let own_points = own_points.map(|(field, range)| OwnPoints { field, range });
    let reading = Reading { limit: Limit { max_points }, layout, seconds_per_unit, own_points };
    let clouds = detached(|| point_cloud::read_all(&paths, &reading))?;
    clouds.into_iter().map(|cloud| PyPointCloud::new(py, cloud)).collect()
}

#[pyfunction]
#[pyo3(signature = (path, npy, labels, max_points=MAX_POINTS, seconds_per_unit=None, own_points=None))]
pub(super) fn parse_point_cloud(
    py: Python<'_>,
    path: PathBuf,
    npy: &[u8],
    labels: Option<PathBuf>,
    max_points: usize,
    seconds_per_unit: Option<f64>,
    own_points: Option<(String, [f64; 2])>,
) -> PyResult<PyPointCloud> {
    let format = point_cloud::Format::Npy;
    let own_points = own_points.map(|(field, range)| OwnPoints { field, range });
    let reading = Reading { limit: Limit { max_points }, layout: None, seconds_per_unit, own_points };
    let cloud = detached(|| point_cloud::read_as(format, &path, npy, labels.as_deref(), &reading))?;
    PyPointCloud::new(py, cloud)
}

#[pyclass(name = "ClassShares", frozen)]
pub(super) struct PyClassShares(pub(super) Arc<ClassShares>);

#[pymethods]
impl PyClassShares {
    #[staticmethod]
    fn certain(classes: PyReadonlyArray1<u8>) -> Self {
        Self(ClassShares::certain(classes.as_array().iter().copied()).into())
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u16>> {
        let mut ids: Vec<u16> = self.0.entries().iter().map(|share| share.class.into()).collect();
        ids.sort_unstable();
        ids.dedup();
        ids.into_pyarray(py)
    }

    #[getter]
    fn classes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        self.0.classes().into_pyarray(py)
    }

    fn renamed(&self, table: PyReadonlyArray1<u8>) -> PyResult<Self> {
        let table = table.as_array().to_vec().try_into();
        let table: [u8; 256] = table.map_err(|_| value_error("table needs 256 classes"))?;
        Ok(Self(detached(|| self.0.renamed(&table)).into()))
    }
}

#[pyfunction]
#[pyo3(signature = (paths, width, height, palette=None))]
pub(super) fn read_label_images(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    width: usize,
    height: usize,
    palette: Option<Vec<[u8; 3]>>,
) -> PyResult<Vec<Bound<'_, PyArray2<u16>>>> {
    let encoding = encoding(width, height, palette);
    let images = detached(|| encoding.read_all(&paths))?;
    let array = |image: LabelImage<u16>| image.ids.into_pyarray(py).reshape([height, width]);
    images.into_iter().map(array).collect()
}

#[pyfunction]
#[pyo3(signature = (paths, width, height, columns, rows, palette=None))]
pub(super) fn read_label_thumbnails(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    width: usize,
    height: usize,
    columns: usize,
    rows: usize,
    palette: Option<Vec<[u8; 3]>>,
) -> PyResult<Bound<'_, PyArray3<u16>>> {
    let encoding = encoding(width, height, palette);
    let images = detached(|| encoding.read_thumbnails(&paths, (columns, rows)))?;
    let ids: Vec<u16> = images.into_iter().flat_map(|image| image.ids).collect();
    ids.into_pyarray(py).reshape([paths.len(), rows, columns])
}

#[pyfunction]
pub(super) fn read_class_shares(paths: Vec<PathBuf>, shape: Vec<usize>) -> PyResult<Vec<PyClassShares>> {
    let shares = detached(|| probabilities::read_all(&paths, &shape))?;
    Ok(shares.into_iter().map(|shares| PyClassShares(shares.into())).collect())
}

#[pyfunction]
pub(super) fn seen_ids<'py>(
    py: Python<'py>,
    ids: Vec<PyReadonlyArrayDyn<u16>>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let frames = ids.iter().map(PyReadonlyArrayDyn::as_slice).collect::<Result<Vec<_>, _>>()?;
    Ok(detached(|| classes::seen_ids(&frames)).into_pyarray(py))
}

#[pyfunction]
pub(super) fn look_up_classes<'py>(
    py: Python<'py>,
    ids: PyReadonlyArrayDyn<u16>,
    table: PyReadonlyArray1<u8>,
) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
    let table: &[u8; NUM_IDS] =
        table.as_slice()?.try_into().map_err(|_| value_error(format!("table needs {NUM_IDS} classes")))?;
    let values = ids.as_slice()?;
    detached(|| classes::look_up(values, table)).into_pyarray(py).reshape(ids.shape())
}

#[pyfunction]
pub(super) fn despeckle<'py>(
    py: Python<'py>,
    image_classes: Vec<PyReadonlyArray2<u8>>,
) -> PyResult<Vec<(Bound<'py, PyArray2<u8>>, usize)>> {
    let images: Vec<LabelImage<u8>> = image_classes.iter().map(dense_image).collect();
    let mended: Vec<_> = detached(|| images.par_iter().map(despeckled).collect());
    let array = |(image, count): (LabelImage<u8>, usize)| {
        Ok((image.ids.into_pyarray(py).reshape([image.height, image.width])?, count))
    };
    mended.into_iter().map(array).collect()
}

pub(super) fn encoding(width: usize, height: usize, palette: Option<Vec<[u8; 3]>>) -> Encoding {
    Encoding { size: (width, height), palette: palette.map(|colors| colors.into_iter().zip(0..).collect()) }
}
