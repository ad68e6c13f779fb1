//! The Python face of the core: checks, copies in, releases the GIL, calls, copies out.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{DMatrix, Isometry3, Matrix3x4, Matrix6, Rotation3, Translation3, UnitQuaternion, Vector3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::ThreadPool;
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::agreement::{held_out_gain as measure_gain, measure as measure_agreement};
use crate::alignment::{self, AlignmentConfig, Anchored, Counted, PolishConfig, SensitivityConfig};
use crate::camera::Camera;
use crate::class_shares::ClassShares;
use crate::correspondences::{self, Correspondence};
use crate::error::{Error, Result};
use crate::label_image::{Encoding, LabelImage};
use crate::motion::Trajectory;
use crate::observation::{Frame, Observations};
use crate::point_cloud::{self, PointCloud};
use crate::probabilities;
use crate::registration::{self, Hypothesis, RegistrationConfig};
use crate::semantic_distance::{ClassInFrame, DescentConfig, SemanticDistance};
use crate::speckle::despeckled;
use crate::spherical::{self, SphericalGrid, SphericalImages};
use crate::visibility;
use crate::world::{Class, Lidar, Renderer, Rig, ScanPattern, Visibility};
use crate::zoom::Zoom;

pyo3::import_exception!(semcal_cli.errors, InputError);
pyo3::import_exception!(semcal_cli.errors, CalibrationError);

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::File { .. } | Error::Input(_) => InputError::new_err(message),
            Error::Calibration(_) => CalibrationError::new_err(message),
        }
    }
}

/// The threads of every parallel call; rayon's own default until [`set_num_threads`] is called.
static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

/// Runs `f` without the GIL, on the chosen number of threads.
fn detached<T: Send>(py: Python<'_>, f: impl Send + FnOnce() -> T) -> T {
    py.detach(|| {
        let pool = POOL.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match pool {
            Some(pool) => pool.install(f),
            None => f(),
        }
    })
}

/// A matrix from NumPy.
fn matrix_6x6(matrix: &PyReadonlyArray2<f64>) -> PyResult<Matrix6<f64>> {
    let matrix = matrix.as_array();
    if matrix.shape() != [6, 6] {
        return Err(value_error(format!(
            "found an inverse curvature of {:?}, needed [6, 6]",
            matrix.shape()
        )));
    }
    Ok(Matrix6::from_fn(|row, column| matrix[[row, column]]))
}

fn value_error(message: impl Into<String>) -> PyErr {
    PyValueError::new_err(message.into())
}

/// The first three rows of `T_camera_lidar`.
fn affine(matrix: &PyReadonlyArray2<f64>) -> PyResult<Matrix3x4<f64>> {
    let m = matrix.as_array();
    if m.dim() != (4, 4) || m.iter().any(|x| !x.is_finite()) {
        return Err(value_error("T_camera_lidar needs to be a finite 4 x 4 matrix"));
    }
    Ok(Matrix3x4::from_fn(|i, j| m[[i, j]]))
}

