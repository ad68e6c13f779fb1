//! Synthetic streets.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::to_array2;
use super::camera::PyCamera;
use super::poses::isometry;
use super::threads::detached;
use crate::world::{Class, Frame, Lidar, Renderer, Rig, Visibility};

#[pyclass(name = "Renderer", frozen)]
pub(super) struct PyRenderer {
    renderer: Renderer,
    /// Rows and columns of the picture.
    size: [usize; 2],
}

#[pymethods]
impl PyRenderer {
    #[new]
    fn new(
        py: Python<'_>,
        camera: &PyCamera,
        t_camera_lidar: PyReadonlyArray2<f64>,
        config: Lidar,
    ) -> PyResult<Self> {
        let rig = Rig { lidar: config, camera: camera.0.clone(), t_camera_lidar: isometry(&t_camera_lidar)? };
        let size = [camera.0.height, camera.0.width];
        Ok(Self { renderer: detached(py, || Renderer::new(rig))?, size })
    }

    fn frame(&self, py: Python<'_>, seed: u64, number: u64) -> PyResult<PyRenderedFrame> {
        PyRenderedFrame::new(py, detached(py, || self.renderer.frame(seed, number)), self.size)
    }
}

#[pyclass(name = "RenderedFrame", frozen, get_all)]
pub(super) struct PyRenderedFrame {
    points: Py<PyArray2<f32>>,
    point_labels: Py<PyArray1<u32>>,
    point_visibility: Py<PyArray1<u8>>,
    image_labels: Py<PyArray2<u8>>,
    image_rgb: Py<PyArray3<u8>>,
    num_objects: usize,
}

impl PyRenderedFrame {
    fn new(py: Python<'_>, frame: Frame, [height, width]: [usize; 2]) -> PyResult<Self> {
        let visibility = |v: Visibility| match v {
            Visibility::Outside => 0u8,
            Visibility::Hidden => 1,
            Visibility::Visible => 2,
        };
        let point_visibility: Vec<u8> = frame.point_visibility.into_iter().map(visibility).collect();
        let rgb = frame.image_rgb.into_flattened().into_pyarray(py);
        Ok(Self {
            points: to_array2(py, &frame.points)?.unbind(),
            point_labels: frame.point_labels.into_pyarray(py).unbind(),
            point_visibility: point_visibility.into_pyarray(py).unbind(),
            image_labels: frame.image_labels.into_pyarray(py).reshape([height, width])?.unbind(),
            image_rgb: rgb.reshape([height, width, 3])?.unbind(),
            num_objects: frame.num_objects,
        })
    }
}

#[pyfunction]
pub(super) fn synthetic_classes() -> Vec<(u8, &'static str)> {
    Class::ALL.iter().map(|&class| (class as u8, class.name())).collect()
}
