//! Synthetic streets.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::to_array2;
use super::camera::PyCamera;
use super::errors::value_error;
use super::poses::isometry;
use super::threads::detached;
use crate::world::{Class, Lidar, Renderer, Rig, ScanPattern, Visibility};

/// Points (N, 4), labels (N,), visibility (N,), image labels (H, W), picture (H, W, 3), objects in view.
pub(super) type RenderedArrays<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u8>>,
    Bound<'py, PyArray2<u8>>,
    Bound<'py, PyArray3<u8>>,
    usize,
);

#[pyclass(name = "Renderer", frozen)]
pub(super) struct PyRenderer {
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

#[pyfunction]
pub(super) fn synthetic_classes() -> Vec<(u8, &'static str)> {
    Class::ALL.iter().map(|&class| (class as u8, class.name())).collect()
}
