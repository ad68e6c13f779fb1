//! All frames as the core stores them: clouds and label images are copied once, and shared by all frames that use
//! them.

use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays::{dense_image, rows};
use super::calls::value_error;
use super::camera::PyCamera;
use super::labels::PyClassShares;
use super::segmentation::PyPartitions;
use crate::classes::ClassShares;
use crate::label_image::LabelImage;
use crate::observation::Partitions;
use crate::observation::{Frame, Observations};
use crate::pyramid::LabelPyramid;
use crate::visibility::Sweep;

#[pyclass(name = "LabelledCloud", frozen)]
pub(super) struct PyLabelledCloud {
    points: Arc<Sweep>,
    classes: Arc<Vec<u8>>,
    shares: Option<Arc<ClassShares>>,
    partitions: Option<Arc<Partitions>>,
    plain_class: Option<u8>,
}

#[pymethods]
impl PyLabelledCloud {
    #[new]
    #[pyo3(signature = (points, classes, shares=None, partitions=None, plain_class=None))]
    fn new(
        points: PyReadonlyArray2<f32>,
        classes: PyReadonlyArray1<u8>,
        shares: Option<&PyClassShares>,
        partitions: Option<&PyPartitions>,
        plain_class: Option<u8>,
    ) -> PyResult<Self> {
        Ok(Self {
            points: Arc::new(rows("points", &points)?.into()),
            classes: Arc::new(classes.as_array().to_vec()),
            shares: shares.map(|shares| Arc::clone(&shares.0)),
            partitions: partitions.map(|partitions| Arc::clone(&partitions.0)),
            plain_class,
        })
    }
}

impl PyLabelledCloud {
    /// The points and their classes.
    pub(super) fn arrays(&self) -> PyResult<(&[[f32; 3]], &[u8])> {
        let (points, classes) = (self.points.len(), self.classes.len());
        if points != classes {
            return Err(value_error(format!("{points} points have {classes} classes")));
        }
        Ok((&self.points, &self.classes))
    }
}

#[pyclass(name = "LabelledImage", frozen)]
pub(super) struct PyLabelledImage {
    pyramid: Arc<LabelPyramid>,
}

#[pymethods]
impl PyLabelledImage {
    #[new]
    #[pyo3(signature = (classes, shares=None, blur_px=None))]
    fn new(classes: PyReadonlyArray2<u8>, shares: Option<&PyClassShares>, blur_px: Option<f64>) -> Self {
        let shares = shares.map(|shares| Arc::clone(&shares.0));
        Self { pyramid: Arc::new(LabelPyramid::new(Arc::new(dense_image(&classes)), shares, blur_px)) }
    }
}

#[pyclass(name = "Observations", frozen)]
pub(super) struct PyObservations(pub(super) Arc<Observations>);

#[pymethods]
impl PyObservations {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "Python names them")]
    #[pyo3(signature = (camera, frames, num_point_classes, num_image_classes, max_baseline_m, edge_band_px, origin_m, by_classes=false))]
    fn new(
        camera: &PyCamera,
        frames: Vec<(PyRef<'_, PyLabelledCloud>, PyRef<'_, PyLabelledImage>, f32, u32)>,
        num_point_classes: usize,
        num_image_classes: usize,
        max_baseline_m: f64,
        edge_band_px: usize,
        origin_m: [f64; 3],
        by_classes: bool,
    ) -> PyResult<Self> {
        let frame = |(cloud, image, weight, scene): &(PyRef<'_, _>, PyRef<'_, _>, f32, u32)| {
            frame(cloud, image, *weight, *scene, by_classes)
        };
        let frames = frames.iter().map(frame).collect();
        let mut observations =
            Observations::new(camera.0.clone(), frames, num_point_classes, num_image_classes)?;
        observations.max_baseline_m = max_baseline_m;
        observations.edge_band_px = edge_band_px;
        observations.origin = origin_m.into();
        Ok(Self(Arc::new(observations)))
    }
}

impl PyLabelledImage {
    pub(super) fn classes(&self) -> &LabelImage<u8> {
        &self.pyramid.classes
    }
}

fn frame(
    cloud: &PyLabelledCloud,
    image: &PyLabelledImage,
    weight: f32,
    scene: u32,
    by_classes: bool,
) -> Frame {
    Frame {
        points: Arc::clone(&cloud.points),
        point_classes: Arc::clone(&cloud.classes),
        image: Arc::clone(&image.pyramid),
        point_shares: cloud.shares.clone(),
        partitions: cloud.partitions.clone().filter(|_| !by_classes),
        weight,
        scene: Some(scene),
        plain_class: cloud.plain_class,
    }
}
