//! Exact mutual information between points and the full-resolution label images at a pose.

use nalgebra::{Isometry3, Point2};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::label_image::LabelImage;
use crate::mutual_information::JointHistogram;
use crate::observation::{Frame, NO_CLASS, Observations};
use crate::visibility::{Landing, hidden, land};

/// The picture is divided into so many blocks along its longer side to tell which share of it the points cover.
const COVER_BLOCKS: usize = 40;

/// How well points and pictures agree at a pose.
#[derive(Clone, Debug)]
pub struct Agreement {
    /// Bilinear weights of the pairs that visible points form with the four pixels around them, over all frames.
    pub joint: JointHistogram,
    /// Labelled points inside the picture.
    pub num_inside: usize,
    /// Those of them that a nearer return hides from the camera.
    pub num_hidden: usize,
    /// Share of the picture's area, averaged over frames, that visible labelled points cover.
    pub overlap: f64,
}

impl Agreement {
    /// Share of the visible pairs whose pointwise mutual information is positive.
    pub fn label_agreement(&self) -> f64 {
        let pairs = self.joint.weights.iter().zip(self.joint.pointwise());
        // An empty sum of floats is minus zero.
        let agreeing = pairs.filter(|(_, pmi)| *pmi > 0.0).fold(0.0, |sum, (weight, _)| sum + weight);
        let total = self.joint.total();
        if total > 0.0 { agreeing / total } else { 0.0 }
    }
}

/// Compares all frames at `T_camera_lidar`.
pub fn agreement(observations: &Observations, t_camera_lidar: &Isometry3<f64>) -> Agreement {
    let frames: Vec<Agreement> = observations
        .frames
        .par_iter()
        .map(|frame| frame_agreement(observations, frame, t_camera_lidar))
        .collect();
    let mut pooled = Agreement {
        joint: JointHistogram::new(observations.num_point_classes, observations.num_image_classes),
        num_inside: 0,
        num_hidden: 0,
        overlap: 0.0,
    };
    for frame in &frames {
        pooled.joint.merge(&frame.joint);
        pooled.num_inside += frame.num_inside;
        pooled.num_hidden += frame.num_hidden;
        pooled.overlap += frame.overlap;
    }
    pooled.overlap /= frames.len() as f64;
    pooled
}

fn frame_agreement(observations: &Observations, frame: &Frame, t_camera_lidar: &Isometry3<f64>) -> Agreement {
    let camera = &observations.camera;
    let landings = land(camera, &frame.points, t_camera_lidar);
    let hidden = hidden(camera, &landings);
    let mut joint = JointHistogram::new(observations.num_point_classes, observations.num_image_classes);
    let (mut num_inside, mut num_hidden) = (0, 0);
    let mut cover = Cover::new(camera);
    for ((landing, &class), hidden) in landings.iter().zip(&frame.point_classes).zip(hidden) {
        let Some(Landing { pixel, .. }) = landing else {
            continue;
        };
        if class == NO_CLASS {
            continue;
        }
        num_inside += 1;
        num_hidden += usize::from(hidden);
        if !hidden {
            add_bilinear(&mut joint, class, &frame.image_classes, pixel);
            cover.mark(pixel);
        }
    }
    Agreement { joint, num_inside, num_hidden, overlap: cover.share() }
}

/// Shares a pair among the four pixels around a point, so that the histogram changes smoothly with the pose.
fn add_bilinear(joint: &mut JointHistogram, class: u8, image: &LabelImage<u8>, pixel: &Point2<f64>) {
    let (u, v) =
        (pixel.x.clamp(0.0, image.width as f64 - 1.0), pixel.y.clamp(0.0, image.height as f64 - 1.0));
    let (u0, v0) = (u as usize, v as usize);
    let (u1, v1) = ((u0 + 1).min(image.width - 1), (v0 + 1).min(image.height - 1));
    let (du, dv) = (u - u0 as f64, v - v0 as f64);
    joint.add(class, image.at(u0, v0), (1.0 - du) * (1.0 - dv));
    joint.add(class, image.at(u1, v0), du * (1.0 - dv));
    joint.add(class, image.at(u0, v1), (1.0 - du) * dv);
    joint.add(class, image.at(u1, v1), du * dv);
}

/// Blocks of the picture that points fall into.
struct Cover {
    block: f64,
    columns: usize,
    marked: Vec<bool>,
}

impl Cover {
    fn new(camera: &Camera) -> Self {
        let block = camera.width.max(camera.height) as f64 / COVER_BLOCKS as f64;
        let blocks = |size: usize| (size as f64 / block).ceil() as usize;
        let columns = blocks(camera.width);
        Self { block, columns, marked: vec![false; columns * blocks(camera.height)] }
    }

    fn mark(&mut self, pixel: &Point2<f64>) {
        let at = |x: f64| ((x + 0.5) / self.block) as usize;
        self.marked[at(pixel.y) * self.columns + at(pixel.x)] = true;
    }

    fn share(&self) -> f64 {
        self.marked.iter().filter(|&&m| m).count() as f64 / self.marked.len() as f64
    }
}
