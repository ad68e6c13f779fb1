//! The camera, and projection of points into its image.

use std::collections::BTreeMap;

use geometry::camera::Camera;
use nalgebra::Vector3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::arrays::{Array2, Pose, rows, to_array2};
use super::calls::detached;
use crate::error::Result;
use crate::visibility;

#[pyclass(name = "Camera", frozen)]
pub(super) struct PyCamera(pub(super) Camera);

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

    fn project<'py>(&self, py: Python<'py>, points_camera: PyReadonlyArray2<f64>) -> PyResult<Array2<'py>> {
        let points: Vec<[f64; 3]> = rows("points_camera", &points_camera)?;
        let pixel = |&p: &[f64; 3]| match self.0.project(&Vector3::from(p)) {
            Some(pixel) => [pixel.x, pixel.y],
            None => [f64::NAN; 2],
        };
        to_array2(py, &points.iter().map(pixel).collect::<Vec<_>>())
    }

    fn unproject<'py>(&self, py: Python<'py>, pixels: PyReadonlyArray2<f64>) -> PyResult<Array2<'py>> {
        let pixels: Vec<[f64; 2]> = rows("pixels", &pixels)?;
        let ray = |&p: &[f64; 2]| self.0.unproject(&p.into()).map_or([f64::NAN; 3], Into::into);
        let rays: Vec<[f64; 3]> = detached(|| pixels.par_iter().map(ray).collect());
        to_array2(py, &rays)
    }

    #[getter]
    fn limit(&self) -> f64 {
        self.0.limit()
    }

    #[getter]
    fn pixels_per_radian(&self) -> f64 {
        self.0.pixels_per_radian()
    }
}

#[pyclass(name = "Projected", frozen, get_all)]
pub(super) struct PyProjected {
    pixels: Py<PyArray2<f64>>,
    ranges: Py<PyArray1<f64>>,
    is_hidden: Py<PyArray1<bool>>,
}

#[pyfunction]
#[pyo3(signature = (camera, points, t_camera_lidar, origin_m=[0.0; 3]))]
pub(super) fn project_points(
    py: Python<'_>,
    camera: &PyCamera,
    points: PyReadonlyArray2<f32>,
    t_camera_lidar: Pose,
    origin_m: [f64; 3],
) -> PyResult<PyProjected> {
    let points = rows("points", &points)?;
    let (mut pixels, mut ranges, mut is_hidden) =
        (vec![[f64::NAN; 2]; points.len()], vec![f64::NAN; points.len()], vec![false; points.len()]);
    detached(|| {
        let projected = visibility::project_points(&camera.0, points.iter().enumerate(), &t_camera_lidar.0);
        let is_occluded = visibility::hidden(&camera.0, &points, &origin_m.into(), &projected);
        for (point, hidden) in projected.iter().zip(is_occluded) {
            pixels[point.index] = point.pixel.into();
            ranges[point.index] = point.p_camera.norm();
            is_hidden[point.index] = hidden;
        }
    });
    Ok(PyProjected {
        pixels: to_array2(py, &pixels)?.unbind(),
        ranges: ranges.into_pyarray(py).unbind(),
        is_hidden: is_hidden.into_pyarray(py).unbind(),
    })
}
