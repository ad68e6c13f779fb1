//! Synthetic streets.

use geometry::shutter::Shutter;
use nalgebra::{Isometry3, Vector6};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use streets::{Class, Lidar, RenderedFrame, Renderer, Rig, Visibility};

use super::arrays::{Pose, to_array2};
use super::calls::detached;
use super::camera::PyCamera;
use super::configs::Foreign;
use crate::error::Error;

#[pyclass(name = "Renderer", frozen)]
pub(super) struct PyRenderer {
    renderer: Renderer,
    /// Rows and columns of the image.
    size: [usize; 2],
}

#[pymethods]
impl PyRenderer {
    #[new]
    #[pyo3(signature = (camera, t_camera_rig, config, t_rig_lidar = None, lidar_number = 0))]
    fn new(
        camera: &PyCamera,
        t_camera_rig: Pose,
        config: &Bound<'_, PyAny>,
        t_rig_lidar: Option<Pose>,
        lidar_number: u32,
    ) -> PyResult<Self> {
        let (Foreign(lidar), Foreign(shutter)): (Foreign<Lidar>, Foreign<Shutter>) =
            (config.extract()?, config.extract()?);
        let rig = Rig {
            lidar,
            lidar_number,
            t_rig_lidar: t_rig_lidar.map_or_else(Isometry3::identity, |pose| pose.0),
            camera: camera.0.clone(),
            t_camera_rig: t_camera_rig.0,
            shutter,
        };
        let size = [camera.0.height, camera.0.width];
        Ok(Self { renderer: detached(|| Renderer::new(rig)).map_err(Error::from)?, size })
    }

    #[pyo3(signature = (seed, number, twist_per_s = None))]
    fn frame(
        &self,
        py: Python<'_>,
        seed: u64,
        number: u64,
        twist_per_s: Option<[f64; 6]>,
    ) -> PyResult<PyRenderedFrame> {
        let frame = detached(|| match twist_per_s {
            None => Ok(self.renderer.frame(seed, number)),
            Some(twist) => self.renderer.frame_in_motion(seed, number, Vector6::from(twist)),
        })
        .map_err(Error::from)?;
        PyRenderedFrame::new(py, frame, self.size)
    }
}

#[pyclass(name = "RenderedFrame", frozen, get_all)]
pub(super) struct PyRenderedFrame {
    points: Py<PyArray2<f32>>,
    point_times: Py<PyArray1<f32>>,
    point_labels: Py<PyArray1<u32>>,
    point_visibility: Py<PyArray1<u8>>,
    image_labels: Py<PyArray2<u8>>,
    image_rgb: Py<PyArray3<u8>>,
    num_objects: usize,
}

impl PyRenderedFrame {
    fn new(py: Python<'_>, frame: RenderedFrame, [height, width]: [usize; 2]) -> PyResult<Self> {
        let visibility = |v: Visibility| match v {
            Visibility::Outside => 0u8,
            Visibility::Hidden => 1,
            Visibility::Visible => 2,
        };
        let point_visibility: Vec<u8> = frame.point_visibility.into_iter().map(visibility).collect();
        let rgb = frame.image_rgb.into_flattened().into_pyarray(py);
        Ok(Self {
            points: to_array2(py, &frame.points)?.unbind(),
            point_times: frame.point_times.into_pyarray(py).unbind(),
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