/// `T_camera_lidar`, which is taken to be rigid.
fn isometry(matrix: &PyReadonlyArray2<f64>) -> PyResult<Isometry3<f64>> {
    let m = affine(matrix)?;
    let rotation = Rotation3::from_matrix_unchecked(m.fixed_columns::<3>(0).into_owned());
    Ok(Isometry3::from_parts(
        Translation3::from(m.column(3).into_owned()),
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}

fn matrix<'py>(py: Python<'py>, pose: &Isometry3<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: [[f64; 4]; 4] = pose.to_homogeneous().transpose().into();
    to_array2(py, &rows)
}

fn rows<const N: usize, T: Copy + numpy::Element>(
    name: &str,
    array: &PyReadonlyArray2<T>,
) -> PyResult<Vec<[T; N]>> {
    let array = array.as_array();
    if array.ncols() != N {
        return Err(value_error(format!("{name} needs shape (N, {N}), found {:?}", array.dim())));
    }
    Ok(array.rows().into_iter().map(|row| std::array::from_fn(|i| row[i])).collect())
}

fn to_array2<'py, const N: usize, T: Copy + numpy::Element>(
    py: Python<'py>,
    rows: &[[T; N]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    rows.as_flattened().to_vec().into_pyarray(py).reshape([rows.len(), N])
}

fn dense_image(array: &PyReadonlyArray2<u8>) -> LabelImage<u8> {
    let array = array.as_array();
    let (height, width) = array.dim();
    LabelImage { width, height, ids: array.iter().copied().collect() }
}

#[pyclass(name = "Camera", frozen)]
struct PyCamera(Camera);

#[pymethods]
impl PyCamera {
    #[new]
    #[pyo3(signature = (model, width, height, k, distortion, parameters=BTreeMap::new()))]
    fn new(
        model: &str,
        width: usize,
        height: usize,
        k: [[f64; 3]; 3],
        distortion: Vec<f64>,
        parameters: BTreeMap<String, f64>,
    ) -> Result<Self> {
        let parameters: Vec<_> = parameters.into_iter().collect();
        Ok(Self(Camera::with_parameters(model, (width, height), k, &distortion, &parameters)?))
    }

    /// Pixels (N, 2) of points (N, 3) in the camera frame; NaN where the model does not hold.
    fn project<'py>(
        &self,
        py: Python<'py>,
        points_camera: PyReadonlyArray2<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points: Vec<[f64; 3]> = rows("points_camera", &points_camera)?;
        let pixel = |&p: &[f64; 3]| match self.0.project(&Vector3::from(p)) {
            Some(pixel) => [pixel.x, pixel.y],
            None => [f64::NAN; 2],
        };
        to_array2(py, &points.iter().map(pixel).collect::<Vec<_>>())
    }

    /// Unit rays (N, 3) in the camera frame of pixels (N, 2); NaN where the lens does not reach.
    fn unproject<'py>(
        &self,
        py: Python<'py>,
        pixels: PyReadonlyArray2<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pixels: Vec<[f64; 2]> = rows("pixels", &pixels)?;
        let ray = |&p: &[f64; 2]| self.0.unproject(&p.into()).map_or([f64::NAN; 3], Into::into);
        to_array2(py, &pixels.iter().map(ray).collect::<Vec<_>>())
    }

    /// The largest incidence angle, radians, at which the model holds.
    #[getter]
    fn limit(&self) -> f64 {
        self.0.limit()
    }

    /// Columns a radian on the optical axis.
    #[getter]
    fn pixels_per_radian(&self) -> f64 {
        self.0.pixels_per_radian()
    }
}

#[pyclass(name = "ClassShares", frozen)]
struct PyClassShares(ClassShares);

#[pymethods]
impl PyClassShares {
    #[staticmethod]
    fn certain(classes: PyReadonlyArray1<u8>) -> Self {
        Self(ClassShares::certain(classes.as_array().iter().copied()))
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

    fn renamed(&self, py: Python<'_>, table: PyReadonlyArray1<u8>) -> PyResult<Self> {
        let table = table.as_array().to_vec().try_into();
        let table: [u8; 256] = table.map_err(|_| value_error("table needs 256 classes"))?;
        Ok(Self(detached(py, || self.0.renamed(&table))))
    }
}

#[pyclass(name = "Observations", frozen)]
struct PyObservations(Arc<Observations>);

#[pymethods]
impl PyObservations {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        camera: &PyCamera,
        points: Vec<PyReadonlyArray2<f32>>,
        point_classes: Vec<PyReadonlyArray1<u8>>,
        image_classes: Vec<PyReadonlyArray2<u8>>,
        num_point_classes: usize,
        num_image_classes: usize,
        point_shares: Vec<Option<PyRef<'_, PyClassShares>>>,
        image_shares: Vec<Option<PyRef<'_, PyClassShares>>>,
    ) -> PyResult<Self> {
        let lengths = [point_classes.len(), image_classes.len(), point_shares.len(), image_shares.len()];
        if lengths.iter().any(|&length| length != points.len()) {
            return Err(value_error("points, classes and shares differ in length"));
        }
        let shares = |of: &Option<PyRef<'_, PyClassShares>>| of.as_ref().map(|shares| shares.0.clone());
        let frames: PyResult<Vec<Frame>> = (0..points.len())
            .map(|i| {
                Ok(Frame {
                    points: rows("points", &points[i])?,
                    point_classes: point_classes[i].as_array().to_vec(),
                    image_classes: dense_image(&image_classes[i]),
                    point_shares: shares(&point_shares[i]),
                    image_shares: shares(&image_shares[i]),
                })
            })
            .collect();
        let camera = camera.0.clone();
        let observations = Observations::new(camera, frames?, num_point_classes, num_image_classes)?;
        Ok(Self(Arc::new(observations)))
    }
}

#[pyclass(name = "AnchoredPoints", frozen)]
struct PyAnchoredPoints(Anchored);

#[pymethods]
impl PyAnchoredPoints {
    #[new]
    #[pyo3(signature = (observations, anchor, *, factor, edge_band, visible_only))]
    fn new(
        py: Python<'_>,
        observations: &PyObservations,
        anchor: PyReadonlyArray2<f64>,
        factor: usize,
        edge_band: usize,
        visible_only: bool,
    ) -> PyResult<Self> {
        check_factor(factor, &observations.0.camera)?;
        let (anchor, counted) = (isometry(&anchor)?, counted(visible_only));
        let new = || Anchored::new(Arc::clone(&observations.0), factor, edge_band, &anchor, counted);
        Ok(Self(detached(py, new)))
    }

    #[getter]
    fn classes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        self.0.classes().collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.0.weights().collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn unit_motions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows: Vec<[f64; 6]> =
            self.0.unit_motions().row_iter().map(|row| row.transpose().into()).collect();
        to_array2(py, &rows)
    }

    fn shares<'py>(
        &self,
        py: Python<'py>,
        indices: PyReadonlyArray1<i64>,
        t_camera_lidar: PyReadonlyArray2<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (indices, t_camera_lidar) = (self.indices(&indices)?, affine(&t_camera_lidar)?);
        let shares = detached(py, || self.0.shares(&indices, &t_camera_lidar));
        shares.into_pyarray(py).reshape([indices.len(), self.0.num_image_classes()])
    }

    fn pull_back<'py>(
        &self,
        py: Python<'py>,
        indices: PyReadonlyArray1<i64>,
        t_camera_lidar: PyReadonlyArray2<f64>,
        gradient: PyReadonlyArray2<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (indices, t_camera_lidar) = (self.indices(&indices)?, affine(&t_camera_lidar)?);
        if gradient.as_array().dim() != (indices.len(), self.0.num_image_classes()) {
            return Err(value_error("gradient needs a row for each index and a column for each image class"));
        }
        let gradient: Vec<f64> = gradient.as_array().iter().copied().collect();
        let pulled = detached(py, || self.0.pull_back(&indices, &t_camera_lidar, &gradient));
        let rows: Vec<[f64; 4]> = pulled.row_iter().map(|row| row.transpose().into()).collect();
        to_array2(py, &rows)
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

#[pyclass(name = "SphericalImages", frozen)]
struct PySphericalImages(SphericalImages);

#[pymethods]
impl PySphericalImages {
    #[new]
    fn new(py: Python<'_>, observations: &PyObservations, grid: (usize, usize, f64, f64)) -> Self {
        Self(detached(py, || SphericalImages::new(&observations.0, to_grid(grid))))
    }
}

#[pyclass(name = "Hypothesis", frozen)]
struct PyHypothesis(Hypothesis);

#[pymethods]
impl PyHypothesis {
    /// Labelled returns, of those that were looked at, that fall on a labelled pixel, over all frames.
    #[getter]
    fn num_pairs(&self) -> usize {
        self.0.num_pairs as usize
    }
}

#[pyclass(name = "Agreement", frozen, get_all)]
struct PyAgreement {
    mutual_information: f64,
    bias: f64,
    sigma: f64,
    label_agreement: f64,
    overlap: f64,
    num_inside: usize,
    num_hidden: usize,
    joint: Py<PyArray2<f64>>,
}

#[pyclass(name = "SemanticDistance", frozen)]
struct PySemanticDistance(SemanticDistance);

#[pymethods]
impl PySemanticDistance {
    #[new]
    #[pyo3(signature = (camera, parts, *, block))]
    fn new(
        camera: &PyCamera,
        parts: Vec<(usize, PyReadonlyArray2<f32>, PyReadonlyArray2<f32>)>,
        block: usize,
    ) -> PyResult<Self> {
        let part = |(class, points, distances): &(usize, PyReadonlyArray2<f32>, PyReadonlyArray2<f32>)| {
            let distances = distances.as_array();
            if block == 0 || distances.is_empty() {
                return Err(value_error("blocks and distance fields need a size"));
            }
            let distances = Arc::new(distances.rows().into_iter().map(|row| row.to_vec()).collect());
            Ok(ClassInFrame { class: *class, points: rows("points", points)?, distances })
        };
        let parts: PyResult<Vec<ClassInFrame>> = parts.iter().map(part).collect();
        Ok(Self(SemanticDistance::new(camera.0.clone(), parts?, block)))
    }

    fn at(&self, py: Python<'_>, t_camera_lidar: PyReadonlyArray2<f64>) -> PyResult<f64> {
        let pose = isometry(&t_camera_lidar)?;
        Ok(detached(py, || self.0.at(&pose)))
    }

    #[pyo3(signature = (t_camera_lidar, *, step_rad, step_m, tolerance, max_rounds, max_restarts, max_points))]
    #[allow(clippy::too_many_arguments)]
    fn minimize<'py>(
        &self,
        py: Python<'py>,
        t_camera_lidar: PyReadonlyArray2<f64>,
        step_rad: f64,
        step_m: f64,
        tolerance: f64,
        max_rounds: usize,
        max_restarts: usize,
        max_points: usize,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, usize, bool)> {
        if max_points == 0 {
            return Err(value_error("max_points needs to be at least 1"));
        }
        let start = isometry(&t_camera_lidar)?;
        let step = (step_rad, step_m);
        let config = DescentConfig { step, tolerance, max_rounds, max_restarts, max_points };
        let found = detached(py, || self.0.minimize(&start, &config))?;
        Ok((matrix(py, &found.pose)?, found.cost, found.num_evaluations, found.converged))
    }
}

#[pyclass(name = "Trajectory", frozen)]
struct PyTrajectory(Trajectory);

#[pymethods]
impl PyTrajectory {
    #[staticmethod]
    fn constant(twist_per_s: [f64; 6], stamp: f64) -> Self {
        Self(Trajectory::constant(twist_per_s.into(), stamp))
    }

    #[staticmethod]
    fn through(stamps: Vec<f64>, poses: Vec<PyReadonlyArray2<f64>>) -> PyResult<Self> {
        let poses = poses.iter().map(isometry).collect::<PyResult<Vec<_>>>()?;
        Ok(Self(Trajectory::through(&stamps, &poses)?))
    }

    fn twist_at(&self, stamp: f64) -> PyResult<[f64; 6]> {
        let twist = self.0.twist_at(stamp).ok_or_else(|| value_error(format!("found no pose at {stamp}")))?;
        Ok(twist.into())
    }

    fn compensate<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        times: Vec<f64>,
        moment: f64,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let points = rows::<3, _>("points", &points)?;
        if points.len() != times.len() {
            return Err(value_error(format!("{} points need as many times", points.len())));
        }
        let moved = detached(py, || self.0.compensate(&points, &times, moment))
            .map_err(|time| value_error(format!("nothing is known of the motion at {time} s")))?;
        to_array2(py, &moved)
    }
}

#[pyclass(name = "PointCloud", frozen, get_all)]
struct PyPointCloud {
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
            label_shares: cloud.label_shares.map(|shares| Py::new(py, PyClassShares(shares))).transpose()?,
            num_no_returns: cloud.num_no_returns,
            is_return: cloud.is_return.into_pyarray(py).unbind(),
        })
    }
}

/// `T_camera_lidar`, blocks moved by the last round, inverse curvature (6, 6).
type PolishArrays<'py> = (Bound<'py, PyArray2<f64>>, f64, Option<Bound<'py, PyArray2<f64>>>);

/// Curvature (n, n), scores (parts, n) and motions (n, n).
type SensitivityArrays<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Points (N, 3) and the pixels (N, 2) they correspond to.
type PairArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// `T_camera_lidar`, mutual information, number of points.
type AlignedTuple<'py> = (Bound<'py, PyArray2<f64>>, f64, usize, f64);

/// Pixels (N, 2), NaN outside the picture; ranges (N,) from the camera; and which points are hidden.
type LandingArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>);

/// Points (N, 4), labels (N,), visibility (N,), image labels (H, W), picture (H, W, 3), objects in view.
type RenderedArrays<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u8>>,
    Bound<'py, PyArray2<u8>>,
    Bound<'py, PyArray3<u8>>,
    usize,
);

#[pyclass(name = "Renderer", frozen)]
struct PyRenderer {
    renderer: Renderer,
    size: (usize, usize),
}

#[pymethods]
impl PyRenderer {
    #[new]
    #[pyo3(signature = (camera, t_camera_lidar, *, pattern, channels, columns, fov_up_deg, fov_down_deg, range_noise_m,
                        dropout, max_range_m, tilt_deg))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        camera: &PyCamera,
        t_camera_lidar: PyReadonlyArray2<f64>,
        pattern: &str,
        channels: usize,
        columns: usize,
        fov_up_deg: f64,
        fov_down_deg: f64,
        range_noise_m: f64,
        dropout: f64,
        max_range_m: f64,
        tilt_deg: f64,
    ) -> PyResult<Self> {
        let pattern = match pattern {
            "spinning" => ScanPattern::Spinning { channels, columns, fov_up_deg, fov_down_deg },
            "rosette" => ScanPattern::Rosette { points: channels * columns, fov_up_deg, fov_down_deg },
            other => return Err(value_error(format!("pattern '{other}' is not known"))),
        };
        let rig = Rig {
            lidar: Lidar { pattern, range_noise_m, dropout, max_range_m, tilt_deg },
            camera: camera.0.clone(),
            t_camera_lidar: isometry(&t_camera_lidar)?,
        };
        let size = (camera.0.height, camera.0.width);
        Ok(Self { renderer: detached(py, || Renderer::new(rig))?, size })
    }

    /// The frame of a number in the world of a seed.
    fn frame<'py>(&self, py: Python<'py>, seed: u64, number: u64) -> PyResult<RenderedArrays<'py>> {
        let frame = detached(py, || self.renderer.frame(seed, number));
        let (height, width) = self.size;
        let visibility = |v: Visibility| match v {
            Visibility::Outside => 0u8,
            Visibility::Hidden => 1,
            Visibility::Visible => 2,
        };
        let visibility: Vec<u8> = frame.point_visibility.into_iter().map(visibility).collect();
        Ok((
            to_array2(py, &frame.points)?,
            frame.point_labels.into_pyarray(py),
            visibility.into_pyarray(py),
            frame.image_labels.into_pyarray(py).reshape([height, width])?,
            frame.image_rgb.as_flattened().to_vec().into_pyarray(py).reshape([height, width, 3])?,
            frame.objects_in_view,
        ))
    }
}

/// The core's functions and classes; `semcal_cli/_core.pyi` documents them.
#[pymodule]
mod _core {
    use super::*;

    #[pymodule_export]
    use super::PyAnchoredPoints;
    #[pymodule_export]
    use super::PyPointCloud;
    #[pymodule_export]
    use super::{
        PyAgreement, PyCamera, PyClassShares, PyHypothesis, PyObservations, PyRenderer, PySemanticDistance,
        PySphericalImages, PyTrajectory,
    };

    #[pyfunction]
    fn set_num_threads(num_threads: usize) -> PyResult<()> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(num_threads)
            .build()
            .map_err(|e| value_error(e.to_string()))?;
        *POOL.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(pool));
        Ok(())
    }

    #[pyfunction]
    fn read_point_clouds(
        py: Python<'_>,
        paths: Vec<(PathBuf, Option<PathBuf>)>,
    ) -> PyResult<Vec<PyPointCloud>> {
        let clouds = detached(py, || point_cloud::read_all(&paths))?;
        clouds.into_iter().map(|cloud| PyPointCloud::new(py, cloud)).collect()
    }

    #[pyfunction]
    fn parse_point_cloud(
        py: Python<'_>,
        path: PathBuf,
        npy: &[u8],
        labels: Option<PathBuf>,
    ) -> PyResult<PyPointCloud> {
        let format = point_cloud::Format::Npy;
        let cloud = detached(py, || point_cloud::read_as(format, &path, npy, labels.as_deref()))?;
        PyPointCloud::new(py, cloud)
    }

    #[pyfunction]
    #[pyo3(signature = (paths, width, height, palette=None))]
    fn read_label_images(
        py: Python<'_>,
        paths: Vec<PathBuf>,
        width: usize,
        height: usize,
        palette: Option<Vec<[u8; 3]>>,
    ) -> PyResult<Vec<Bound<'_, PyArray2<u16>>>> {
        let encoding = encoding(width, height, palette);
        let images = detached(py, || encoding.read_all(&paths))?;
        let array = |image: LabelImage<u16>| image.ids.into_pyarray(py).reshape([height, width]);
        images.into_iter().map(array).collect()
    }

    #[pyfunction]
    #[pyo3(signature = (paths, width, height, columns, rows, palette=None))]
    fn read_label_thumbnails(
        py: Python<'_>,
        paths: Vec<PathBuf>,
        width: usize,
        height: usize,
        columns: usize,
        rows: usize,
        palette: Option<Vec<[u8; 3]>>,
    ) -> PyResult<Bound<'_, PyArray3<u16>>> {
        let encoding = encoding(width, height, palette);
        let images = detached(py, || encoding.read_thumbnails(&paths, (columns, rows)))?;
        let ids: Vec<u16> = images.into_iter().flat_map(|image| image.ids).collect();
        ids.into_pyarray(py).reshape([paths.len(), rows, columns])
    }

    #[pyfunction]
    fn read_class_shares(
        py: Python<'_>,
        paths: Vec<PathBuf>,
        shape: Vec<usize>,
    ) -> PyResult<Vec<PyClassShares>> {
        let shares = detached(py, || probabilities::read_all(&paths, &shape))?;
        Ok(shares.into_iter().map(PyClassShares).collect())
    }

    #[pyfunction]
    fn student_quantile(probability: f64, degrees_of_freedom: f64) -> PyResult<f64> {
        let student = StudentsT::new(0.0, 1.0, degrees_of_freedom).map_err(|e| value_error(e.to_string()))?;
        if !(0.0..=1.0).contains(&probability) {
            return Err(value_error(format!("a probability is from 0 to 1, found {probability}")));
        }
        Ok(student.inverse_cdf(probability))
    }

    #[pyfunction]
    #[pyo3(signature = (observations, t_camera_lidar, *, factor, edge_band, max_points, with_intrinsics, regions_across))]
    #[allow(clippy::too_many_arguments)]
    fn sensitivity<'py>(
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

    #[pyfunction]
    fn despeckle<'py>(
        py: Python<'py>,
        image_classes: Vec<PyReadonlyArray2<u8>>,
    ) -> PyResult<Vec<(Bound<'py, PyArray2<u8>>, usize)>> {
        let images: Vec<LabelImage<u8>> = image_classes.iter().map(dense_image).collect();
        let mended: Vec<_> = detached(py, || images.par_iter().map(despeckled).collect());
        let array = |(image, count): (LabelImage<u8>, usize)| {
            Ok((image.ids.into_pyarray(py).reshape([image.height, image.width])?, count))
        };
        mended.into_iter().map(array).collect()
    }

    #[pyfunction]
    #[pyo3(signature = (observations, images, *, zoom, coarse_cell, fine_cell, max_roll, roll_step, around, min_cells_of_most,
                        num_hypotheses, separation))]
    #[allow(clippy::too_many_arguments)]
    fn register(
        py: Python<'_>,
        observations: &PyObservations,
        images: &PySphericalImages,
        zoom: &str,
        coarse_cell: f64,
        fine_cell: f64,
        max_roll: f64,
        roll_step: f64,
        around: Option<(PyReadonlyArray2<f64>, f64)>,
        min_cells_of_most: f64,
        num_hypotheses: usize,
        separation: f64,
    ) -> PyResult<Vec<PyHypothesis>> {
        let around = match &around {
            Some((pose, angle)) => Some((isometry(pose)?.rotation.to_rotation_matrix(), *angle)),
            None => None,
        };
        let config = RegistrationConfig {
            zoom: parse_zoom(zoom)?,
            coarse_cell,
            fine_cell,
            max_roll,
            roll_step,
            around,
            min_cells_of_most,
            num_hypotheses,
            separation,
        };
        let found = detached(py, || registration::register(&observations.0, &images.0, &config))?;
        Ok(found.into_iter().map(PyHypothesis).collect())
    }

    #[pyfunction]
    fn scan_grid(
        channels: usize,
        columns: usize,
        fov_up: f64,
        fov_down: f64,
    ) -> PyResult<(usize, usize, f64, f64)> {
        Ok(from_grid(&SphericalGrid::from_scan(channels, columns, fov_up, fov_down)?))
    }

    #[pyfunction]
    fn estimate_grid(py: Python<'_>, observations: &PyObservations) -> PyResult<(usize, usize, f64, f64)> {
        let sweeps: Vec<&[[f32; 3]]> = observations.0.frames.iter().map(|f| f.points.as_slice()).collect();
        Ok(from_grid(&detached(py, || spherical::estimate(&sweeps))?))
    }

    #[pyfunction]
    fn spherical_image<'py>(
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        grid: (usize, usize, f64, f64),
    ) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let (points, grid) = (rows("points", &points)?, to_grid(grid));
        grid.project(&points).into_pyarray(py).reshape([grid.rows, grid.columns])
    }

    #[pyfunction]
    fn sample_correspondences<'py>(
        py: Python<'py>,
        observations: &PyObservations,
        images: &PySphericalImages,
        zoom: &str,
        hypotheses: Vec<PyRef<'py, PyHypothesis>>,
        count: usize,
        seed: u64,
    ) -> PyResult<Vec<PairArrays<'py>>> {
        let zoom = parse_zoom(zoom)?;
        let hypotheses: Vec<Hypothesis> = hypotheses.iter().map(|h| h.0.clone()).collect();
        let samples = detached(py, || {
            correspondences::sample(&observations.0, &images.0, zoom, &hypotheses, count, seed)
        })?;
        let arrays = |pairs: Vec<Correspondence>| {
            let points: Vec<[f64; 3]> = pairs.iter().map(|c| c.point.map(f64::from)).collect();
            let pixels: Vec<[f64; 2]> = pairs.iter().map(|c| [c.pixel.x, c.pixel.y]).collect();
            Ok((to_array2(py, &points)?, to_array2(py, &pixels)?))
        };
        samples.into_iter().map(arrays).collect()
    }

    #[pyfunction]
    fn agreement(
        py: Python<'_>,
        observations: &PyObservations,
        t_camera_lidar: PyReadonlyArray2<f64>,
    ) -> PyResult<PyAgreement> {
        let pose = isometry(&t_camera_lidar)?;
        let found = detached(py, || measure_agreement(&observations.0, &pose));
        let shape = [observations.0.num_point_classes, observations.0.num_image_classes];
        let joint = PyArray1::from_slice(py, &found.joint.weights).reshape(shape)?;
        Ok(PyAgreement {
            mutual_information: found.joint.mutual_information(),
            bias: found.joint.bias(),
            sigma: found.sigma,
            label_agreement: found.label_agreement(),
            overlap: found.overlap,
            num_inside: found.num_inside,
            num_hidden: found.num_hidden,
            joint: joint.unbind(),
        })
    }

    #[pyfunction]
    fn held_out_gain(
        py: Python<'_>,
        observations: &PyObservations,
        held_out: &PyObservations,
        before: PyReadonlyArray2<f64>,
        after: PyReadonlyArray2<f64>,
    ) -> PyResult<(f64, f64)> {
        let (before, after) = (isometry(&before)?, isometry(&after)?);
        let num_classes =
            |observations: &Observations| (observations.num_point_classes, observations.num_image_classes);
        if num_classes(&observations.0) != num_classes(&held_out.0) {
            return Err(value_error("the held-out observations have other numbers of classes"));
        }
        let gain = detached(py, || measure_gain(&observations.0, &held_out.0, &before, &after));
        Ok((gain.mean, gain.sigma))
    }

    #[pyfunction]
    #[pyo3(signature = (observations, t_camera_lidar, *, factor, edge_band, visible_only, steps, batch_size, step_size, final_step,
                        max_baseline, max_points, seed))]
    #[allow(clippy::too_many_arguments)]
    fn align<'py>(
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
        found
            .iter()
            .map(|a| Ok((matrix(py, &a.pose)?, a.mutual_information, a.num_points, a.drift)))
            .collect()
    }

    #[pyfunction]
    #[pyo3(signature = (observations, t_camera_lidar, *, factor, edge_band, visible_only, max_rounds, max_steps, tolerance,
                        max_baseline, inverse_curvature=None))]
    #[allow(clippy::too_many_arguments)]
    fn polish<'py>(
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
        let config =
            PolishConfig { factor, edge_band, counted, max_rounds, max_steps, tolerance, max_baseline };
        let inverse_curvature = inverse_curvature.map(|matrix| matrix_6x6(&matrix)).transpose()?;
        let found =
            detached(py, || alignment::polish(&observations.0, &start, inverse_curvature.as_ref(), &config));
        let array =
            |matrix: Matrix6<f64>| PyArray2::from_vec2(py, &<[[f64; 6]; 6]>::from(matrix).map(Vec::from));
        Ok((matrix(py, &found.pose)?, found.moved, found.inverse_curvature.map(array).transpose()?))
    }

    #[pyfunction]
    fn land<'py>(
        py: Python<'py>,
        camera: &PyCamera,
        points: PyReadonlyArray2<f32>,
        t_camera_lidar: PyReadonlyArray2<f64>,
    ) -> PyResult<LandingArrays<'py>> {
        let (points, pose) = (rows("points", &points)?, isometry(&t_camera_lidar)?);
        let (landings, hidden) = detached(py, || {
            let landings = visibility::land(&camera.0, &points, &pose);
            let hidden = visibility::hidden(&camera.0, &landings);
            (landings, hidden)
        });
        let pixels: Vec<[f64; 2]> =
            landings.iter().map(|l| l.map_or([f64::NAN; 2], |l| l.pixel.into())).collect();
        let ranges: Vec<f64> = landings.iter().map(|l| l.map_or(f64::NAN, |l| l.range)).collect();
        Ok((to_array2(py, &pixels)?, ranges.into_pyarray(py), hidden.into_pyarray(py)))
    }

    #[pyfunction]
    fn quaternion(t: PyReadonlyArray2<f64>) -> PyResult<[f64; 4]> {
        let rotation = isometry(&t)?.rotation.into_inner().normalize();
        let canonical = if rotation.w < 0.0 { -rotation } else { rotation };
        Ok(canonical.coords.into())
    }

    #[pyfunction]
    fn synthetic_classes() -> Vec<(u8, &'static str)> {
        Class::ALL.iter().map(|&class| (class as u8, class.name())).collect()
    }
}

fn check_factor(factor: usize, camera: &Camera) -> PyResult<()> {
    if factor == 0 || factor > camera.width.min(camera.height) {
        return Err(value_error(format!("factor {factor} does not fit the picture")));
    }
    Ok(())
}

fn counted(visible_only: bool) -> Counted {
    if visible_only { Counted::Visible } else { Counted::All }
}

fn encoding(width: usize, height: usize, palette: Option<Vec<[u8; 3]>>) -> Encoding {
    Encoding { size: (width, height), palette: palette.map(|colors| colors.into_iter().zip(0..).collect()) }
}

fn parse_zoom(zoom: &str) -> PyResult<Zoom> {
    match zoom {
        "exact" => Ok(Zoom::Exact),
        "paper" => Ok(Zoom::Paper),
        other => Err(value_error(format!("zoom '{other}' is not known, needs exact or paper"))),
    }
}

fn to_grid((rows, columns, top, cell_height): (usize, usize, f64, f64)) -> SphericalGrid {
    SphericalGrid { rows, columns, top, cell_height }
}

fn from_grid(grid: &SphericalGrid) -> (usize, usize, f64, f64) {
    (grid.rows, grid.columns, grid.top, grid.cell_height)
}
